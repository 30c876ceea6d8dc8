"""Archives of plat: one array a clip, named by the clip, with rate, names of joints and a mark beside them."""

import zipfile
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from plat.errors import MotionError
from plat.json_file import short, version_fault

__all__ = ["ASSUMED", "RATE", "RESERVED", "check_clip_names", "is_marked", "write_archive"]

# An archive with this array, a version, is plat's own: whatever its arrays are called, they are clips.
_MARK = "plat_motions"
_VERSION = 1
RATE, _JOINTS, ASSUMED = "fps", "joint_names", "fps_assumed"
RESERVED = (RATE, _JOINTS, ASSUMED, _MARK)
"""Names of arrays that are no clips."""

_LONGEST = 65_000  # bytes of a name: an archive counts them in 16 bits


def is_marked(arrays: Mapping[str, np.ndarray]) -> bool:
    """Return whether the arrays of an archive are marked as plat's own.

    Raises:
        MotionError: for the mark of a version that is not read.

    >>> is_marked({"qpos": np.zeros((2, 36))})
    False
    """
    if _MARK not in arrays or arrays[_MARK].ndim:
        return False
    if fault := version_fault(arrays[_MARK].item(), _VERSION):
        raise MotionError(f"version ({_MARK!r}) {fault}")
    return True


def check_clip_names(names: Sequence[str]) -> None:
    """Raise for names of clips that cannot stand in one archive.

    Raises:
        MotionError: naming the first, and what would be right.

    >>> check_clip_names(["walk", "walk"])
    Traceback (most recent call last):
    plat.errors.MotionError: 2 clips are called 'walk', expected names that differ from each other
    """
    for name, count in Counter(names).items():
        if count > 1:
            raise MotionError(f"{count} clips are called {short(name)}, expected names that differ from each other")
        if name in RESERVED:
            others = ", ".join(map(repr, RESERVED))
            raise MotionError(f"a clip is called {name!r}, expected a name other than {others}")
        if "\0" in name or len(name.encode(errors="replace")) > _LONGEST or not _is_text(name):
            raise MotionError(
                f"a clip is called {short(name)}, expected text without null characters of at most {_LONGEST} bytes"
            )


def _is_text(name: str) -> bool:
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True


def write_archive(
    path: Path,
    clips: Mapping[str, np.ndarray],
    fps: float,
    joint_names: Sequence[str],
    assumed: Sequence[str] = (),
) -> None:
    """Write clips ``[T, 7 + J]`` of one frame rate with the mark of plat, and the names of those it was assumed of.

    ``numpy.savez_compressed`` writes the same, but takes no array by the name of one of its arguments.
    """
    about: dict[str, Any] = {_MARK: np.int64(_VERSION), RATE: np.float64(fps), _JOINTS: np.array(joint_names)}
    if assumed:
        about[ASSUMED] = np.array(assumed)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in (*about.items(), *clips.items()):
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asanyarray(array), allow_pickle=False)
