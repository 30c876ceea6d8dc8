import mujoco
import numpy as np
import pytest
import torch

from plat.deploy import KeypointKinematics, ObservationBuilder, StateEstimator
from plat.errors import RobotError, StateError
from plat.robots import G1, ForwardKinematics
from tests.deploy.robots import describe_g1, random_qpos


def test_keypoints_are_where_mujoco_puts_them():
    model, kinematics = G1.model(), KeypointKinematics(describe_g1())
    data = mujoco.MjData(model)
    for qpos in random_qpos(20):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        expected = np.array([data.body(name).xpos for name in G1.keypoints])
        np.testing.assert_allclose(kinematics(qpos[:3], qpos[3:7], qpos[7:]), expected, atol=1e-12)


def test_agrees_with_the_kinematics_of_training():
    qpos = random_qpos(20)
    pos_w, _ = ForwardKinematics(G1)(*torch.from_numpy(qpos).float().split((3, 4, 29), -1))
    kinematics = KeypointKinematics(describe_g1())
    ours = np.array([kinematics(row[:3], row[3:7], row[7:]) for row in qpos])
    np.testing.assert_allclose(ours, pos_w.numpy(), atol=2e-6)


def test_what_is_no_description_is_named():
    for made in (KeypointKinematics, StateEstimator, lambda robot: ObservationBuilder(robot, 50)):
        with pytest.raises(RobotError, match="robot is a Robot, expected a RobotDescription, as .*describe_robot"):
            made(G1)


def test_angles_of_another_robot_are_refused():
    with pytest.raises(StateError, match=r"joint_pos has shape \(28,\), expected \(29,\)"):
        KeypointKinematics(describe_g1())(np.zeros(3), np.array([1.0, 0, 0, 0]), np.zeros(28))


def test_results_are_not_overwritten_by_the_next_call():
    kinematics = KeypointKinematics(describe_g1())
    first, second = random_qpos(2)
    before = kinematics(first[:3], first[3:7], first[7:])
    kept = before.copy()
    kinematics(second[:3], second[3:7], second[7:])
    np.testing.assert_array_equal(before, kept)
