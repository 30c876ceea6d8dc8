"""Limits of the checks, apart from them so that a command line can show them without torch."""

from dataclasses import dataclass

__all__ = ["ValidationLimits"]


@dataclass(frozen=True)
class ValidationLimits:
    """What a motion may have and still be used as it is, be repaired, or have to be dropped."""

    min_seconds: float = 0.5
    """shorter: drop"""
    joint_excess: float = 0.01
    """angle beyond a joint's limits (rad); more: repair, clip to the limits"""
    max_joint_excess: float = 0.5
    """the same (rad); more: drop, for clipped it would be another motion"""
    joint_speed: float = 35.0
    """fastest joint (rad/s); more: drop, for no motor of the G1 is that fast"""
    step_speed: float = 10.0
    """isolated single-frame step of a joint (rad/s); more: repair, smooth the steps"""
    penetration: float = 0.04
    """deepest sole point under the floor (m); more: repair, ground the feet"""
    floating: float = 0.02
    """height of the resting foot (m); more: repair, ground the feet"""
    slip: float = 1.0
    """horizontal speed of the feet in contact (m/s); more: drop"""
    self_penetration: float = 0.08
    """depth of two links inside each other (m); more: drop"""
    root_jump: float = 0.1
    """second difference of the root's path (m); more: trim near an end, else drop"""
    turn_jump: float = 0.5
    """break in the root's turning, the same way (rad)"""
    tempo: float = 1.6
    """step rate over or under that of people, as a factor; more: repair, state the frame rate"""
    trim_seconds: float = 0.5
    """how near to an end (s) a jump is trimmed away"""
