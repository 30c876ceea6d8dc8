import numpy as np
import pytest
import torch

from plat.motions import MotionClip, generate_motions, validate_motion
from plat.motions.checks.feet import Soles
from plat.motions.checks.tempo import Cadence, Tempo
from plat.motions.generation import generate_named
from plat.robots import G1


@pytest.fixture(scope="module")
def walk() -> MotionClip:
    """A walk of several steps that plat makes itself."""
    return next(clip for clip in generate_motions("train", seconds=20) if clip.name.startswith("walk_"))


def test_a_walk_fits_its_own_rate(walk):
    steps = Tempo.of(walk, G1)
    assert steps is not None
    assert steps.fits(walk.fps)
    assert steps.likely_rate == pytest.approx(walk.fps, rel=0.4)


@pytest.mark.parametrize("factor", [0.4, 0.5, 2.0, 4.0])
def test_a_wrong_rate_is_seen(walk, factor):
    wrong = MotionClip("walk", walk.qpos, factor * walk.fps)
    steps = Tempo.of(wrong, G1)
    assert not steps.fits(wrong.fps)
    report = validate_motion(wrong)
    assert report.tempo == pytest.approx(factor, rel=0.4)
    assert report.verdict != "use"
    assert any("is its frame rate right?" in reason for reason in report.reasons)
    assert validate_motion(walk).verdict == "use"


def test_what_does_not_walk_has_no_tempo():
    standing = np.tile(G1.default_qpos, (60, 1))
    assert Tempo.of(MotionClip("standing", standing, 30.0), G1) is None
    in_place = [clip for clip in generate_named("generated:val@60") if clip.name.startswith(("reach", "bow"))]
    assert in_place
    assert all(Tempo.of(clip, G1) is None for clip in in_place)


def test_the_rates_of_real_gaits(shared_data):
    from plat.motions import load_motions

    clips = load_motions(shared_data / "motions" / "bandai_val.npz")
    steps = [Tempo.of(clip, G1) for clip in clips]
    found = [one.fits(30.0) for one in steps if one is not None]
    assert len(found) > 50
    assert sum(found) >= 0.98 * len(found)


def striding(speed: float) -> MotionClip:
    """Legs that swing against each other twice a second, under a root at a speed (m/s)."""
    time = np.arange(120) / 30.0
    qpos = np.tile(G1.default_qpos, (120, 1))
    for side, sign in (("left", 1), ("right", -1)):
        qpos[:, 7 + G1.joint_names.index(f"{side}_hip_pitch")] += sign * 0.4 * np.sin(4 * np.pi * time)
    qpos[:, 0] = speed * time
    return MotionClip("stride", qpos, 30.0)


def test_a_root_that_stays_in_place_is_seen():
    assert Cadence.of(striding(0.0), G1).in_place
    assert not Cadence.of(striding(1.5), G1).in_place
    report = validate_motion(striding(0.0))
    assert report.verdict != "use"
    assert any("its root stays in place" in reason for reason in report.reasons)
    assert not any("its root stays in place" in reason for reason in validate_motion(striding(1.5)).reasons)


def test_what_is_known_of_the_feet_is_used(walk):
    feet, turns = Soles(G1).feet(torch.from_numpy(walk.qpos))
    assert Cadence.of(walk, G1, feet) == Cadence.of(walk, G1)
    still = Cadence.of(walk, G1, torch.zeros_like(feet))
    assert still is None
    torch.testing.assert_close(Soles(G1).points_of(feet, turns), Soles(G1).points(torch.from_numpy(walk.qpos)))
