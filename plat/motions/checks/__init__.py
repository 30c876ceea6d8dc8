"""Kinematic checks of motions, and repairs of what they find."""

from plat.motions.checks.repair import clip_to_limits, ground_feet, level_feet, trim_motion
from plat.motions.checks.validation import MotionReport, ValidationLimits, validate_motion, validate_motions

__all__ = [
    "MotionReport",
    "ValidationLimits",
    "clip_to_limits",
    "ground_feet",
    "level_feet",
    "trim_motion",
    "validate_motion",
    "validate_motions",
]
