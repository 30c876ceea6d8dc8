"""Safe runner: a policy behind a watchdog, stops and limits."""

from collections.abc import Callable
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from plat.bounds import check_value, is_finite, shown
from plat.deploy.description import RobotDescription
from plat.deploy.runner import JointCommand
from plat.deploy.safety.ending import CommandSource, EndOfSequence
from plat.deploy.safety.followable import FollowableCommands
from plat.deploy.safety.journal import Journal
from plat.deploy.safety.limits import TargetLimiter
from plat.deploy.safety.ramp import Ramp
from plat.deploy.safety.settings import SafetySettings
from plat.deploy.safety.stops import stop_reason
from plat.deploy.safety.watch import StateWatch
from plat.deploy.state import Array, Pose, RobotState, finite_vector
from plat.errors import KeyframeError, PlatError
from plat.json_file import short
from plat.spec.timing import Timing
from plat.words import counted

__all__ = ["MotorPolicy", "SafeRunner"]

Mode = Literal["wait", "ramp", "run", "end", "damping"]


_TOO_FEW = 0.8  # share of the control steps of a second below which the policy is not run as it was trained


class MotorPolicy(Protocol):
    """Protocol of a policy that drives motors; :class:`plat.deploy.PolicyRunner` is one."""

    @property
    def robot(self) -> RobotDescription:
        """Return the robot that it drives."""

    @property
    def timing(self) -> Timing:
        """Return its control step, longest command and arrival window."""

    def reset(self, joint_target: Array | None = None) -> None:
        """Start anew; the motors hold ``joint_target``."""

    def __call__(self, state: RobotState, keyframe: Pose, steps_left: float) -> NDArray[np.float64]:
        """Return joint position targets ``[J]`` (rad)."""


