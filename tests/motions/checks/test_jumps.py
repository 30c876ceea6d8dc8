import numpy as np
import pytest

from plat.motions import MotionClip, cut_motion
from plat.motions.checks.settings import ValidationLimits
from plat.robots import G1


def standing(frames: int = 60) -> np.ndarray:
    return G1.default_qpos[None].repeat(frames, 0)


def test_a_clip_without_jumps_is_not_touched():
    clip = MotionClip("calm", standing(), 30.0, ("a note",))
    assert cut_motion(clip) == [clip] or cut_motion(clip)[0] is clip


@pytest.mark.parametrize("what", ["root", "turn", "joint", "several joints"])
def test_pieces_end_and_begin_at_a_jump(what):
    qpos = standing()
    if what == "root":
        qpos[25:, 1] -= 0.3
    elif what == "turn":
        qpos[25:, 3:7] = [0, 0, 0, 1]
    elif what == "joint":
        qpos[25:, 7 + 18] += 1.5
    else:  # none of them as fast as no motor is
        qpos[25:, 7:13] += 0.6
    pieces = cut_motion(MotionClip("two", qpos, 30.0, ("a note",)))
    assert [(piece.name, len(piece.qpos), piece.notes) for piece in pieces] == [
        ("two_c0", 25, ("a note",)),
        ("two_c1", 35, ("a note",)),
    ]
    np.testing.assert_array_equal(np.concatenate([piece.qpos for piece in pieces]), qpos)


def test_one_joint_that_steps_is_smoothed_and_not_cut():
    qpos = standing()
    qpos[25:, 7 + 18] += 0.6
    assert len(cut_motion(MotionClip("step", qpos, 30.0))) == 1


def test_short_pieces_and_single_frames_elsewhere_are_left_out():
    qpos = standing(90)
    qpos[10:, 0] += 1
    qpos[50, 0] += 1
    pieces = cut_motion(MotionClip("a", qpos, 30.0))
    assert [len(piece.qpos) for piece in pieces] == [40, 39]
    assert cut_motion(MotionClip("a", qpos, 30.0), limits=ValidationLimits(min_seconds=5)) == []
