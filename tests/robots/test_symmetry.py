from dataclasses import replace

import pytest

from plat.errors import RobotError
from plat.robots import G1, keypoint_symmetry


def test_keypoints_change_sides():
    partner = keypoint_symmetry(G1)
    pairs = {name: G1.keypoints[other] for name, other in zip(G1.keypoints, partner, strict=True)}
    assert pairs["left_knee_link"] == "right_knee_link"
    assert pairs["pelvis"] == "pelvis"
    assert all(pairs[pairs[name]] == name for name in pairs)


def test_names_without_sides_are_refused():
    other = {name: name.replace("left_", "l_").replace("right_", "r_") for name in G1.keypoints}
    robot = replace(G1, name="short", keypoints=tuple(other.values()), feet=(other[G1.feet[0]], other[G1.feet[1]]))
    with pytest.raises(RobotError, match=r"'short': feet 'l_ankle_roll_link' .*, expected left_\.\.\. and right_"):
        keypoint_symmetry(robot)


def test_a_keypoint_without_a_partner_is_named():
    robot = replace(G1, name="one-handed", keypoints=G1.keypoints[:-1])
    with pytest.raises(RobotError, match="'one-handed': keypoints without a partner .*wrist"):
        keypoint_symmetry(robot)
