"""The picture of a map, and what it says of one that is wrong."""

from dataclasses import replace

import matplotlib.image
import pytest

from plat.figures import draw_skeleton
from plat.motions.retargeting import builtin_maps, read_bvh
from tests.motions.retargeting.human import write_human

LAFAN1 = next(skeleton for skeleton in builtin_maps() if skeleton.name == "lafan1")


@pytest.fixture
def mocap(tmp_path):
    return read_bvh(write_human(tmp_path / "a.bvh", frames=3, turns={"LeftArm": (0, 40, 0)}))


def test_left_and_right_have_their_colors_and_places(tmp_path, mocap):
    assert draw_skeleton(tmp_path / "map.png", mocap, LAFAN1) == ""
    picture = matplotlib.image.imread(tmp_path / "map.png")[..., :3]
    blue, orange = (abs(picture - color).sum(-1) < 0.1 for color in ((0, 0.447, 0.698), (0.835, 0.369, 0)))
    front = picture.shape[1] // 2
    # who faces the viewer has the left on the right
    assert blue[:, :front].nonzero()[1].mean() > orange[:, :front].nonzero()[1].mean() + 50


def test_exchanged_sides_are_told(tmp_path, mocap):
    joints = dict(LAFAN1.joints)
    for part in ("hip", "knee", "ankle", "toe", "shoulder", "elbow", "wrist"):
        joints[f"left_{part}"], joints[f"right_{part}"] = joints[f"right_{part}"], joints[f"left_{part}"]
    told = draw_skeleton(tmp_path / "map.png", mocap, replace(LAFAN1, joints=joints))
    assert "left and right are exchanged" in told