class SafeRunner:
    """Runner of a policy on a robot with a last line of defense. :meth:`step` never raises for what it is given.

    Modes, in order: ``"wait"`` for a first good state, motors damped; ``"ramp"`` from the pose that the robot is found
    in to the start pose; ``"run"`` the policy; ``"end"``: hold the last keyframe, then stand. ``"damping"`` lasts until
    :meth:`reset`: no stiffness, joints braked.

    :meth:`stop` and :meth:`reset` may come at any time, also within a step: from a signal handler, another thread, or a
    hook. No stop is lost that comes after a reset began. A command that the policy cannot follow is as if it had not
    been given.

    Args:
        policy: what computes targets.
        source: what commands keyframes; its time begins with ``"run"``.
        settings: of all pieces.
        start: joint angles that the ramp ends in ``[J]`` (rad); None for the default pose.
        temperatures: returns the temperatures of the motors ``[J]`` (°C).
        on_start: called with a state before ``"run"`` begins, for example to anchor an estimator; the state that it
            returns takes that one's place. Until it succeeds the end of the ramp is held.

    Attributes:
        journal: why and when it stepped in.

    Raises:
        PlatError: when the policy cannot follow the source: other control steps, commands that are too long, or partial
            keyframes for a policy that was trained on whole poses. Also for keyframes of another robot, and
            arguments of another kind.
    """

    def __init__(
        self,
        policy: MotorPolicy,
        source: CommandSource,
        settings: SafetySettings = SafetySettings(),
        start: Array | None = None,
        temperatures: Callable[[], Array] | None = None,
        on_start: Callable[[RobotState], RobotState | None] | None = None,
    ):
        if not hasattr(policy, "robot") or not callable(policy):
            raise PlatError(f"policy is {short(policy)}, expected one with its robot, such as a PolicyRunner")
        if not callable(getattr(source, "command", None)):
            told = "expected what commands keyframes, such as a KeyframeSequence or a KeyframeQueue"
            raise KeyframeError(f"source is {short(source)}, {told}")
        check_value("settings", settings, SafetySettings)
        self._policy, self._settings = policy, settings
        self._robot = policy.robot
        timing = Timing(self._robot.control_dt, policy.timing.max_steps)
        sees_parts = getattr(policy, "sees_parts", True)
        self._source = FollowableCommands(source, timing, sees_parts, self._refused, self._robot)
        angles = self._robot.default_joint_pos if start is None else start
        self._start = finite_vector("start", angles, len(self._robot.joint_names))
        for name, hook in (("temperatures", temperatures), ("on_start", on_start)):
            if hook is not None and not callable(hook):
                raise PlatError(f"{name} is {short(hook)}, expected a function")
        self._temperatures, self._on_start = temperatures, on_start
        self._limiter = TargetLimiter(self._robot, settings)
        self._watch = StateWatch(self._robot, settings)
        self.journal = Journal()
        # a stop is an object of its own: a reset takes back the last one that it saw, and never one that came since
        self._last_stop: object = None
        self._taken_back: object = None
        self._anew = False
        self._forget()

    def reset(self, *, keep_stop: bool = False) -> None:
        """Begin anew: wait for a good state, then ramp. A step that it comes in the middle of brakes.

        Args:
            keep_stop: stay in damping mode after a stop.
        """
        seen = self._last_stop
        self._anew = True  # the next step forgets: what a step works with is changed by steps alone
        if not keep_stop:
            self._taken_back = seen

    def _forget(self) -> None:
        self._mode: Mode = "wait"
        self._watch.reset()
        self._commands = EndOfSequence(self._source, self._robot, self._policy.timing.max_steps, self._settings)
        self._now: float | None = None
        self._timeless = 0  # steps in a row
        self._began = 0.0
        self._ramp: Ramp | None = None

    @property
    def mode(self) -> Mode:
        """Return what it does now."""
        # not kept in one place: a step that a stop or a reset interrupts may still set the mode
        return "damping" if self._stopped else "wait" if self._anew else self._mode

    @property
    def _stopped(self) -> bool:
        return self._last_stop is not self._taken_back

    def elapsed(self, now: float) -> float:
        """Return the time of the source's commands at a time of the clock (s); 0 before ``"run"`` began."""
        return now - self._began if self.mode in ("run", "end") else 0.0

    def stop(self, reason: str = "asked for") -> JointCommand:
        """Go to damping mode and return its command: an emergency stop."""
        now = self._now
        return self._damp(0.0 if now is None else now, "stop", reason)

    def step(self, now: float, state: RobotState | None, stamp: float | None = None) -> JointCommand:
        """Return what the motors are to do in this control step.

        Args:
            now: time (s) of a clock that does not jump.
            state: newest measured state; None when none came.
            stamp: time of its measurement (s), same clock; None for ``now``.
        """
        if self._anew:
            self._anew = False
            self._forget()
        command = self._step(now, state, stamp)
        # a stop or a reset may have come while it was computed
        return self.damped() if self._stopped or self._anew else command

    def _step(self, now: float, state: RobotState | None, stamp: float | None) -> JointCommand:
        if not is_finite(now):
            return self._without_time(now)
        self._timeless = 0
        dt = self._robot.control_dt if self._now is None else min(max(now - self._now, 0.0), self._robot.control_dt)
        self._now = now
        fault = self._watch.check(now, state, stamp)
        if fault is not None:
            self.journal.note(now, "watchdog", fault)
        made, expected = self._watch.checks(now), round(1.0 / self._robot.control_dt)
        if made is not None and made < _TOO_FEW * expected:
            self.journal.note(now, "clock", f"{counted(made, 'control step')} in the last second, expected {expected}")
        if self.mode == "wait" and fault is None:
            self._begin(now)
        if self.mode in ("wait", "damping"):
            return self.damped()
        if self._watch.age(now) > self._settings.missing:
            return self._damp(now, "watchdog", f"no good state for {self._watch.age(now):.2f} s")
        if self._watch.bad_share > self._settings.doubt:
            return self._damp(
                now, "watchdog", f"{100 * self._watch.bad_share:.0f} % of the last second's states are bad"
            )
        if fault is not None:
            return self._held()
        good = self._watch.good
        assert good is not None  # no fault
        if (stop := stop_reason(self._robot, good, self._settings, self._read_temperatures(now))) is not None:
            return self._damp(now, *stop)
        target, reasons = self._limiter(self._target(now, good), good, dt)
        for piece, reason in reasons.items():
            self.journal.note(now, piece, reason)
        return self._stiff(target)

    def _without_time(self, now: object) -> JointCommand:
        """Hold the last targets; damp where that goes on, for no watchdog and no stop sees anything meanwhile."""
        last, told = 0.0 if self._now is None else self._now, f"time is {shown(now)}"
        self.journal.note(last, "clock", told)
        self._timeless += 1
        too_long = self._timeless * self._robot.control_dt > self._settings.missing
        if too_long and self.mode not in ("wait", "damping"):
            return self._damp(last, "clock", f"{told}, {self._timeless} steps in a row")
        return self._held()

    def _begin(self, now: float) -> None:
        good = self._watch.good
        assert good is not None
        self._limiter.reset(good.joint_pos)
        self._ramp, self._began, self._mode = Ramp(self._limiter.last, self._start, self._settings.ramp), now, "ramp"

    def _target(self, now: float, state: RobotState) -> Array:
        """Return what is asked for before limits ``[J]`` (rad)."""
        assert self._ramp is not None
        if self._mode == "ramp":
            elapsed = now - self._began
            if elapsed < self._ramp.seconds:
                return self._ramp(elapsed)
        try:
            if self._mode == "ramp":
                self._policy.reset(self._limiter.last)
                if self._on_start is not None:
                    # the keyframes' world may have moved under the robot
                    state = self._on_start(state) or state
                self._mode, self._began = "run", now  # last: what fails is tried again in the next step
            command = self._commands.command(now - self._began, state)
            if self._commands.ended and self._mode == "run":
                self._mode = "end"
                self.journal.note(now, "end", "nothing more is commanded: hold the last keyframe, then stand")
            elif not self._commands.ended:
                self._mode = "run"
            return self._policy(state, command.keyframe, command.steps_left)
        except Exception as error:  # policy, source and hook may be programs of the user's own
            told = str(error) if isinstance(error, PlatError) else f"{type(error).__name__}: {error}"
            self.journal.note(now, "policy", told)
            return self._limiter.last

    def _read_temperatures(self, now: float) -> Array | None:
        if self._temperatures is None:
            return None
        try:
            return np.asarray(self._temperatures(), dtype=np.float64).reshape(-1)
        except Exception as error:  # a program of the user's own; the robot must not fall for it
            self.journal.note(now, "temperature", f"cannot be read ({type(error).__name__}: {error})")
            return None

    def _refused(self, reason: str) -> None:
        self.journal.note(0.0 if self._now is None else self._now, "commands", reason)

    def _damp(self, now: float, piece: str, reason: str) -> JointCommand:
        before, self._last_stop = self._stopped, object()  # first: a program of the user's own may listen to the log
        if not before:
            self.journal.note(now, piece, f"{reason}: damping mode", new=True)
        return self.damped()

    def _held(self) -> JointCommand:
        if self.mode in ("wait", "damping"):
            return self.damped()
        return self._stiff(self._limiter.last.copy())

    def _stiff(self, target: NDArray[np.float64]) -> JointCommand:
        return JointCommand(target, self._robot.stiffness.copy(), self._robot.damping.copy())

    def damped(self) -> JointCommand:
        """Return the command of damping mode; the mode stays what it is."""
        # without stiffness a target has no effect; it is one within the range all the same
        damping = self._settings.damping * self._robot.damping
        return JointCommand(self._limiter.last.copy(), np.zeros_like(damping), damping)
