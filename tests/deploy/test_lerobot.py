"""The controller for LeRobot's G1, against a stand-in that calls it as LeRobot's robot does."""

import threading
from typing import Protocol, runtime_checkable

import numpy as np
import pytest

from plat.deploy.lerobot import LeRobotController, lerobot_motor
from plat.deploy.safety import SafetySettings
from tests.deploy.safety.stand_ins import DT, ROBOT, Commands, StandIn

# LeRobot's motors 0 to 28
LEG = ("HipPitch", "HipRoll", "HipYaw", "Knee", "AnklePitch", "AnkleRoll")
ARM = ("ShoulderPitch", "ShoulderRoll", "ShoulderYaw", "Elbow", "WristRoll", "WristPitch", "WristYaw")
MOTORS = [
    *(f"kLeft{name}" for name in LEG),
    *(f"kRight{name}" for name in LEG),
    *("kWaistYaw", "kWaistRoll", "kWaistPitch"),
    *(f"kLeft{name}" for name in ARM),
    *(f"kRight{name}" for name in ARM),
]
QUICK = SafetySettings(settle=0.1, ramp=0.2)


@runtime_checkable
class LocomotionController(Protocol):
    """What LeRobot's G1 asks of a controller."""

    control_dt: float

    def run_step(self, action: dict, lowstate) -> dict: ...

    def reset(self) -> None: ...


class Motor:
    def __init__(self):
        self.q = self.dq = self.tau_est = self.temperature = None


class Imu:
    quaternion = gyroscope = accelerometer = rpy = temperature = None


class LowState:
    """As LeRobot makes it: nothing is known at first."""

    def __init__(self):
        self.motor_state, self.imu_state = [Motor() for _ in range(29)], Imu()


class Robot:
    """LeRobot's robot: low states in, targets and the controller's gains out."""

    def __init__(self, controller: LocomotionController):
        self.controller, self.now, self.sent = controller, 0.0, []
        self._random = np.random.default_rng(0)
        self.action = {f"remote.button.{index}": 0.0 for index in range(16)}

    def measured(self, angles=ROBOT.default_joint_pos) -> LowState:
        state = LowState()
        for motor, angle in zip(state.motor_state, angles, strict=True):
            motor.q, motor.dq, motor.tau_est, motor.temperature = float(angle), 0.0, 0.0, [40, 35]
        noise = 0.01 * self._random.standard_normal(6)
        state.imu_state.gyroscope = noise[:3].tolist()
        state.imu_state.accelerometer = [noise[3], noise[4], 9.81 + noise[5]]
        return state

    def run(self, seconds: float, state=None) -> None:
        for _ in range(round(seconds / self.controller.control_dt)):
            targets = self.controller.run_step(dict(self.action), state or self.measured())
            self.sent.append((targets, self.controller.kp, self.controller.kd))
            self.now += self.controller.control_dt


@pytest.fixture
def robot() -> Robot:
    policy = StandIn(lambda state, keyframe, steps_left: keyframe.joint_pos + 0.01)
    controller = LeRobotController(policy, Commands(), QUICK, stop_key="remote.button.3", clock=lambda: robot.now)
    robot = Robot(controller)
    robot.policy = policy
    return robot


def test_it_has_the_interface(robot):
    assert isinstance(robot.controller, LocomotionController)
    assert [lerobot_motor(joint) for joint in ROBOT.joint_names] == MOTORS


def test_nothing_moves_before_anything_is_known(robot):
    robot.run(0.1, LowState())
    robot.controller.run_step({}, None)
    assert robot.sent == [({}, robot.controller.kp, robot.controller.kd)] * len(robot.sent)
    assert not robot.controller.kp.any()


def test_it_settles_ramps_and_runs(robot):
    robot.run(0.05)
    assert robot.controller.mode == "settle"
    robot.run(0.1)
    assert robot.controller.mode == "ramp"
    robot.run(0.3)
    assert robot.controller.mode == "run"
    targets, stiffness, damping = robot.sent[-1]
    assert list(targets) == [f"{name}.q" for name in MOTORS]
    np.testing.assert_allclose(list(targets.values()), ROBOT.default_joint_pos + 0.01)
    np.testing.assert_array_equal(stiffness, ROBOT.stiffness)
    np.testing.assert_array_equal(damping, ROBOT.damping)
    assert robot.controller.elapsed() > 0
    # the policy keeps its own rate
    asked = len(robot.policy.asked)
    robot.run(0.2)
    assert len(robot.policy.asked) - asked == round(0.2 / DT)


def test_the_button_brakes(robot):
    robot.run(0.6)
    robot.action["remote.button.3"] = 1.0
    robot.run(0.05)
    robot.action["remote.button.3"] = 0.0
    robot.run(0.05)
    assert robot.controller.mode == "damping"
    _, stiffness, damping = robot.sent[-1]
    assert not stiffness.any()
    np.testing.assert_array_equal(damping, ROBOT.damping)
    assert "remote.button.3" in list(robot.controller.journal)[-1].reason
    robot.controller.reset()
    assert robot.controller.mode == "settle"


@pytest.mark.parametrize("after", range(4))
def test_the_button_brakes_at_once(robot, after):
    """Also between two control steps, of four calls each."""
    robot.run(0.6 + 0.005 * after)
    assert robot.sent[-1][1].any()
    robot.action["remote.button.3"] = 1.0
    robot.run(0.005)
    assert not robot.sent[-1][1].any()


def test_a_reset_during_a_step_of_lerobots_thread_brakes(robot):
    robot.run(0.6)
    reset = threading.Thread(target=robot.controller.reset)

    def answer(state, keyframe, steps_left):
        if not reset.ident:
            reset.start()
            reset.join(0.05)  # time enough, if nothing holds it
        return keyframe.joint_pos

    robot.policy.answer = answer
    while not reset.ident:
        robot.run(0.005)
    reset.join()
    assert robot.controller.mode == "settle"
    assert not robot.controller.kp.any()
    np.testing.assert_array_equal(robot.controller.kd, ROBOT.damping)


def test_a_hot_motor_and_a_lost_connection_brake(robot):
    robot.run(0.6)
    hot = robot.measured()
    hot.motor_state[4].temperature = [95, 50]
    robot.run(0.02, hot)
    assert robot.controller.mode == "damping"
    assert [entry.piece for entry in robot.controller.journal][-1] == "temperature"
    robot.controller.reset()
    robot.run(0.6)
    robot.run(0.5, LowState())
    assert robot.controller.mode == "damping"
