import numpy as np
import pytest
import torch

from plat.errors import MotionError
from plat.motions import load_motions
from plat.motions.checks.feet import Soles
from plat.motions.formats import ReadOptions
from plat.motions.formats.quaternion_order import (
    _some_frames,
    detect_joint_order,
    detect_quat_order,
    settle_quat_order,
)
from plat.robots import G1
from tests.motions.formats.writers import ISAAC_ORDER, bowing_clip, turned

SOLES = Soles(G1)


def as_xyzw(qpos: np.ndarray) -> np.ndarray:
    return qpos[:, [0, 1, 2, 4, 5, 6, 3, *range(7, 36)]]


@pytest.mark.parametrize("heading", [0.0, 0.7, np.pi / 2, 3.0, np.pi, -np.pi / 2])
def test_both_orders_are_told_apart_at_any_heading(heading):
    clip = bowing_clip(heading=heading)
    assert detect_quat_order(clip.qpos, clip.fps, SOLES) == "wxyz"
    assert detect_quat_order(as_xyzw(clip.qpos), clip.fps, SOLES) == "xyzw"


def test_standing_still_may_be_either():
    qpos = np.tile(G1.default_qpos, (30, 1))
    # no rotation written as xyzw is a heading of 180 degrees read as wxyz: nothing tells them apart
    assert detect_quat_order(as_xyzw(qpos), 30.0, SOLES) is None
    # the other way round one of them stands on its head
    assert detect_quat_order(qpos, 30.0, SOLES) == "wxyz"


def test_a_stated_order_gives_way_to_the_motion_alone():
    clip = bowing_clip(heading=0.7)
    for stated in ("wxyz", "xyzw"):
        order, notes = settle_quat_order(reader(clip.qpos), clip.fps, SOLES, stated)
        assert order == "wxyz"
        assert bool(notes) == (stated == "xyzw")
    standing = np.tile(G1.default_qpos, (30, 1))
    assert settle_quat_order(reader(as_xyzw(standing)), 30.0, SOLES, "wxyz") == ("wxyz", [])


def reader(columns: np.ndarray):
    """What makes the motion of columns in an order."""
    return lambda order: columns if order == "wxyz" else columns[:, [0, 1, 2, 6, 3, 4, 5, *range(7, 36)]]


def test_an_order_that_cannot_be_read_is_none():
    clip = bowing_clip(heading=0.7)

    def read(order: str) -> np.ndarray:
        if order == "xyzw":
            raise MotionError("no unit")
        return clip.qpos

    assert settle_quat_order(read, clip.fps, SOLES, "wxyz") == ("wxyz", [])
    with pytest.raises(MotionError, match="no unit"):
        settle_quat_order(read, clip.fps, SOLES, "xyzw")


def in_order(qpos: np.ndarray, names: list[str]) -> np.ndarray:
    """Poses whose joints stand in an order, read as if they stood in the robot's."""
    return np.concatenate((qpos[:, :7], qpos[:, [7 + G1.joint_names.index(name) for name in names]]), 1)


def test_the_order_of_joints_is_seen_in_the_motion():
    clip, options = bowing_clip(), ReadOptions(G1)
    numbered = in_order(clip.qpos, ISAAC_ORDER)
    for order in ("wxyz", None):
        assert detect_joint_order(clip.qpos, numbered, options, order) == "this"
        assert detect_joint_order(numbered, clip.qpos, options, order) == "other"


def test_real_motions_are_never_mistaken(shared_data):
    rng = np.random.default_rng(0)
    refused = 0
    clips = load_motions([shared_data / "motions" / f"{name}.npz" for name in ("asap_train", "pbhc_train")])
    clips += load_motions(shared_data / "motions" / "bandai_val.npz")[::6]
    for clip in clips:
        for angle in (0.0, np.pi, rng.uniform(-np.pi, np.pi)):
            qpos = turned(clip, angle).qpos
            for order, columns in (("wxyz", qpos), ("xyzw", as_xyzw(qpos))):
                found = detect_quat_order(columns, clip.fps, SOLES)
                assert found in (order, None), (clip.name, angle)
                refused += found is None
    assert refused <= 0.01 * 6 * len(clips)


def test_a_long_motion_is_judged_by_blocks_of_its_frames():
    motion = turned(bowing_clip(400), 1.0)
    long = np.concatenate([motion.qpos] * 60)  # 24,000 frames, of which 10,000 are looked at
    assert detect_quat_order(long, motion.fps, SOLES) == detect_quat_order(motion.qpos, motion.fps, SOLES) == "wxyz"
    frames = _some_frames(torch.arange(100_000.0)[:, None])
    assert len(frames) == 10_000
    assert (frames[0], frames[-1]) == (0, 99_999)
