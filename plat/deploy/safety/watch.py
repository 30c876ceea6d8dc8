"""Watchdog of measured states: plausible, new, and on time."""

from collections import deque

import numpy as np

from plat.bounds import is_finite, shown
from plat.deploy.description import RobotDescription
from plat.deploy.safety.settings import SafetySettings
from plat.deploy.state import Array, RobotState, state_widths
from plat.rotations_np import UNIT_TOLERANCE

__all__ = ["StateWatch"]

_MEMORY = 1.0  # s


class StateWatch:
    """Watchdog of states. It believes a state that a robot can be in, that moved on, and that is not old.

    Args:
        robot: sizes and ranges.
        settings: what is plausible and what is late.
    """

    def __init__(self, robot: RobotDescription, settings: SafetySettings = SafetySettings()):
        self._robot, self._settings = robot, settings
        self._sizes = state_widths(len(robot.joint_names))
        self._low = robot.joint_range[:, 0] - settings.range_excess
        self._high = robot.joint_range[:, 1] + settings.range_excess
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self.good: RobotState | None = None
        """Last state that was believed."""
        self.good_time = -np.inf
        """Its time (s)."""
        self._joint_pos: Array = np.empty(0)  # its own copy: programs may fill one state over and over
        self._newest = -np.inf
        self._values: bytes = b""
        self._equal = 0
        self._first = np.inf
        self._verdicts: deque[tuple[float, bool]] = deque()

    def check(self, now: float, state: RobotState | None, stamp: float | None = None) -> str | None:
        """Return why a state is not believed; None for a good one, which is then :attr:`good`.

        Args:
            now: time of the control step (s).
            state: as it was received; None when nothing was.
            stamp: time of its measurement (s), by the same clock; None for ``now``.
        """
        reason = self._fault(now, state, now if stamp is None else stamp)
        if reason is None and state is not None:
            self.good, self._joint_pos = state, state.joint_pos.copy()
        self._first = min(self._first, now)
        self._verdicts.append((now, reason is None))
        while self._verdicts and not 0 <= now - self._verdicts[0][0] <= _MEMORY:
            self._verdicts.popleft()
        return reason

    @property
    def bad_share(self) -> float:
        """Return the share of states of the last second that were not believed; 0 before ten of them came."""
        if len(self._verdicts) < 10:
            return 0.0
        return sum(not good for _, good in self._verdicts) / len(self._verdicts)

    def checks(self, now: float) -> int | None:
        """Return the number of states of the last second, believed or not; None before a second has passed."""
        return len(self._verdicts) if now - self._first >= _MEMORY else None

    def age(self, now: float) -> float:
        """Return the seconds since the measurement of the last good state."""
        return now - self.good_time

    def _fault(self, now: float, state: RobotState | None, stamp: float) -> str | None:
        if state is None:
            return "no state"
        if not is_finite(stamp) or stamp > now + self._settings.late:
            time = f"{stamp:.6g}" if is_finite(stamp) else shown(stamp)
            return f"the state's time is {time} s, the control step's {now:.6g} s"
        if stamp <= self._newest:
            return f"the state of {stamp:.6g} s came after that of {self._newest:.6g} s"
        if now - stamp > self._settings.late:
            return f"the state is {now - stamp:.3g} s old"
        fault = self._implausible(state, stamp)
        if fault is not None:
            return fault
        # of a state that is wrong in itself nothing is known, not even its time
        self._newest = stamp
        values = state.joint_pos.tobytes() + state.joint_vel.tobytes() + state.root_ang_vel_b.tobytes()
        self._equal = self._equal + 1 if values == self._values else 0
        self._values = values
        if self._equal >= self._settings.frozen - 1:
            return f"the same numbers {self._equal + 1} times: frozen sensors"
        self.good_time = stamp
        return None

    def _implausible(self, state: RobotState, stamp: float) -> str | None:
        """Return what no robot measures, in words."""
        limits = self._settings
        for name, size in self._sizes.items():
            values = getattr(state, name, None)  # whatever came in a state's place
            if not isinstance(values, np.ndarray) or values.shape != (size,) or values.dtype.kind != "f":
                return f"{name} is no array of {size} floats"
            if not np.isfinite(values).all():
                return f"{name} is not finite"
        if abs(float(np.abs(state.root_quat_w).max()) - 0.75) > 0.26:  # lengths cannot overflow then
            return "root_quat_w is no unit quaternion"
        if abs(float(np.linalg.norm(state.root_quat_w)) - 1.0) > UNIT_TOLERANCE:
            return "root_quat_w is no unit quaternion"
        outside = (state.joint_pos < self._low) | (state.joint_pos > self._high)
        if outside.any():
            joint = int(np.flatnonzero(outside)[0])
            return f"{self._robot.joint_names[joint]} at {state.joint_pos[joint]:.3g} rad, far outside its range"
        for name, most in (
            ("joint_vel", limits.joint_speed),
            ("root_lin_vel_b", limits.root_speed),
            ("root_ang_vel_b", limits.turn_speed),
        ):
            largest = float(np.abs(getattr(state, name)).max())
            if largest > most:
                return f"{name} of {largest:.3g}, at most {most:g} is plausible"
        if self.good is not None and 0 < stamp - self.good_time < _MEMORY:
            jump = float(np.abs(state.joint_pos - self._joint_pos).max())
            if jump > limits.joint_speed * (stamp - self.good_time):
                return f"a joint jumped by {jump:.3g} rad in {stamp - self.good_time:.3g} s"
        return None
