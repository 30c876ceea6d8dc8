"""Timing of the keyframe task: control step, longest command and arrival window."""

from dataclasses import dataclass
from typing import Annotated

from plat.bounds import Bounded, Range, is_finite, shown
from plat.errors import PlatError

__all__ = ["SOON", "Timing", "timing_of"]

SOON = 0.2
"""Seconds before a keyframe in which the group ``"clock"`` shows the time to it on a finer scale."""

LONGEST = 10_000
"""Most control steps of a command or an arrival window."""

SHORTEST_STEP, LONGEST_STEP = 0.001, 1.0
"""Least and most seconds of a control step."""


@dataclass(frozen=True)
class Timing(Bounded):
    """Time constants of the keyframe task. They belong to a policy: saved, exported and checked with it.

    Args:
        control_dt: seconds of a control step.
        max_steps: ``Delta_max``, the longest command in control steps; ``tau = steps_left / max_steps``.
        window: control steps of the arrival window, the arrival step among them.

    Raises:
        ConfigError: naming the field that makes no sense.

    >>> Timing().longest
    1.0
    >>> Timing(max_steps=150).steps(2.5)
    125
    """

    control_dt: Annotated[float, Range(SHORTEST_STEP, LONGEST_STEP)] = 0.02
    max_steps: Annotated[int, Range(1, LONGEST)] = 50
    window: Annotated[int, Range(1, LONGEST)] = 3

    @property
    def longest(self) -> float:
        """Return the length of the longest command (s), ``max_steps * control_dt``."""
        return self.max_steps * self.control_dt

    def steps(self, time: float) -> int:
        """Return the control step nearest to a time (s).

        Raises:
            PlatError: for a time that is not finite.
        """
        if not (is_finite(time) and is_finite(float(time) / self.control_dt)):
            raise PlatError(f"time is {shown(time)} s, expected a finite number")
        return round(float(time) / self.control_dt)  # an array without axes has no rounding

    def check_control_dt(self, control_dt: float, what: str) -> None:
        """Raise an error for a control step that differs from this timing's.

        Args:
            control_dt: seconds.
            what: has that control step; begins the message.

        Raises:
            PlatError: when the two differ.
        """
        if abs(control_dt - self.control_dt) > 1e-9:
            raise PlatError(f"{what}: control step of {control_dt:g} s, expected the policy's {self.control_dt:g} s")

    def check_steps(self, steps: int, what: str) -> None:
        """Raise an error for a command that is longer than the longest one.

        Args:
            steps: control steps of the command.
            what: has that length; begins the message.

        Raises:
            PlatError: when it is too long.
        """
        if steps > self.max_steps:
            raise PlatError(f"{what}: {steps} control steps, expected at most the policy's {self.max_steps}")


def timing_of(policy: object) -> Timing | None:
    """Return the timing that a policy carries in its attribute ``timing``, or that of its parts; None when it has none.

    Policies of :mod:`plat.modules`, what their views such as ``deployed()`` return, and
    :class:`plat.deploy.PolicyRunner` have one. A module around one of them has the same.

    Raises:
        PlatError: for a module without the attribute whose parts have different timings.
    """
    timing = getattr(policy, "timing", None)
    if isinstance(timing, Timing):
        return timing
    modules = getattr(policy, "modules", None)
    parts = dict.fromkeys(getattr(part, "timing", None) for part in modules()) if callable(modules) else {}
    found = [timing for timing in parts if isinstance(timing, Timing)]
    if len(found) > 1:
        raise PlatError(
            f"policy: a {type(policy).__name__} of parts with {found[0]} and {found[1]}; give it its own as an "
            "attribute 'timing'"
        )
    return found[0] if found else None
