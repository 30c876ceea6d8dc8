"""Human motions of poselib, which AMP and ASE come with: rotations of a skeleton's joints, in an ``.npy``."""

from pathlib import Path
from typing import Any

import numpy as np
import torch

from plat.errors import MotionError
from plat.motions.formats.archive import read_array
from plat.motions.formats.common import number, strings
from plat.motions.formats.foreign import refuse_bare_joints
from plat.motions.formats.unpickle import PickledArray
from plat.motions.retargeting.mocap import Mocap, check_extent
from plat.rotations import quat_to_matrix

__all__ = ["holds_poselib", "read_poselib"]

# what every motion of poselib names, as a pickle writes it
_MARK = b"skeleton_tree"
_FIELDS = ("rotation", "root_translation", "skeleton_tree", "is_local")
# Where a foot without toes has its ball: before and below the ankle, as shares of the hips' height over it.
_BEFORE, _BELOW = 0.16, 0.05
_FEET = ("left_foot", "right_foot")


def holds_poselib(path: Path) -> bool:
    """Return whether an ``.npy`` holds a skeleton of poselib."""
    data = path.read_bytes()
    return data.startswith(b"\x93NUMPY") and _MARK in data


def read_poselib(path: str | Path, fps: float | None = None) -> Mocap:
    """Read a ``SkeletonMotion`` that poselib wrote. Nothing in the file is run.

    The humanoid of AMP and ASE has no toes: each foot gets an end ``<foot>_end`` at its ball.

    Args:
        path: the file.
        fps: frames a second, where the user states them; else the file does.

    Raises:
        MotionError: naming the file, when it holds something else or does not state its frame rate.
    """
    where = f"NPY file {str(path)!r}"
    try:
        data = Path(path).read_bytes()
        content = read_array(data)
        refuse_bare_joints(content)
        if not isinstance(content, dict) or any(field not in content for field in _FIELDS):
            raise MotionError(f"no motion of poselib, expected a dictionary with {', '.join(_FIELDS)}")
        if "fps" not in content:
            raise MotionError("a pose of poselib and no motion: it has no 'fps'")
        return _mocap(where, content, len(data), fps)
    except MotionError as error:
        raise error if str(error).startswith(where) else MotionError(f"{where}: {error}") from None
    except Exception as error:  # whatever a parser stumbles over: the file is broken
        raise MotionError(f"{where}: not a readable .npy file ({error})") from error


def _mocap(where: str, content: dict[str, Any], size: int, fps: float | None) -> Mocap:
    tree = content["skeleton_tree"]
    names = strings(tree["node_names"], "node_names")
    offsets = _numbers(tree["local_translation"], "local_translation", (len(names), 3))
    parents = [int(parent) for parent in _numbers(tree["parent_indices"], "parent_indices", (len(names),))]
    if not all(-1 <= parent < index for index, parent in enumerate(parents)) or parents[:1] != [-1]:
        raise MotionError("'parent_indices' is no tree whose parents come before their children")
    place = _numbers(content["root_translation"], "root_translation", (None, 3))
    check_extent(where, len(names), len(place), size)
    quat = _numbers(content["rotation"], "rotation", (len(place), len(names), 4))
    length = np.linalg.norm(quat, axis=-1)
    if np.abs(length - 1).max() > 0.1:
        raise MotionError("'rotation' holds quaternions that are not of length 1")
    unit = (quat / length[..., None])[..., [3, 0, 1, 2]]  # poselib has w last
    turns = quat_to_matrix(torch.from_numpy(unit)).numpy()
    positions, rotations = _chained(parents, offsets, place, turns, bool(content["is_local"]))
    unturned = np.tile(np.eye(3), (1, len(names), 1, 1))
    rest = _chained(parents, offsets, np.zeros((1, 3)), unturned, local=True)[0][0]
    if (ball := _ball(names, parents, rest)) is not None:
        feet = [names.index(name) for name in _FEET]
        names, parents = [*names, *(f"{name}_end" for name in _FEET)], [*parents, *feet]
        positions = np.concatenate((positions, positions[:, feet] + rotations[:, feet] @ ball), 1)
        rotations, rest = np.concatenate((rotations, rotations[:, feet]), 1), np.concatenate((rest, rest[feet] + ball))
    rate = number(_unwrap(content["fps"]), "fps") if fps is None else fps
    return Mocap(tuple(names), tuple(parents), positions, rotations, rate, rest)


def _chained(
    parents: list[int], offsets: np.ndarray, place: np.ndarray, turns: np.ndarray, local: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return places ``[T, J, 3]`` and orientations ``[T, J, 3, 3]`` of joints in the world.

    Args:
        parents: index of each joint's, -1 for the root.
        offsets: of joints from their parents, in the parent's axes ``[J, 3]``.
        place: of the root ``[T, 3]``.
        turns: of the joints ``[T, J, 3, 3]``.
        local: whether they are from the parent's axes, and not from the world's.
    """
    positions, rotations = np.empty((*turns.shape[:2], 3)), turns.copy()
    for joint, parent in enumerate(parents):
        if parent < 0:
            positions[:, joint] = place
            continue
        if local:
            rotations[:, joint] = rotations[:, parent] @ turns[:, joint]
        positions[:, joint] = positions[:, parent] + rotations[:, parent] @ offsets[joint]
    return positions, rotations


def _ball(names: list[str], parents: list[int], rest: np.ndarray) -> np.ndarray | None:
    """Return where the ball of a foot is in the axes of a foot that has no toes, or None where feet have them.

    The axes of the rest pose are the world's, and it stands: its front is to the right of the line from the right foot
    to the left one.
    """
    feet = [names.index(name) for name in _FEET if name in names]
    if len(feet) < len(_FEET) or any(foot in parents for foot in feet):
        return None
    rise = rest[0] - rest[feet].mean(0)
    height = float(np.linalg.norm(rise))
    forward = np.cross(rest[feet[0]] - rest[feet[1]], rise)
    forward /= max(float(np.linalg.norm(forward)), 1e-9)
    return _BEFORE * height * forward - _BELOW * rise


def _numbers(stored: Any, field: str, shape: tuple[int | None, ...]) -> np.ndarray:
    """Return the numbers of one of poselib's tensors, a dictionary with the array ``arr``."""
    array = _unwrap(stored.get("arr") if isinstance(stored, dict) else stored)
    fits = isinstance(array, np.ndarray) and array.ndim == len(shape) and array.dtype.kind in "fiu"
    if not fits or any(wanted not in (None, length) for wanted, length in zip(shape, array.shape, strict=True)):
        expected = tuple("frames" if length is None else length for length in shape)
        raise MotionError(f"{field!r} has shape {getattr(array, 'shape', None)}, expected {expected} numbers")
    values = array.astype(np.float64)
    if not np.isfinite(values).all():
        raise MotionError(f"{field!r} holds a value that is not finite")
    return values


def _unwrap(value: Any) -> Any:
    return value.value if isinstance(value, PickledArray) else value
