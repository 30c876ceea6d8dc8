import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from plat.errors import MotionError
from plat.motions import MotionClip, ValidationLimits, load_motions, validate_motion, validate_motions
from plat.robots import G1
from tests.motions.formats.writers import bowing_clip


def joint(name: str) -> int:
    return 7 + G1.joint_names.index(name)


def changed(**changes) -> MotionClip:
    """The bow with a column changed by a number or an array."""
    clip = bowing_clip(100)
    for name, value in changes.items():
        clip.qpos[:, "xyz".index(name) if name in "xyz" else joint(name)] += value
    return clip


def test_a_good_clip_is_used():
    report = validate_motion(changed())
    assert (report.verdict, report.reasons) == ("use", ())
    assert report.seconds == pytest.approx(99 / 50)
    assert report.slip < 0.01
    assert abs(report.floating) < 0.01
    assert report.penetration < 0.01
    assert report.jumps == ()


def test_joint_limits():
    low, high = G1.joint_range[joint("left_elbow") - 7].tolist()
    report = validate_motion(changed(left_elbow=high + 0.2 - changed().qpos[:, joint("left_elbow")]))
    assert report.joint_excess == pytest.approx(0.2, abs=1e-5)
    assert (report.verdict, report.reasons) == ("repair", ("0.20 rad beyond a joint's limits",))
    assert validate_motion(changed(left_elbow=low - 0.6 - changed().qpos[:, joint("left_elbow")])).verdict == "drop"


def test_joint_speed():
    waving = np.tile([0.0, 0.4, 0.8, 0.4], 25)
    report = validate_motion(changed(left_wrist_yaw=waving))
    assert report.joint_speed == pytest.approx(0.4 * 50, abs=1)
    assert report.verdict == "use"
    report = validate_motion(changed(left_wrist_yaw=2 * waving))
    assert (report.verdict, report.reasons[0]) == ("drop", "a joint at 40 rad/s")


@pytest.mark.parametrize(
    ("height", "verdict", "floats"), [(0.1, "repair", 0.1), (-0.1, "repair", -0.1), (0.01, "use", 0.01)]
)
def test_feet_off_the_floor(height, verdict, floats):
    plain, report = validate_motion(changed()), validate_motion(changed(z=height))
    assert report.floating - plain.floating == pytest.approx(floats, abs=1e-5)
    assert report.penetration == pytest.approx(max(0, plain.penetration - height), abs=0.005)
    assert report.verdict == verdict
    # the floor that the feet rest on moves with them, so slip is the same
    assert report.slip == pytest.approx(plain.slip, abs=1e-3)


def test_slip():
    report = validate_motion(changed(y=np.arange(100) / 50 * 1.5))
    assert report.slip == pytest.approx(1.5, abs=0.05)
    assert report.verdict == "drop"
    assert "feet slip at 1.5 m/s" in report.reasons


def test_self_penetration():
    # the left arm swung through the chest
    report = validate_motion(changed(left_shoulder_roll=-0.9, left_shoulder_yaw=0.3, left_elbow=0.6))
    assert report.self_penetration > validate_motion(changed()).self_penetration
    assert report.self_penetration > 0.02
    limits = ValidationLimits(self_penetration=0.02)
    assert (
        validate_motion(changed(left_shoulder_roll=-0.9, left_shoulder_yaw=0.3, left_elbow=0.6), limits=limits).verdict
        == "drop"
    )


def test_a_jump_in_the_middle_drops_a_clip_and_one_near_an_end_is_trimmed():
    step = np.zeros(100)
    step[50:] = 0.3
    report = validate_motion(changed(x=step))
    assert report.verdict == "drop"
    assert "the root jumps at 0.98 s" in report.reasons
    assert report.jumps == pytest.approx((0.98, 1.0))
    step[:] = 0
    step[:3] = 0.3
    report = validate_motion(changed(x=step))
    assert (report.verdict, report.reasons) == ("repair", ("the root jumps at 0.04 s",))


def test_a_turn_in_one_frame_is_a_jump():
    clip = changed()
    turned = bowing_clip(100, heading=math.pi / 2)
    clip.qpos[50:] = turned.qpos[50:]
    clip.qpos[50:, :2] = clip.qpos[49, :2]
    assert validate_motion(clip).jumps == pytest.approx((0.98, 1.0))


def test_short_clips():
    report = validate_motion(bowing_clip(10))
    assert (report.verdict, report.reasons[0]) == ("drop", "0.18 s long")
    assert validate_motion(bowing_clip(2)).verdict == "drop"


def test_limits_decide():
    report = validate_motion(changed(), limits=ValidationLimits(min_seconds=5))
    assert report.verdict == "drop"
    assert replace(report, verdict="use", reasons=()) == validate_motion(changed())


def test_broken_clips_raise():
    with pytest.raises(MotionError, match="motion 'bow': qpos has 35 columns"):
        validate_motion(MotionClip("bow", bowing_clip().qpos[:, :35], 50.0))


def test_real_motions(shared_data):
    # retargeted by an optimizer that keeps limits and speeds; smoothing of single-frame steps left some joints
    # up to 0.08 rad beyond their limits
    reports = validate_motions(load_motions(shared_data / "motions" / "bandai_val.npz")[::4])
    assert Counter(report.verdict for report in reports)["use"] > 0.85 * len(reports)
    assert max(report.joint_excess for report in reports) < 0.1
    # estimated from video: the feet float
    reports = validate_motions(load_motions(shared_data / "motions" / "asap_train.npz"))
    assert Counter(report.verdict for report in reports)["repair"] > len(reports) / 2
    assert max(report.floating for report in reports) == pytest.approx(0.142, abs=0.01)


def test_a_root_that_goes_elsewhere_than_the_feet_is_seen():
    """Both feet on the floor, carried along at 0.7 m/s: less than feet in contact may slip in a run."""
    qpos = G1.default_qpos[None].repeat(60, 0)
    qpos[:, 0] = 0.7 * np.arange(60) / 30
    report = validate_motion(MotionClip("carried", qpos, 30.0))
    assert report.verdict == "drop"
    assert report.root_speed == pytest.approx(0.7)
    assert "feet slip at 0.7 m/s under a root at 0.7 m/s: are the root's unit, axes and frame right?" in report.reasons


@pytest.mark.parametrize("count", [1, 2, 4])
def test_frames_that_stand_several_times_are_told_of(count):
    clip = bowing_clip(60)
    report = validate_motion(MotionClip("bow", clip.qpos.repeat(count, 0), 50.0))
    assert report.repeats == count
    told = f"each frame stands {count} times: is its frame rate right?"
    assert (told in report.reasons) == (count > 1)
    # who stands still for a while and moves then has no frame twice
    held = np.concatenate((clip.qpos[:1].repeat(100, 0), clip.qpos))
    assert validate_motion(MotionClip("held", held, 50.0)).repeats == 1
