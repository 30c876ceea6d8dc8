from itertools import pairwise

import numpy as np
import pytest
import torch

from plat.envs.transforms import CommandSchedule, Horizon
from plat.evaluation.difficulty import BINS, SCALES, bin_of, command_difficulty, frame_measures
from plat.motions import MotionClip, MotionLibrary
from plat.robots import G1
from tests.conftest import standing_clip


def moved(**columns: np.ndarray) -> MotionLibrary:
    """A second at 50 frames a second of the default pose, with some columns of its qpos replaced."""
    qpos = np.tile(G1.default_qpos, (51, 1))
    for name, values in columns.items():
        qpos[:, {"x": 0, "z": 2}[name]] = values
    return MotionLibrary.from_clips([MotionClip("moved", qpos, 50.0)])


def test_known_motion_has_known_measures():
    measures = frame_measures(MotionLibrary.from_clips([standing_clip()]))
    assert measures["speed"].numpy() == pytest.approx(0.3, abs=1e-3)
    assert measures["turn"].numpy() == pytest.approx(0.5, abs=1e-3)
    for name in ("acceleration", "flight", "lowness"):
        assert measures[name].max() < 1e-2


def test_acceleration_flight_and_lowness():
    time = np.arange(51) / 50
    measures = frame_measures(moved(x=0.5 * 3.0 * time**2))
    assert measures["acceleration"][10:40].numpy() == pytest.approx(3.0, rel=0.02)
    height = G1.default_qpos[2]
    up, down = (frame_measures(moved(z=np.full(51, height + offset))) for offset in (0.15, -0.2))
    assert up["flight"].numpy() == pytest.approx(0.15, abs=1e-3)
    assert up["lowness"].max() == 0
    assert down["lowness"].numpy() == pytest.approx(0.2, abs=1e-3)
    assert down["flight"].max() == 0


def test_a_command_is_as_hard_as_its_hardest_moment():
    height = G1.default_qpos[2]
    z = np.full(51, height)
    z[40:43] -= 0.2
    library = moved(z=z)
    schedule = CommandSchedule(library, Horizon(25, 25), seed=0)
    first, second = command_difficulty(library, schedule).tolist()
    assert first == pytest.approx(0.0, abs=0.02)
    assert second >= 0.2 / SCALES["lowness"] - 1e-3


def test_bins_cover_everything_once():
    assert BINS[0].low == 0
    assert all(one.high == other.low for one, other in pairwise(BINS))
    assert bin_of(torch.tensor([0.0, 0.5, 0.99, 1.0, 2.0, 100.0])) == [
        "calm",
        "everyday",
        "everyday",
        "brisk",
        "hard",
        "hard",
    ]
