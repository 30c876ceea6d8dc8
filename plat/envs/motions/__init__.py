"""Motions: files, checks, repairs, resampling, the library, and the set that plat makes itself."""

from plat.envs.motions.clip import MotionClip
from plat.envs.motions.files import load_motions, motion_paths, read_motion_files, save_csv, save_motions
from plat.envs.motions.formats import MotionFile
from plat.envs.motions.generation import generate_motions
from plat.envs.motions.library import MotionLibrary, cache_dir
from plat.envs.motions.mirror import mirror_motion
from plat.envs.motions.repair import clip_to_limits, ground_feet, level_feet, trim_motion
from plat.envs.motions.validation import MotionReport, ValidationLimits, validate_motion, validate_motions

__all__ = [
    "MotionClip",
    "MotionFile",
    "MotionLibrary",
    "MotionReport",
    "ValidationLimits",
    "cache_dir",
    "clip_to_limits",
    "generate_motions",
    "ground_feet",
    "level_feet",
    "load_motions",
    "mirror_motion",
    "motion_paths",
    "read_motion_files",
    "save_csv",
    "save_motions",
    "trim_motion",
    "validate_motion",
    "validate_motions",
]
