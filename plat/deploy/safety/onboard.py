"""Onboard controller: sensor readings in, motor commands out."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from plat.bounds import is_finite
from plat.deploy.estimator import StateEstimator
from plat.deploy.runner import JointCommand
from plat.deploy.safety.ending import CommandSource
from plat.deploy.safety.journal import Journal
from plat.deploy.safety.safe_runner import MotorPolicy, SafeRunner
from plat.deploy.safety.settings import SafetySettings
from plat.deploy.state import Array, Pose, RobotState, root_of
from plat.errors import PlatError, StateError
from plat.json_file import short

__all__ = ["OnboardController", "OnboardReading"]

_SWAY = 0.1  # rad and rad/s, standard deviation of joint angles and gyroscope: more is no noise
_NEVER_STILL = ("gyro", "acceleration")  # their noise moves the last digits; encoders of a robot at rest may not change
_LONGEST_GAP = 0.5  # s: what the estimator bridges when readings were lost
# what numpy says of numbers that are none, of lists of lists, and of equations that wild numbers lead to
_FAULTS = (PlatError, ValueError, TypeError, AttributeError, np.linalg.LinAlgError)


@dataclass
class OnboardReading:
    """Reading of a robot's sensors at one moment. Joints are in the order of ``RobotDescription.joint_names``."""

    joint_pos: Array
    """joint angles ``[J]`` (rad)"""
    joint_vel: Array
    """joint velocities ``[J]`` (rad/s)"""
    gyro: Array
    """angular velocity ``[3]`` (rad/s, IMU)"""
    acceleration: Array
    """specific force ``[3]`` (m/s², IMU): 9.81 upward at rest"""
    torque: Array | None = None
    """joint torques ``[J]`` (N m); None where motors do not report them"""
    temperature: Array | None = None
    """temperatures of the motors ``[J]`` (°C); None where they are not known"""


