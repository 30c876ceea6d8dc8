"""Joints of files, brought into the robot's order."""

from dataclasses import replace

import numpy as np
import pytest

from plat.errors import MotionError
from plat.motions.formats.common import arrange_joints, number
from plat.robots import G1


def test_missing_wrists_are_told_of():
    names = [name for name in G1.joint_names if "wrist" not in name]
    arranged, notes = arrange_joints(np.zeros((3, len(names))), names, G1, "joint_pos")
    assert arranged.shape == (3, 29)
    assert notes == ["no wrists in the file: default pose"]
    assert arrange_joints(np.zeros((3, 29)), G1.joint_names, G1, "joint_pos")[1] == []


def test_a_robot_without_wrists_misses_none():
    names = tuple(name for name in G1.joint_names if "wrist" not in name)[:9]
    robot = replace(G1, name="legs")
    robot.__dict__["joint_names"] = names
    robot.__dict__["default_joint_pos"] = G1.default_joint_pos[:9]
    angles = np.linspace(0, 1, 27).reshape(3, 9)
    arranged, notes = arrange_joints(angles, names, robot, "joint_pos")
    assert notes == []
    np.testing.assert_array_equal(arranged, angles)


def test_a_joint_twice_is_said_so():
    names = [*G1.joint_names[:3], *G1.joint_names[4:5], *G1.joint_names[4:]]
    with pytest.raises(MotionError, match=rf"has \['{G1.joint_names[4]}'\] twice, expected each joint once"):
        arrange_joints(np.zeros((3, 29)), names, G1, "joint_pos")


def test_a_truth_value_is_no_number():
    assert number("30", "fps") == 30
    with pytest.raises(MotionError, match="'fps' is True, expected one number"):
        number(np.array(True), "fps")
