"""Reader of each file ending: the one place where formats and retargeting are both known."""

from collections.abc import Callable
from pathlib import Path

from plat.motions.formats import MotionFile, ReadOptions, read_csv, read_npy, read_npz, read_pickle
from plat.motions.formats.root_turn import refuse_other_turns
from plat.motions.retargeting.joint_file import holds_human_joints
from plat.motions.retargeting.reader import read_human_motion

__all__ = ["NAMED", "READERS"]


Reader = Callable[[Path, ReadOptions], MotionFile]


def _of_robot(read: Reader) -> Reader:
    """Return a reader of a robot's motions that refuses what stands only with its root's quaternions read otherwise."""

    def checked(path: Path, options: ReadOptions) -> MotionFile:
        file = read(path, options)
        if options.quat_order is None:
            refuse_other_turns(file.clips, options.soles)
        return file

    return checked


def _read_archive(path: Path, options: ReadOptions) -> MotionFile:
    """Read an ``.npz``: joint positions of a human are retargeted, all else is a robot's."""
    return read_human_motion(path, options) if holds_human_joints(path) else _of_robot(read_npz)(path, options)


READERS: dict[str, Reader] = {
    ".npz": _read_archive,
    ".csv": _of_robot(read_csv),
    ".tsv": _of_robot(read_csv),
    ".npy": _of_robot(read_npy),
    ".pkl": _of_robot(read_pickle),
    ".pickle": _of_robot(read_pickle),
    ".joblib": _of_robot(read_pickle),
    ".bvh": read_human_motion,
    ".amc": read_human_motion,
}
"""What reads a file, by its ending in small letters."""

NAMED = (".txt",)
"""Endings of files that are read where they are named, and not looked for in folders: any text has them."""

READERS |= dict.fromkeys(NAMED, _of_robot(read_csv))
