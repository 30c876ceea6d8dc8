"""Motion files: finding, reading and writing them.

A plat motion file is a NumPy ``.npz`` with one array a clip, named by the clip: ``qpos`` ``[T, 7 + J]`` (root position
in m, root quaternion ``wxyz``, joint angles in rad), and the array ``fps``. If ``joint_names`` is there, the joint
columns are brought into the robot's order by name. The other formats are in :mod:`plat.motions.formats`.
"""

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from plat.errors import MotionError
from plat.motions.clip import MotionClip
from plat.motions.formats import MotionFile, QuatOrder, ReadOptions, csv_text
from plat.motions.paths import find_files
from plat.motions.readers import READERS
from plat.robots import G1, Robot

__all__ = ["load_motions", "motion_paths", "read_motion_files", "save_csv", "save_motions"]

# names with a meaning in the file, and to the function that writes it
_RESERVED = ("fps", "joint_names", "joint_pos", "file", "allow_pickle")
_LOGGER = logging.getLogger("plat.motions")


def motion_paths(patterns: str | Path | Sequence[str | Path]) -> list[Path]:
    """Return the motion files that paths, folders and globs name; see :func:`plat.motions.paths.find_files`.

    Raises:
        MotionError: when one of them names no motion file.
    """
    return find_files(patterns, READERS)


def read_motion_files(
    patterns: str | Path | Sequence[str | Path],
    robot: Robot = G1,
    *,
    quat_order: QuatOrder | None = None,
    fps: float | None = None,
) -> list[MotionFile]:
    """Read motion files, with what each was taken for; see :func:`load_motions`."""
    options = ReadOptions(robot, quat_order, fps)
    return [_read(path, options) for path in motion_paths(patterns)]


def load_motions(
    patterns: str | Path | Sequence[str | Path],
    robot: Robot = G1,
    *,
    quat_order: QuatOrder | None = None,
    fps: float | None = None,
) -> list[MotionClip]:
    """Read every clip of some motion files.

    Formats: plat ``.npz``; ``.csv`` with 36 columns (LAFAN1 retargeting, MuJoCo); the ``.npz`` of BeyondMimic, mjlab
    and holosoma; the ``.pkl`` of GMR, TWIST2, ASAP and PBHC, of which no code is run; human ``.bvh``, retargeted. What
    was assumed or detected is logged under ``plat.motions``.

    Args:
        patterns: a path, a folder, a glob, or several of these.
        robot: whose motions they are.
        quat_order: order of the root quaternion in these files; by default what the format says, and for ``.csv`` what
            the motion shows.
        fps: frames a second of these files; by default what they say, and 30 for a ``.csv`` that does not.

    Raises:
        MotionError: naming file, clip and field, when a file is missing or broken, or does not tell which order its
            quaternions or joints have.

    >>> import tempfile
    >>> from plat.motions import generate_motions
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_motions(f"{folder}/two.npz", generate_motions("train", seconds=8)[:2])
    ...     len(load_motions(f"{folder}/*.npz"))
    2
    """
    files = read_motion_files(patterns, robot, quat_order=quat_order, fps=fps)
    alike: dict[str, list[MotionFile]] = {}
    for file in files:
        if file.notes:
            alike.setdefault(file.facts, []).append(file)
    for facts, group in alike.items():
        more = f" and {len(group) - 1} more" if len(group) > 1 else ""
        _LOGGER.info("%s%s: %s", group[0].path, more, facts)
    return [clip for file in files for clip in file.clips]


def save_motions(path: str | Path, clips: Sequence[MotionClip], robot: Robot = G1) -> None:
    """Write clips of one frame rate to a plat motion file."""
    rates = {clip.fps for clip in clips}
    if len(rates) != 1:
        raise MotionError(f"motion file {str(path)!r}: clips at {sorted(rates)} frames a second, expected one rate")
    arrays = {clip.name: clip.qpos for clip in clips}
    taken = sorted(set(arrays) & set(_RESERVED))
    if taken or len(arrays) != len(clips):
        raise MotionError(f"motion file {str(path)!r}: clip names must differ from each other and from {_RESERVED}")
    described: dict[str, Any] = {"fps": np.float64(rates.pop()), "joint_names": np.array(robot.joint_names), **arrays}
    np.savez_compressed(path, **described)


def save_csv(folder: str | Path, clip: MotionClip, robot: Robot = G1) -> Path:
    """Write a clip to ``NAME_30fps.csv``: MuJoCo's ``qpos`` under a header, quaternion ``wxyz``."""
    path = Path(folder) / f"{clip.name.replace('/', '_')}_{clip.fps:.10g}fps.csv"
    path.write_text(csv_text(clip, robot.joint_names))
    return path


def _read(path: Path, options: ReadOptions) -> MotionFile:
    ending = path.suffix.lower()
    try:
        return READERS[ending](path, options)
    except MotionError as error:
        raise MotionError(f"motion file {str(path)!r}: {error}") from None
    except Exception as error:  # whatever a parser stumbles over: the file is broken
        raise MotionError(f"motion file {str(path)!r}: not a readable {ending} file ({error})") from error
