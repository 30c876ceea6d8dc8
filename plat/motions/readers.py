"""Reader of each file ending: the one place where formats and retargeting are both known."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from plat.errors import MotionError
from plat.motions.formats import MotionFile, ReadOptions, read_csv, read_npy, read_npz, read_pickle
from plat.motions.formats.root_turn import refuse_other_turns
from plat.motions.formats.sonic import holds_sonic, read_sonic
from plat.motions.retargeting.joint_file import holds_human_joints
from plat.motions.retargeting.poselib import holds_poselib
from plat.motions.retargeting.reader import read_human_motion

__all__ = ["NAMED", "READERS"]


Reader = Callable[[Path, ReadOptions], MotionFile]


def _of_robot(read: Reader) -> Reader:
    """Return a reader of a robot's motions that refuses what cannot be determined.

    That is the unit of who lies, and what stands only with its root's quaternions read otherwise.
    """

    def checked(path: Path, options: ReadOptions) -> MotionFile:
        file = read(path, options)
        file = replace(file, unheard=(*file.unheard, "angles"))
        if doubt := next((clip.doubt for clip in file.clips if clip.doubt), ""):
            raise MotionError(doubt)
        if options.quat_order is None and not file.marked:
            refuse_other_turns(file.clips, options.soles)
        return file

    return checked


def _read_archive(path: Path, options: ReadOptions) -> MotionFile:
    """Read an ``.npz``: joint positions of a human are retargeted, all else is a robot's."""
    return read_human_motion(path, options) if holds_human_joints(path) else _of_robot(read_npz)(path, options)


def _read_table(path: Path, options: ReadOptions) -> MotionFile:
    """Read a ``.csv``: joints of SONIC with the bodies beside them, or a whole motion."""
    return _of_robot(read_sonic if holds_sonic(path) else read_csv)(path, options)


def _read_array(path: Path, options: ReadOptions) -> MotionFile:
    """Read an ``.npy``: a human's motion of poselib is retargeted, all else is a robot's."""
    return read_human_motion(path, options) if holds_poselib(path) else _of_robot(read_npy)(path, options)


READERS: dict[str, Reader] = {
    ".npz": _read_archive,
    ".csv": _read_table,
    ".tsv": _of_robot(read_csv),
    ".npy": _read_array,
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
