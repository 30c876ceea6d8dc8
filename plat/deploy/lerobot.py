"""Controller for LeRobot's Unitree G1, by the interface of its locomotion controllers; LeRobot itself is not needed."""

import threading
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plat.bounds import Positive, check_value
from plat.deploy.estimator import StateEstimator
from plat.deploy.runner import JointCommand
from plat.deploy.safety import CommandSource, Journal, MotorPolicy, OnboardController, OnboardReading
from plat.deploy.safety.settings import SafetySettings
from plat.deploy.state import Pose

__all__ = ["LeRobotController", "lerobot_motor"]


def lerobot_motor(joint: str) -> str:
    """Return LeRobot's name of the motor of a joint.

    >>> lerobot_motor("left_hip_pitch_joint")
    'kLeftHipPitch'
    """
    return "k" + joint.removesuffix("_joint").title().replace("_", "")


class LeRobotController:
    """Controller of keyframes for ``lerobot.robots.unitree_g1.UnitreeG1``: the interface of its locomotion controllers.

    It moves all joints, arms too. Give it to the robot before it connects: ``robot.controller = controller``. LeRobot
    calls :meth:`run_step` in a thread of its own, every :attr:`control_dt` seconds, with the newest low state.

    Args:
        policy: such as :class:`plat.deploy.PolicyRunner`.
        source: what commands keyframes: a sequence, or a :class:`plat.keyframes.KeyframeQueue`.
        settings: of the last line of defense.
        anchor: pose that the robot is taken to stand in when the policy begins; None for the origin.
        imu_pos: the IMU's place in the root's frame ``[3]`` (m).
        stop_key: entry of the action that stops the robot when it is not 0, such as a button of the remote.
        control_dt: seconds between calls; readings are taken at this rate, the policy runs at its own.
        clock: time (s).

    Attributes:
        kp: stiffness that LeRobot sends with the newest targets ``[J]`` (N m/rad).
        kd: damping likewise ``[J]`` (N m s/rad).

    >>> LeRobotController.run_step.__annotations__["return"]
    dict[str, float]
    """

    kp: NDArray[np.float64]
    kd: NDArray[np.float64]

    def __init__(
        self,
        policy: MotorPolicy,
        source: CommandSource,
        settings: SafetySettings = SafetySettings(),
        anchor: Pose | None = None,
        imu_pos: tuple[float, float, float] = (0.04525, 0.0, -0.08339),
        stop_key: str | None = None,
        control_dt: float = 0.005,
        clock: Callable[[], float] = time.monotonic,
    ):
        robot = policy.robot
        estimator = StateEstimator(robot, imu_pos=imu_pos)
        self._onboard = OnboardController(policy, source, settings, estimator, anchor)
        self._joints = len(robot.joint_names)
        self._keys = [f"{lerobot_motor(joint)}.q" for joint in robot.joint_names]
        check_value("control_dt", control_dt, Positive)
        self._stop_key, self._clock = stop_key, clock
        self._damping = settings.damping * robot.damping
        self.control_dt = control_dt
        self._lock = threading.RLock()
        self.reset()

    @property
    def mode(self) -> str:
        """Return what the controller does now, see :class:`plat.deploy.safety.OnboardController`."""
        return self._onboard.mode

    @property
    def journal(self) -> Journal:
        """Return why and when a piece stepped in."""
        return self._onboard.journal

    def elapsed(self) -> float:
        """Return the time of the source's commands (s): what :meth:`plat.keyframes.KeyframeQueue.put` needs."""
        return self._onboard.elapsed(self._clock())

    def reset(self) -> None:
        """Begin anew: the robot has to stand still, then it ramps."""
        with self._lock:  # not within a step of LeRobot's thread, which would set its gains afterwards
            self._onboard.reset()
            self._targets: NDArray[np.float64] | None = None
            # until something is known motors are braked
            self.kp, self.kd = np.zeros(self._joints), self._damping.copy()

    def run_step(self, action: Mapping[str, Any], lowstate: Any) -> dict[str, float]:
        """Return targets by LeRobot's names (rad), and set the gains that go with them.

        Args:
            action: what LeRobot's teleoperator says; only the key that stops is read.
            lowstate: with ``motor_state`` and ``imu_state`` as LeRobot fills them; None when none came.
        """
        with self._lock:
            if self._stop_key is not None and action.get(self._stop_key) and self.mode != "damping":
                # sent at once: the next control step may not be due yet
                command: JointCommand | None = self._onboard.stop(f"{self._stop_key} was pressed")
            else:
                command = self._onboard.step(self._clock(), self._reading(lowstate))
            if command is not None:
                self._targets, self.kp, self.kd = command
            if self._targets is None:
                return {}
            return dict(zip(self._keys, self._targets.tolist(), strict=True))

    def _reading(self, lowstate: Any) -> OnboardReading | None:
        try:
            motors, imu = lowstate.motor_state[: self._joints], lowstate.imu_state
            return OnboardReading(
                joint_pos=_floats(motor.q for motor in motors),
                joint_vel=_floats(motor.dq for motor in motors),
                gyro=_floats(imu.gyroscope),
                acceleration=_floats(imu.accelerometer),
                torque=_floats(motor.tau_est for motor in motors),
                temperature=_floats(np.max(motor.temperature) for motor in motors),
            )
        except (AttributeError, TypeError, ValueError):  # fields are None before the first message
            return None


def _floats(values: Any) -> NDArray[np.float64]:
    return np.array([float(value) for value in values])
