"""Kinematic checks of motions, and repairs of what they find."""

from typing import TYPE_CHECKING

from plat.lazy import lazy

if TYPE_CHECKING:
    from plat.motions.checks.jumps import cut_motion
    from plat.motions.checks.mending import Mended, mend_motion
    from plat.motions.checks.repair import clip_to_limits, ground_feet, level_feet, trim_motion
    from plat.motions.checks.settings import ValidationLimits
    from plat.motions.checks.steps import joint_steps, smooth_steps
    from plat.motions.checks.validation import MotionReport, validate_motion, validate_motions
else:
    lazy(__name__)

__all__ = [
    "Mended",
    "MotionReport",
    "ValidationLimits",
    "clip_to_limits",
    "cut_motion",
    "ground_feet",
    "joint_steps",
    "level_feet",
    "mend_motion",
    "smooth_steps",
    "trim_motion",
    "validate_motion",
    "validate_motions",
]
