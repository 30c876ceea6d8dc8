"""Reader of each file ending: the one place where formats and retargeting are both known."""

from collections.abc import Callable
from pathlib import Path

from plat.motions.formats import MotionFile, ReadOptions, read_csv, read_npy, read_npz, read_pickle
from plat.motions.retargeting.joint_file import holds_human_joints
from plat.motions.retargeting.reader import read_human_motion

__all__ = ["NAMED", "READERS"]


def _read_archive(path: Path, options: ReadOptions) -> MotionFile:
    """Read an ``.npz``: joint positions of a human are retargeted, all else is a robot's."""
    return read_human_motion(path, options) if holds_human_joints(path) else read_npz(path, options)


READERS: dict[str, Callable[[Path, ReadOptions], MotionFile]] = {
    ".npz": _read_archive,
    ".csv": read_csv,
    ".tsv": read_csv,
    ".npy": read_npy,
    ".pkl": read_pickle,
    ".pickle": read_pickle,
    ".joblib": read_pickle,
    ".bvh": read_human_motion,
    ".amc": read_human_motion,
}
"""What reads a file, by its ending in small letters."""

NAMED = (".txt",)
"""Endings of files that are read where they are named, and not looked for in folders: any text has them."""

READERS |= dict.fromkeys(NAMED, read_csv)
