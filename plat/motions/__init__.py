"""Motions: files, checks, repairs, resampling, the library, and the set that plat makes itself."""

from typing import TYPE_CHECKING

from plat.lazy import lazy

if TYPE_CHECKING:
    from plat.motions.checks.jumps import cut_motion
    from plat.motions.checks.mending import Mended, mend_motion
    from plat.motions.checks.repair import clip_to_limits, ground_feet, level_feet, trim_motion
    from plat.motions.checks.settings import ValidationLimits
    from plat.motions.checks.steps import joint_steps, smooth_steps
    from plat.motions.checks.validation import MotionReport, validate_motion, validate_motions
    from plat.motions.clip import MotionClip
    from plat.motions.files import load_motions, motion_paths, read_motion_files, save_csv, save_motions
    from plat.motions.formats import MotionFile
    from plat.motions.generation import generate_motions
    from plat.motions.library import MotionLibrary, cache_dir
    from plat.motions.mirror import mirror_motion
else:
    lazy(__name__)

__all__ = [
    "Mended",
    "MotionClip",
    "MotionFile",
    "MotionLibrary",
    "MotionReport",
    "ValidationLimits",
    "cache_dir",
    "clip_to_limits",
    "cut_motion",
    "generate_motions",
    "ground_feet",
    "joint_steps",
    "level_feet",
    "load_motions",
    "mend_motion",
    "mirror_motion",
    "motion_paths",
    "read_motion_files",
    "save_csv",
    "save_motions",
    "smooth_steps",
    "trim_motion",
    "validate_motion",
    "validate_motions",
]
