"""Motions: files, checks, repairs, resampling, the library, and the set that plat makes itself."""

from plat.envs.motions.clip import MotionClip
from plat.envs.motions.files import load_motions, motion_paths, read_motion_files, save_csv, save_motions
from plat.envs.motions.formats import MotionFile
from plat.envs.motions.generation import generate_motions
from plat.envs.motions.library import MotionLibrary, cache_dir

__all__ = [
    "MotionClip",
    "MotionFile",
    "MotionLibrary",
    "cache_dir",
    "generate_motions",
    "load_motions",
    "motion_paths",
    "read_motion_files",
    "save_csv",
    "save_motions",
]
