"""Limits on joint targets: range, torque and rate."""

import numpy as np
from numpy.typing import NDArray

from plat.bounds import shown
from plat.deploy.description import RobotDescription
from plat.deploy.safety.settings import SafetySettings
from plat.deploy.state import Array, RobotState

__all__ = ["TargetLimiter"]

_Floats = NDArray[np.float64]


class TargetLimiter:
    """Limiter of joint position targets. Whatever it is given, what it returns is within range and rate.

    In order: a target that is not finite becomes the last one; what a motor's largest torque allows; the rate; the
    joint's range. Later limits win where they disagree: a motor limits its torque itself, a stop does not give way.

    Args:
        robot: ranges, gains and torques.
        settings: margins.

    >>> from plat.robots import G1, describe_robot
    >>> limiter = TargetLimiter(describe_robot(G1, control_dt=0.02))
    >>> start = limiter.robot.default_joint_pos
    >>> limiter.reset(start)
    >>> target, stepped_in = limiter(start + 10.0, None, dt=0.02)
    >>> sorted(stepped_in), bool((target <= limiter.high).all())
    (['range', 'rate'], True)
    """

    def __init__(self, robot: RobotDescription, settings: SafetySettings = SafetySettings()):
        self.robot = robot
        low, high = robot.joint_range.T
        margin = np.minimum(settings.range_margin, 0.5 * (high - low))
        self.low, self.high = low + margin, high - margin
        """Lowest and highest target of each joint ``[J]`` (rad)."""
        self._rate = settings.rate
        self._torque = settings.torque * robot.effort_limit
        self._stiffness, self._damping = robot.stiffness, robot.damping
        self.reset(robot.default_joint_pos)

    def reset(self, target: Array) -> None:
        """Set the last target ``[J]`` (rad); rates count from here."""
        start = np.asarray(target, dtype=np.float64)
        self.last = np.clip(np.where(np.isfinite(start), start, self.robot.default_joint_pos), self.low, self.high)
        """Last target ``[J]`` (rad)."""

    def torque_window(self, state: RobotState) -> tuple[_Floats, _Floats]:
        """Return the lowest and highest target ``[J]`` (rad) that ask for no more than the allowed torque."""
        with np.errstate(divide="ignore", invalid="ignore"):
            drag = self._damping * state.joint_vel
            low = state.joint_pos + (drag - self._torque) / self._stiffness
            high = state.joint_pos + (drag + self._torque) / self._stiffness
        # a motor without stiffness takes any target
        return np.where(np.isnan(low), -np.inf, low), np.where(np.isnan(high), np.inf, high)

    def __call__(self, target: Array, state: RobotState | None, dt: float) -> tuple[_Floats, dict[str, str]]:
        """Return the limited target ``[J]`` (rad), and why it differs: reason by name of the limit.

        Args:
            target: asked for ``[J]`` (rad).
            state: a plausible state of the robot; None skips the torque.
            dt: seconds since the last target.
        """
        reasons: dict[str, str] = {}
        try:
            asked, what = np.asarray(target, dtype=np.float64), ""
        except (TypeError, ValueError):
            asked, what = np.empty(0), f"{shown(target)}, which are no numbers"
        if asked.shape != self.last.shape:
            reasons["finite"] = f"targets {what or f'of shape {asked.shape}'}, expected {self.last.shape}"
            asked = self.last
        finite = np.isfinite(asked)
        if not finite.all():
            self._tell(reasons, "finite", ~finite, asked, "expected a finite angle")
        allowed = np.where(finite, asked, self.last)
        if state is not None:
            low, high = self.torque_window(state)
            allowed = self._clip(reasons, "torque", allowed, low, high)
        step = self._rate * max(dt, 0.0)
        allowed = self._clip(reasons, "rate", allowed, self.last - step, self.last + step)
        # against the asked target, too: a rate that hides a target out of range would hide the reason
        outside = (asked < self.low) | (asked > self.high)
        if outside.any():
            self._tell(reasons, "range", outside, asked, "is outside its range")
        self.last = np.clip(allowed, self.low, self.high)
        return self.last.copy(), reasons

    def _clip(self, reasons: dict[str, str], limit: str, target: _Floats, low: _Floats, high: _Floats) -> _Floats:
        clipped = np.clip(target, low, high)
        wrong = clipped != target
        if wrong.any():
            self._tell(reasons, limit, wrong, target, "expected {low:.3g} to {high:.3g}", low, high)
        return clipped

    def _tell(
        self,
        reasons: dict[str, str],
        limit: str,
        wrong: NDArray[np.bool_],
        target: _Floats,
        text: str,
        low: _Floats | None = None,
        high: _Floats | None = None,
    ) -> None:
        joint = int(np.flatnonzero(wrong)[0])
        if low is not None and high is not None:
            text = text.format(low=low[joint], high=high[joint])
        others = f" and {int(wrong.sum()) - 1} more" if wrong.sum() > 1 else ""
        reasons[limit] = f"{self.robot.joint_names[joint]}{others}: target {target[joint]:.3g} rad, {text}"
