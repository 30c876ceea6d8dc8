import dataclasses

import numpy as np
import pytest

from plat.errors import RobotError
from plat.robots import G1, describe_robot


def test_numbers_are_those_of_the_model():
    description, model = describe_robot(G1, control_dt=0.02), G1.model()
    assert description.joint_names == G1.joint_names
    for index, name in enumerate(description.joint_names):
        motor = model.actuator(f"{name}_joint")
        assert description.stiffness[index] == motor.gainprm[0]
        assert description.damping[index] == -motor.biasprm[2]
        assert description.effort_limit[index] == motor.forcerange[1]
        np.testing.assert_array_equal(description.joint_range[index], model.joint(f"{name}_joint").range)
    np.testing.assert_array_equal(description.default_qpos, G1.default_qpos)
    np.testing.assert_array_equal(description.action_scale.astype(np.float32), G1.action_scale.numpy())


def test_the_tree_has_its_root_first_and_parents_before_children():
    bodies = describe_robot(G1, control_dt=0.02).bodies
    assert [body.parent < index for index, body in enumerate(bodies)] == [True] * len(bodies)
    assert [body.name for body in bodies if body.parent < 0] == ["pelvis"]
    moved = [body.joint for body in bodies if body.joint >= 0]
    assert len(set(moved)) == len(moved) == G1.num_joints


def test_a_robot_whose_keypoint_is_not_in_its_model():
    with pytest.raises(RobotError, match="body 'tail' is not in g1.xml"):
        describe_robot(dataclasses.replace(G1, keypoints=("pelvis", "tail")), control_dt=0.02)
