"""Limits of the checks, apart from them so that a command line can show them without torch."""

from dataclasses import dataclass
from typing import Annotated, TypeAlias

from plat.bounds import Bounded, Range
from plat.errors import ConfigError

__all__ = ["ValidationLimits"]

Limit: TypeAlias = Annotated[float, Range(0, infinite=True)]
"""Threshold; infinity switches it off."""


@dataclass(frozen=True)
class ValidationLimits(Bounded):
    """What a motion may have and still be used as it is, be repaired, or have to be dropped."""

    min_seconds: Limit = 0.5
    """shorter: drop"""
    joint_excess: Limit = 0.01
    """angle beyond a joint's limits (rad); more: repair, clip to the limits"""
    max_joint_excess: Limit = 0.5
    """the same (rad); more: drop, because clipping would change the motion"""
    joint_speed: Limit = 35.0
    """fastest joint (rad/s); more: drop, because no motor of the G1 is that fast"""
    step_speed: Limit = 10.0
    """isolated single-frame step of a joint (rad/s); more: repair, smooth the steps"""
    penetration: Limit = 0.04
    """deepest sole point under the floor (m); more: repair, ground the feet"""
    floating: Limit = 0.02
    """height of the resting foot (m); more: repair, ground the feet"""
    slip: Limit = 1.0
    """horizontal speed of the feet in contact (m/s); more: drop"""
    self_penetration: Limit = 0.08
    """depth of two links inside each other (m); more: drop"""
    root_jump: Limit = 0.1
    """second difference of the root's path (m); more: trim near an end, else drop"""
    turn_jump: Limit = 0.5
    """break in the root's turning, the same way (rad)"""
    tempo: Annotated[float, Range(1, infinite=True)] = 1.6
    """step rate over or under that of people, as a factor; more: repair, state the frame rate"""
    gravity: Annotated[float, Range(1, infinite=True)] = 2.7
    """factor of falls over or under gravity; more: repair, state the frame rate"""
    trim_seconds: Limit = 0.5
    """how near to an end (s) a jump is trimmed away"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.joint_excess > self.max_joint_excess:
            raise ConfigError(
                f"ValidationLimits: joint_excess is {self.joint_excess:g} rad, "
                f"expected at most max_joint_excess, {self.max_joint_excess:g} rad"
            )
