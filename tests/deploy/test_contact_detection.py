from dataclasses import replace

import mujoco
import numpy as np
import pytest

from plat.deploy import ContactDetector, ContactSettings, SoleKinematics
from plat.robots import G1
from tests.deploy.robots import describe_g1

ROBOT = describe_g1()


def standing() -> tuple[np.ndarray, np.ndarray]:
    return SoleKinematics(ROBOT)(ROBOT.default_joint_pos)


def test_a_foot_that_is_high_or_fast_does_not_touch():
    points, jacobian = standing()
    still = np.zeros_like(points)
    detector = ContactDetector(ROBOT, ContactSettings(steps=1))
    assert detector(points, still, jacobian).all()
    lifted = points + np.where(np.arange(8) < 4, 0.05, 0.0)[:, None] * (0, 0, 1)
    assert detector(lifted, still, jacobian).tolist() == [False] * 4 + [True] * 4
    swinging = still + np.where(np.arange(8) < 4, 1.0, 0.0)[:, None] * (1, 0, 0)
    assert detector(points, swinging, jacobian).tolist() == [False] * 4 + [True] * 4


def test_a_contact_must_last():
    points, jacobian = standing()
    detector = ContactDetector(ROBOT, ContactSettings(steps=3))
    assert [bool(detector(points, 0 * points, jacobian).all()) for _ in range(4)] == [False, False, True, True]
    detector.reset()
    assert not detector(points, 0 * points, jacobian).any()


@pytest.mark.parametrize(("mass", "touches"), [(33.34, False), (None, False), (8.0, True)])
def test_a_light_robot_bears_less(mass, touches):
    """30 N are a swinging leg of a G1, and half the weight of a small robot."""
    points, jacobian = standing()
    detector = ContactDetector(replace(ROBOT, mass=mass), ContactSettings(steps=1))
    torque = -np.sum([jacobian[rows, 2].mean(0) for rows in (slice(0, 4), slice(4, 8))], axis=0) * 30.0
    np.testing.assert_allclose(detector.forces(jacobian, torque), 30.0, rtol=0.1)
    assert detector(points, 0 * points, jacobian, torque).all() == touches
    assert ContactDetector(ROBOT, ContactSettings(steps=1, force=20.0))(points, 0 * points, jacobian, torque).all()


def test_forces_are_those_of_a_robot_that_stands():
    model = G1.model()
    data = mujoco.MjData(model)
    data.qpos[:] = G1.default_qpos
    data.ctrl[:] = ROBOT.default_joint_pos
    mujoco.mj_step(model, data, 100)
    _, jacobian = SoleKinematics(ROBOT)(data.qpos[7:])
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, data.qpos[3:7])
    detector = ContactDetector(ROBOT)
    forces = detector.forces(rotation.reshape(3, 3) @ jacobian, data.actuator_force)
    weight = 9.81 * model.body_mass.sum()
    assert abs(forces.sum() - weight) < 0.3 * weight
    assert (forces > 80).all()
    # a robot that hangs in the air holds its legs up
    assert (detector.forces(jacobian, -data.actuator_force) < 0).all()
