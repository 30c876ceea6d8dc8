from dataclasses import replace

import numpy as np
import pytest
import torch

from plat.motions import MotionClip, generate_motions, validate_motion
from plat.motions.checks.feet import Soles
from plat.motions.checks.root_path import other_path
from plat.robots import G1


@pytest.fixture(scope="module")
def walk() -> MotionClip:
    """A walk in which the feet stand while they are on the floor."""
    return next(clip for clip in generate_motions("train", seconds=20) if clip.name.startswith("walk_"))


def found(clip: MotionClip):
    return other_path(Soles(G1).points(torch.from_numpy(clip.qpos).double()), clip.qpos[:, :3], clip.fps)


def moved(clip: MotionClip, path: np.ndarray) -> MotionClip:
    qpos = clip.qpos.astype(np.float64)
    qpos[:, :2] = qpos[:, :2] @ path.T
    return replace(clip, qpos=qpos)


def test_a_walk_goes_where_its_feet_walk(walk):
    assert found(walk) is None
    assert validate_motion(walk).path is None


@pytest.mark.parametrize(
    ("path", "told"),
    [
        (np.eye(2) * 1.6, "0.625 times as long"),
        (np.eye(2) * 0.625, "1.6 times as long"),
        (np.diag([-1.0, 1.0]), "mirrored in x"),
        (np.array([[0.0, 1.0], [1.0, 0.0]]), "with x and y exchanged"),
        (-np.eye(2), "turned around"),
    ],
)
def test_a_path_of_another_unit_or_axis_is_seen_and_named(walk, path, told):
    # walked at an angle to the axes: along an axis some of the paths are the same
    half = 0.5 * 0.4
    turn = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    qpos = moved(walk, turn).qpos
    w, x, y, z = walk.qpos[:, 3:7].astype(np.float64).T
    cos, sin = np.cos(half), np.sin(half)
    qpos[:, 3:7] = np.stack((cos * w - sin * z, cos * x - sin * y, cos * y + sin * x, cos * z + sin * w), 1)
    turned = replace(walk, qpos=qpos)
    assert found(turned) is None
    other = found(moved(turned, path))
    assert other is not None
    assert other.told == told
    assert other.better < 0.5 * other.slide
    report = validate_motion(moved(turned, path))
    assert report.verdict == "drop"
    assert any(f"if the root's path were {told}" in reason for reason in report.reasons)


def test_who_stands_says_nothing():
    assert found(MotionClip("standing", np.tile(G1.default_qpos, (60, 1)), 30.0)) is None


def test_who_slides_without_walking_says_nothing():
    sliding = np.tile(G1.default_qpos, (60, 1))
    sliding[:, 0] = 0.01 * np.arange(60)
    assert found(MotionClip("sliding", sliding, 30.0)) is None
