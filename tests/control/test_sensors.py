import numpy as np
import pytest

from plat.control import SensorNoise, SimulatedSensors, Simulator
from plat.errors import ActionError
from plat.keyframes import standing
from plat.robots import G1

TARGET = G1.default_joint_pos.double().numpy()


def simulator() -> Simulator:
    made = Simulator(G1.model())
    made.reset(standing(G1))
    return made


def test_perfect_sensors_say_what_is_true():
    robot = simulator()
    sensors = SimulatedSensors(robot)
    last = [sensors.step(TARGET) for _ in range(30)][-1][-1]
    state = robot.state()
    np.testing.assert_array_equal(last.joint_pos, state.joint_pos)
    np.testing.assert_array_equal(last.joint_vel, state.joint_vel)
    np.testing.assert_array_equal(last.gyro, state.root_ang_vel_b)
    np.testing.assert_array_equal(last.torque, robot.data.actuator_force)


def test_the_accelerometer_integrates_to_the_velocity():
    robot = simulator()
    robot.data.qpos[2] += 1.0  # it falls
    sensors = SimulatedSensors(robot)
    falls = sensors.step(TARGET)
    assert all(np.abs(reading.acceleration).max() < 1.0 for reading in falls)
    np.testing.assert_allclose(SimulatedSensors(simulator()).read().acceleration, [0, 0, 9.81])


def test_steps_are_those_of_the_simulator():
    ours, plain = simulator(), simulator()
    SimulatedSensors(ours, SensorNoise()).step(TARGET + 0.1)
    plain.step(TARGET + 0.1)
    np.testing.assert_array_equal(ours.data.qpos, plain.data.qpos)


def test_noise_and_biases_have_their_sizes():
    robot = simulator()
    sensors = SimulatedSensors(robot, SensorNoise(joint_pos=0.01, encoder_bias=0.1), seed=1)
    readings = np.array([sensors.read().joint_pos for _ in range(300)]) - robot.data.qpos[7:]
    np.testing.assert_allclose(readings.std(0).mean(), 0.01, rtol=0.05)
    assert 0.06 < readings.mean(0).std() < 0.14
    sensors.reset()
    assert np.abs(sensors.read().joint_pos - readings[0] - robot.data.qpos[7:]).max() > 0.05


def test_targets_that_are_not_finite_are_refused():
    with pytest.raises(ActionError, match="the target of joint"):
        SimulatedSensors(simulator()).step(np.full(29, np.nan))
