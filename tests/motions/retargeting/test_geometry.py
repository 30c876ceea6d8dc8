import numpy as np
import pytest

from plat.motions.retargeting.geometry import RobotGeometry
from plat.robots import G1


def test_lengths_are_those_of_the_robots_description():
    geometry = RobotGeometry.of(G1)
    # between link frames of Unitree's description in the zero pose
    assert geometry.thigh == pytest.approx(0.306, abs=1e-3)
    assert geometry.shin == pytest.approx(0.3176, abs=1e-3)
    assert geometry.forearm == pytest.approx(0.1843, abs=1e-3)
    np.testing.assert_allclose(geometry.hip, [0, 0.1165, -0.1332], atol=1e-3)
    assert len(geometry.sole) == 4
    np.testing.assert_allclose(geometry.sole[:, 2], -0.035)


def test_the_arms_length_does_not_depend_on_the_shoulders_pitch():
    import mujoco

    geometry, model = RobotGeometry.of(G1), G1.model()
    data = mujoco.MjData(model)
    for pitch in (-2.0, 0.0, 1.0):
        data.joint("left_shoulder_pitch_joint").qpos[0] = pitch
        mujoco.mj_kinematics(model, data)
        shoulder = data.body("torso_link").xpos + geometry.shoulder
        reach = np.linalg.norm(data.body("left_elbow_link").xpos - shoulder)
        assert reach == pytest.approx(geometry.upper_arm, abs=1e-6)
