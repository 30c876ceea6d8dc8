import numpy as np
import pytest

from plat.motions import MotionClip, load_motions
from plat.motions.checks.feet import Soles
from plat.motions.formats.quaternion_order import detect_quat_order, doubt_quat_order
from plat.robots import G1
from tests.motions.formats.writers import bowing_clip, turned

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


def test_a_format_whose_order_is_known_is_doubted_where_it_looks_wrong():
    clip = bowing_clip()
    assert doubt_quat_order(clip, "xyzw", SOLES) == doubt_quat_order(clip, "wxyz", SOLES) == []
    # an xyzw file whose columns are really wxyz, as the reader sees it
    columns = clip.qpos
    misread = MotionClip("bow", columns[:, [0, 1, 2, 6, 3, 4, 5, *range(7, 36)]], clip.fps)
    (note,) = doubt_quat_order(misread, "xyzw", SOLES)
    assert "'bow' looks right only with quaternion wxyz" in note


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
