from dataclasses import replace

import mujoco
import numpy as np
import pytest

from plat.deploy import SoleKinematics
from plat.errors import RobotError
from plat.robots import G1
from tests.deploy.robots import describe_g1, random_qpos


def test_points_are_where_mujoco_puts_the_spheres():
    model, soles = G1.shared_model, SoleKinematics(describe_g1())
    data = mujoco.MjData(model)
    geoms = G1.sole_geoms(model).ravel()
    for qpos in random_qpos(5):
        data.qpos[:] = np.concatenate(([0, 0, 0, 1, 0, 0, 0], qpos[7:]))
        mujoco.mj_kinematics(model, data)
        down = data.geom_xmat[geoms].reshape(-1, 3, 3)[:, :, 2]
        expected = data.geom_xpos[geoms] - model.geom_size[geoms, :1] * down
        np.testing.assert_allclose(soles(qpos[7:])[0], expected, atol=1e-12)


def test_the_jacobian_is_the_derivative_of_the_points():
    soles, (qpos,) = SoleKinematics(describe_g1()), random_qpos(1)
    _, jacobian = soles(qpos[7:])
    step = 1e-6
    for joint in range(29):
        shift = step * np.eye(29)[joint]
        slope = (soles(qpos[7:] + shift)[0] - soles(qpos[7:] - shift)[0]) / (2 * step)
        np.testing.assert_allclose(jacobian[:, :, joint], slope, atol=1e-8)


def test_a_robot_without_feet():
    with pytest.raises(RobotError, match="robot 'g1': its description has no feet: export the bundle again, with"):
        SoleKinematics(replace(describe_g1(), feet=()))
