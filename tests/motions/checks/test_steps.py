import numpy as np
import pytest

from plat.motions import MotionClip, joint_steps, load_motions, smooth_steps, validate_motion
from plat.robots import G1
from tests.motions.formats.writers import bowing_clip

ANKLE = 7 + G1.joint_names.index("left_ankle_roll")


def stepped(change: np.ndarray, column: int = ANKLE) -> MotionClip:
    clip = bowing_clip(100)
    clip.qpos[:, column] += change
    return clip


def away(height: float, frames: int | None = None) -> np.ndarray:
    """A step at frame 50, back after some frames."""
    change = np.zeros(100)
    change[50 : None if frames is None else 50 + frames] = height
    return change


@pytest.mark.parametrize("height", [0.25, -0.25])
@pytest.mark.parametrize(("frames", "found"), [(None, [49]), (1, [49, 50])])
def test_steps_on_and_back_are_found_and_smoothed(height, frames, found):
    clip = stepped(away(height, frames))
    report = validate_motion(clip)
    assert [step.frame for step in report.steps] == found
    assert {step.joint for step in report.steps} == {"left_ankle_roll"}
    assert report.steps[0].speed == pytest.approx(12.5, abs=0.5)
    assert report.verdict == "repair"
    assert "single-frame step" in report.reasons[0]
    assert "the first of left_ankle_roll after frame 49 at 1" in report.reasons[0]

    smoothed = smooth_steps(clip)
    assert smoothed.steps == len(found)
    assert validate_motion(smoothed.clip).verdict == "use"
    change = np.abs(smoothed.clip.qpos - clip.qpos)
    assert smoothed.largest_change == pytest.approx(change.max(), abs=1e-6)
    assert 0.1 < change.max() < 0.25
    assert np.delete(change, ANKLE, 1).max() == 0
    assert change[: 50 - 8].max() == change[50 + 9 :].max() == 0


def test_an_excursion_is_taken_out():
    smoothed = smooth_steps(stepped(away(0.25, 1))).clip
    assert np.abs(smoothed.qpos - bowing_clip(100).qpos).max() < 0.05


def test_a_fast_kick_is_no_step():
    knee = 7 + G1.joint_names.index("left_knee")
    time = np.arange(100) / 50
    kick = 1.2 * np.exp(-(((time - 1) / 0.06) ** 2))  # up to 17 rad/s
    clip = stepped(kick, knee)
    assert np.abs(np.diff(clip.qpos[:, knee])).max() * 50 > 14
    assert joint_steps(clip) == []
    assert (smooth_steps(clip).clip.qpos == clip.qpos).all()


def test_a_joint_that_trembles_has_no_isolated_steps():
    assert joint_steps(stepped(np.tile([0.0, 0.25], 50))) == []


def test_steps_near_the_ends():
    for frame in (1, 99):
        change = np.zeros(100)
        change[frame:] = 0.25
        smoothed = smooth_steps(stepped(change))
        assert smoothed.steps == 1
        assert np.isfinite(smoothed.clip.qpos).all()
        assert smoothed.clip.qpos.shape == (100, 36)


def test_smoothing_keeps_the_joint_limits():
    high = float(G1.joint_range[ANKLE - 7, 1])
    clip = bowing_clip(100)
    clip.qpos[:, ANKLE] = high - 0.3 + away(0.3, 12)
    assert smooth_steps(clip).clip.qpos[:, ANKLE].max() <= high + 1e-6


def test_recorded_motion_has_few_steps_and_synthetic_ones_are_found(shared_data):
    rng = np.random.default_rng(0)
    clips = load_motions(shared_data / "motions" / "bandai_val.npz")
    clean = [clip for clip in clips if not joint_steps(clip)]
    assert len(clean) > 0.9 * len(clips)
    found = 0
    for clip in clean[::4]:
        qpos, frame = clip.qpos.copy(), int(rng.integers(8, len(clip.qpos) - 8))
        qpos[frame:, ANKLE] += rng.choice([-1, 1]) * rng.uniform(12, 20) / clip.fps
        put = MotionClip(clip.name, qpos, clip.fps)
        found += any(step.frame == frame - 1 for step in joint_steps(put))
        assert joint_steps(smooth_steps(put).clip) == []
    assert found > 0.85 * len(clean[::4])
