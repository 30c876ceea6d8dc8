import numpy as np

from plat.motions import MotionClip, load_motions, mend_motion
from plat.motions.checks.mending import _lifts_feet
from plat.motions.checks.settings import ValidationLimits
from plat.motions.clip import ASSUMED_RATE
from plat.robots import G1
from tests.motions.formats.writers import bowing_clip


def test_what_needs_nothing_is_the_same_object():
    clip = bowing_clip(60)
    mended = mend_motion(clip)
    assert mended.clip is clip
    assert (mended.before.verdict, mended.after.verdict, mended.done) == ("use", "use", ())


def test_only_what_is_asked_for_is_done():
    clip = bowing_clip(60)
    qpos = clip.qpos.copy()
    qpos[40:, 7 + 18] += 0.5
    mended = mend_motion(MotionClip("step", qpos, 50.0))
    assert mended.done == ("single-frame steps smoothed",)
    assert mended.after.verdict == "use"
    np.testing.assert_array_equal(np.delete(mended.clip.qpos, 7 + 18, 1), np.delete(qpos, 7 + 18, 1))


def test_a_jump_near_an_end_is_trimmed():
    qpos = bowing_clip(90).qpos.copy()
    qpos[:6, 0] += 0.5
    mended = mend_motion(MotionClip("jump", qpos, 50.0))
    assert mended.done == ("ends trimmed",)
    assert mended.after.verdict == "use"
    np.testing.assert_array_equal(mended.clip.qpos, qpos[-len(mended.clip.qpos) :])
    assert len(mended.clip.qpos) >= 82


def test_a_drifting_floor_is_followed_where_a_shift_is_not_enough():
    qpos = bowing_clip(200).qpos.copy()
    qpos[:, 2] += np.linspace(-0.12, 0.12, 200)
    mended = mend_motion(MotionClip("drift", qpos, 50.0))
    assert mended.before.verdict == "repair"
    assert mended.after.verdict == "use"
    assert mended.done[-1] == "feet put on a floor that drifts"


def test_what_cannot_be_repaired_stays_as_it_is():
    clip = MotionClip("bow", bowing_clip(60).qpos, 50.0, (ASSUMED_RATE,))
    mended = mend_motion(clip)
    assert mended.clip is clip
    assert mended.after.reasons == ("nothing states or shows its frame rate: state it (--fps)",)


def test_repairs_leave_the_notes():
    qpos = bowing_clip(60).qpos.copy()
    qpos[:, 2] += 0.1
    mended = mend_motion(MotionClip("bow", qpos, 50.0, (ASSUMED_RATE,)), G1)
    assert mended.done == ("feet put on the floor",)
    assert mended.clip.notes == (ASSUMED_RATE,)
    assert mended.after.verdict == "repair"


def raised(clip, height, first=0):
    qpos = clip.qpos.copy()
    qpos[first:, 2] += height
    return MotionClip(clip.name, qpos, clip.fps)


def test_standing_feet_are_not_lifted():
    """As they would be for a hand that reaches under the floor."""
    bow = bowing_clip(60)
    limits = ValidationLimits()
    assert _lifts_feet(bow, raised(bow, 0.15, 30), G1, limits)
    assert not _lifts_feet(bow, raised(bow, 0.15, 58), G1, limits)
    assert not _lifts_feet(bow, raised(bow, 0.015), G1, limits)
    assert not _lifts_feet(raised(bow, 0.1), bow, G1, limits)
    assert not _lifts_feet(raised(bow, -0.1), bow, G1, limits)
    for off in (-0.15, -0.04, 0.04, 0.15):  # of a clip that sinks or floats as well
        assert _lifts_feet(raised(bow, off), raised(bow, 0.15, 30), G1, limits)


def test_joints_of_a_clip_that_floats_are_mended_as_well():
    """Its feet were called lifted by what did not move them, and a second --repair did what the first had left."""
    qpos = raised(bowing_clip(60), 0.1).qpos
    qpos[40:, 7 + 18] += 0.5
    qpos[:, 7 + 26] = G1.joint_range[26, 1] + 0.05
    mended = mend_motion(MotionClip("floating", qpos, 50.0))
    done = ("single-frame steps smoothed", "joints clipped to their limits", "feet put on the floor")
    assert (mended.done, mended.after.verdict) == (done, "use")


def test_a_hand_under_the_floor_does_not_lift_a_clip_that_sinks_or_floats(shared_data):
    """49 % of the frames in which it stands were in the air afterwards, 20 cm at most, and the verdict was use."""
    motions = load_motions(shared_data / "motions" / "hard_sa_val.npz")
    (clip,) = (clip for clip in motions if clip.name == "hdm05_bk_depositFloorR_008_low")
    for off in (0.0, -0.05, -0.15, 0.15):
        mended = mend_motion(raised(clip, off))
        assert "feet put on a floor that drifts" not in mended.done
        assert mended.after.verdict == "repair"
        # less is left, though not nothing
        assert mended.done == (("feet put on the floor",) if off else ())
        assert abs(mended.after.floating) < 0.01