class OnboardController:
    """Controller of a robot from its sensors: state estimator, policy and last line of defense, together.

    The robot must stand or hang still at first: tilt and bias of the gyroscope are measured then. It ramps to the start
    pose, and the keyframes' world is anchored at the robot when the policy begins. :meth:`step` never raises, whatever
    its input. :meth:`stop` and :meth:`reset` may be called at any time, as those of
    :class:`plat.deploy.safety.SafeRunner`.

    Args:
        policy: what computes targets.
        source: what commands keyframes, such as :class:`plat.keyframes.KeyframeSequence`.
        settings: of all pieces.
        estimator: with the place of the IMU; None for one at the root.
        anchor: pose that the robot is taken to stand in when the policy begins, by position and heading, such as the
            sequence's start; None to leave it at the origin.

    Raises:
        PlatError: when the policy cannot follow the source, see :class:`plat.deploy.safety.SafeRunner`.

    >>> from plat.keyframes import KeyframeSequence, standing
    >>> from plat.robots import G1, describe_robot
    >>> from types import SimpleNamespace
    >>> robot, pose = describe_robot(G1, control_dt=0.02), standing(G1)
    >>> class Stand:
    ...     robot, timing = robot, SimpleNamespace(max_steps=50)
    ...     def reset(self, joint_target=None): ...
    ...     def __call__(self, state, keyframe, steps_left): return keyframe.joint_pos
    >>> controller = OnboardController(Stand(), KeyframeSequence(G1, pose, (pose.at(1.0),)), anchor=pose)
    >>> noise, command = np.random.default_rng(0), None
    >>> for tick in range(300):  # at 200 Hz
    ...     gyro, force = 0.01 * noise.standard_normal(3), np.array([0.0, 0.0, 9.81 + 0.01 * noise.standard_normal()])
    ...     reading = OnboardReading(robot.default_joint_pos, np.zeros(29), gyro, force)
    ...     command = controller.step(0.005 * tick, reading) or command
    >>> controller.mode, command.position.shape
    ('ramp', (29,))
    """

    def __init__(
        self,
        policy: MotorPolicy,
        source: CommandSource,
        settings: SafetySettings = SafetySettings(),
        estimator: StateEstimator | None = None,
        anchor: Pose | None = None,
    ):
        self._safe = SafeRunner(policy, source, settings, temperatures=self._temperatures, on_start=self._start)
        self._robot, self._settings = policy.robot, settings
        if not callable(getattr(estimator, "update", None)) and estimator is not None:
            raise PlatError(f"estimator is {short(estimator)}, expected a StateEstimator")
        self._estimator = estimator or StateEstimator(policy.robot)
        if anchor is not None:
            root_of("anchor", anchor)
        self._anchor = anchor
        self._anew = False
        self._commanded = False
        self._forget()

    @property
    def mode(self) -> str:
        """Return what the safe runner does now; ``"settle"`` before the robot stood still."""
        mode = self._safe.mode
        return "settle" if mode == "wait" and (self._anew or self._state is None) else mode

    @property
    def journal(self) -> Journal:
        """Return why and when a piece stepped in."""
        return self._safe.journal

    @property
    def state(self) -> RobotState | None:
        """Return the newest estimate; None before the robot stood still."""
        return None if self._anew else self._state

    def elapsed(self, now: float) -> float:
        """Return the time of the source's commands (s), see :meth:`SafeRunner.elapsed`."""
        return self._safe.elapsed(now)

    def reset(self) -> None:
        """Begin anew: motors are braked until the robot stands still, then it ramps."""
        self._anew = True  # first: a step that uses up the other one's mark leaves this one for the next
        self._safe.reset()

    def _forget(self) -> None:
        self._state: RobotState | None = None
        self._still: list[tuple[NDArray[np.float64], ...]] = []
        self._settling = np.nan
        self._time = self._sent = self._heard = self._due = -np.inf
        self._fresh = False
        self._hot = np.empty(0)
        self._changed: dict[str, tuple[bytes, float]] = {}

    def stop(self, reason: str = "asked for") -> JointCommand:
        """Go to damping mode and return its command: an emergency stop."""
        return self._safe.stop(reason)

    def step(self, now: float, reading: OnboardReading | None) -> JointCommand | None:
        """Take a reading; return what the motors are to do when a control step is due, otherwise None.

        Call it with every reading, at the rate of the sensors, and with None when none came for a control step.

        Args:
            now: time (s) at which it was read, by a clock that does not jump: the robot's, or this computer's.
            reading: of the sensors; None when none came.
        """
        if self._anew:
            self._anew = False
            self._forget()
            self._safe.reset(keep_stop=True)
        now = now if is_finite(now) else np.nan
        try:
            self._take(now, reading)
        except _FAULTS as error:
            self.journal.note(now if np.isfinite(now) else 0.0, "sensors", str(error))
        settling = self._state is None and self._safe.mode != "damping"
        period, heard, self._heard = self._robot.control_dt, self._heard, now
        # a step is due at the reading that is nearest to its time: none comes when it should
        early = 0.5 * min(now - heard, period)
        # motors that were told something hold it until they are told something else
        if (settling and not self._commanded) or self._sent <= now < self._due - early:
            return None
        # times do not count from the step before, or its delay would add to all that follow
        self._due = (self._due if abs(now - self._due) <= 0.5 * period else now) + period
        self._sent, self._commanded = now, True
        if settling:
            return self._safe.damped()
        state, self._fresh = (self._state if self._fresh else None), False
        command = self._safe.step(now, state, self._time)
        # after a reset within this step nothing is known: not even that the estimate is that of a robot at rest
        return self._safe.damped() if self._anew else command

    def _take(self, now: float, reading: OnboardReading | None) -> None:
        """Bring the estimate up to date.

        Raises:
            StateError: naming what no sensor reads; the estimate is as before.
        """
        if reading is None:
            raise StateError("no reading")
        if not np.isfinite(now) or now <= self._time:
            raise StateError(f"the reading of {now:.6g} s came after that of {self._time:.6g} s")
        self._check(now, reading)
        sensed = (reading.joint_pos, reading.joint_vel, reading.gyro, reading.acceleration)
        if self._state is None:
            self._settle(now, reading)
        else:
            dt = min(now - self._time, _LONGEST_GAP)
            self._state = self._estimator.update(*sensed, dt, reading.torque)
            if self._safe.mode in ("wait", "ramp") and not self._estimator.contacts.any():
                self._state = self._estimator.hang(dt)  # nothing balances yet: it would fall if nobody held it
            self._time, self._fresh = now, True
        if reading.temperature is not None:
            self._hot = np.asarray(reading.temperature, dtype=np.float64)

    def _check(self, now: float, reading: OnboardReading) -> None:
        limits, joints = self._settings, len(self._robot.joint_names)
        sizes = {"joint_pos": joints, "joint_vel": joints, "gyro": 3, "acceleration": 3, "torque": joints}
        most = {"joint_vel": limits.joint_speed, "gyro": limits.turn_speed, "acceleration": limits.acceleration}
        numbers = {"": b""}
        for field in fields(OnboardReading):
            name = field.name
            values = getattr(reading, name)
            if name == "temperature" or (name == "torque" and values is None):
                continue
            values = np.asarray(values, dtype=np.float64)  # None is a number without axes
            if values.shape != (sizes[name],) or not np.isfinite(values).all():
                raise StateError(f"{name}: expected {sizes[name]} finite numbers")
            if name in most and (largest := float(np.abs(values).max())) > most[name]:
                raise StateError(f"{name} of {largest:.3g}, at most {most[name]:g} is plausible")
            numbers[""] += values.tobytes()
            if name in _NEVER_STILL:
                numbers[name] = values.tobytes()
        # the estimate moves while sensors are frozen, so its watchdog would not notice
        for name, read in numbers.items():
            before, changed = self._changed.get(name, (b"", np.inf))
            if read != before or now < changed:
                self._changed[name] = read, now
            elif now - changed > limits.frozen * self._robot.control_dt:
                raise StateError(f"{name or 'all'}: the same numbers for {now - changed:.2f} s: frozen sensors")

    def _settle(self, now: float, reading: OnboardReading) -> None:
        """Gather readings of a robot at rest; begin the estimate after some time."""
        if not self._still or now < self._settling:
            self._still.clear()
            self._settling = now
        sensed = (reading.joint_pos, reading.gyro, reading.acceleration)
        self._still.append(tuple(np.asarray(values, dtype=np.float64) for values in sensed))
        if now - self._settling < self._settings.settle:
            return
        gathered = [np.array(values) for values in zip(*self._still, strict=True)]
        joint_pos, gyro, acceleration = (values.mean(0) for values in gathered)
        sway = max(float(values.std(0).max()) for values in gathered[:2])
        self._still.clear()  # a robot that is found moving has to stand still for as long again
        if sway > _SWAY:
            raise StateError(f"it sways by {sway:.2g} rad or rad/s about the mean, expected a robot that stands still")
        self._state = self._estimator.reset(joint_pos, gyro, acceleration)
        self._time, self._fresh = now, True

    def _start(self, state: RobotState) -> RobotState:
        if self._anchor is None:
            return state
        self._state = self._estimator.anchor(self._anchor)
        return self._state

    def _temperatures(self) -> Array:
        return self._hot
