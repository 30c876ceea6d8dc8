"""Motion files in plat's own format.

A plat motion file is a NumPy ``.npz`` with one array a clip, named by the clip: ``qpos`` ``[T, 7 + J]`` (root position
in m, root quaternion ``wxyz``, joint angles in rad), and the array ``fps``. If ``joint_names`` is there, the joint
columns are brought into the robot's order by name.
"""

import glob
import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from plat.envs.motions.clip import MotionClip
from plat.envs.robot import G1, Robot
from plat.errors import MotionError

__all__ = ["load_motions", "motion_paths", "save_motions"]

_RESERVED = ("fps", "joint_names")


def motion_paths(patterns: str | Path | Sequence[str | Path]) -> list[Path]:
    """Files that paths, folders and globs name, without repeats, in sorted order for each.

    Raises:
        MotionError: when one of them names no file.
    """
    paths: list[Path] = []
    for pattern in [patterns] if isinstance(patterns, (str, Path)) else patterns:
        path = Path(pattern).expanduser()
        if path.is_dir():
            found = sorted(path.rglob("*.npz"))
        elif path.exists():
            found = [path]
        else:
            found = sorted(Path(name) for name in glob.glob(str(path), recursive=True))
        if not found:
            raise MotionError(f"motion file {str(pattern)!r}: no such .npz file, folder with .npz files or glob")
        paths += [path for path in found if path not in paths]
    return paths


def load_motions(patterns: str | Path | Sequence[str | Path], robot: Robot = G1) -> list[MotionClip]:
    """Read every clip of some motion files.

    Args:
        patterns: a path, a folder, a glob, or several of these.
        robot: whose motions they are.

    Raises:
        MotionError: naming file, clip and field, when a file is missing or broken.

    >>> import tempfile
    >>> from plat.envs.motions import generate_motions
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_motions(f"{folder}/two.npz", generate_motions("train", seconds=8)[:2])
    ...     len(load_motions(f"{folder}/*.npz"))
    2
    """
    return [clip for path in motion_paths(patterns) for clip in _read_npz(path, robot)]


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


def _read_npz(path: Path, robot: Robot) -> list[MotionClip]:
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile, zlib.error) as error:
        raise MotionError(f"motion file {str(path)!r}: not a readable .npz file ({error})") from error
    if "fps" not in arrays:
        raise MotionError(f"motion file {str(path)!r}: no array 'fps', expected the frames a second")
    fps = arrays.pop("fps")
    if fps.size != 1 or fps.dtype.kind not in "fiu":
        raise MotionError(f"motion file {str(path)!r}: 'fps' is {fps!r}, expected one number")
    order = _joint_order(path, arrays.pop("joint_names", None), robot)
    if not arrays:
        raise MotionError(
            f"motion file {str(path)!r}: no clips, expected one array (frames, {7 + robot.num_joints}) each"
        )
    clips = []
    for name, qpos in arrays.items():
        try:
            clip = MotionClip(name, qpos, float(fps.item())).checked(robot)
        except MotionError as error:
            raise MotionError(f"motion file {str(path)!r}: {error}") from None
        if order is not None:
            clip = MotionClip(name, clip.qpos[:, order], clip.fps)
        clips.append(clip)
    return clips


def _joint_order(path: Path, names: np.ndarray | None, robot: Robot) -> np.ndarray | None:
    """Columns of the file in the robot's order; None where the file does not name its joints."""
    if names is None:
        return None
    listed = [str(name).removesuffix("_joint") for name in names.ravel()]
    if sorted(listed) != sorted(robot.joint_names):
        missing = sorted(set(robot.joint_names) - set(listed))
        unknown = sorted(set(listed) - set(robot.joint_names))
        raise MotionError(
            f"motion file {str(path)!r}: 'joint_names' lacks {missing} and has the unknown {unknown}, "
            f"expected the {robot.num_joints} joints of {robot.name!r}"
        )
    columns = [7 + listed.index(name) for name in robot.joint_names]
    return np.array([*range(7), *columns])
