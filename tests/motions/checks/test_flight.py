"""The fall of jumps against gravity."""

import numpy as np
import pytest

from plat.motions import MotionClip, validate_motion
from plat.motions.checks.flight import Flight
from plat.robots import G1


def jump(fps: float, gravity: float = 9.81, hold: float = 0.0) -> MotionClip:
    """The default pose, thrown up for 0.5 s; ``hold`` is the share of its weight that something carries."""
    pull = gravity * (1 - hold)
    time = np.arange(round(1.5 * fps)) / fps - 0.5
    flying = (time > 0) & (time < 0.5)
    qpos = np.tile(G1.default_qpos, (len(time), 1)).astype(float)
    qpos[:, 2] += np.where(flying, 0.5 * pull * time * (0.5 - time), 0)
    return MotionClip("jump", qpos.astype(np.float32), fps)


@pytest.mark.parametrize("fps", [30.0, 50.0, 120.0])
def test_the_fall_gives_the_rate(fps):
    flight = Flight.of(jump(fps), G1)
    assert flight.likely_rate == pytest.approx(fps, rel=0.01)
    assert flight.gravity(2 * fps) == pytest.approx(4, rel=0.02)
    assert [flight.fits(fps * factor) for factor in (0.5, 0.8, 1, 1.3, 2)] == [False, True, True, True, False]


def test_motions_scaled_to_the_robot_fit():
    assert Flight.of(jump(50, 0.75 * 9.81), G1).fits(50)


def test_who_stands_or_floats_does_not_fall():
    standing = MotionClip("standing", np.tile(G1.default_qpos, (60, 1)), 30.0)
    assert Flight.of(standing, G1) is None
    time = np.linspace(0, 2, 60)
    floating = standing.qpos.copy()
    floating[:, 2] += 0.2 * np.clip(np.sin(1.5 * time), 0, 0.6)  # carried up, and down again
    assert Flight.of(MotionClip("floating", floating, 30.0), G1) is None


def test_the_verdict_asks_for_the_rate():
    right, slow = jump(50), jump(50)
    slow = MotionClip("slow", slow.qpos, 25.0)
    assert "falls" not in str(validate_motion(right).reasons)
    report = validate_motion(slow)
    assert report.verdict == "repair"
    assert "it falls at 0.25 g: is its frame rate right?" in report.reasons
    assert report.gravity == pytest.approx(0.25, rel=0.02)
