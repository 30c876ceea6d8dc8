"""Archives of joint positions of humans: Kimodo and ARDY on their human skeletons, and the SMPL family's joints."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from plat.errors import MotionError
from plat.json_file import short
from plat.motions.formats.archive import archive_shapes, read_archive, states_rate, take_rate
from plat.motions.formats.clock import ELSEWHERE, even_frames, stated_rates, times_of_fields
from plat.motions.formats.common import strings
from plat.motions.formats.foreign import refuse_human_body
from plat.motions.formats.kimodo import KIMODO_FPS
from plat.motions.formats.npz_file import ALIASES
from plat.motions.retargeting.mocap import Mocap
from plat.motions.retargeting.skeletons import ROLES
from plat.words import counted

__all__ = ["holds_human_joints", "read_joint_file"]

# arrays of joints' places [T, J, 3], the likelier first; and of their names
# what Kimodo and ARDY call theirs, y up
_KIMODO = "posed_joints"
_PLACES = (
    _KIMODO,
    "global_joint_positions",
    "joint_positions",
    "joints",
    "joints3d",
    "human_joints",
    "positions",
)
_NAMES = ("joint_names", "joints_names", "names")
# of joints where they are as many, else of something else
_OF_ANYTHING = "names"
# arrays that make an archive one of a robot
_ROBOT = {"qpos", "joint_pos", *(name for name, known in ALIASES.items() if known == "joint_pos")} - {*_PLACES}

_ARM, _LEG, _CORE_LEG = (
    ("Shoulder", "Arm", "ForeArm", "Hand"),
    ("Leg", "Shin", "Foot", "ToeBase"),
    ("UpLeg", "Leg", "Foot", "ToeBase"),
)
_SOMA_TRUNK = ("Hips", "Spine1", "Spine2", "Chest", "Neck1", "Neck2", "Head")
_CORE_TRUNK = ("Hips", "Spine", "Spine1", "Spine2", "Spine3", "Neck", "Head")
_SMPL_TREE = (
    *("pelvis -", "left_hip pelvis", "right_hip pelvis", "spine1 pelvis", "left_knee left_hip", "right_knee right_hip"),
    *("spine2 spine1", "left_ankle left_knee", "right_ankle right_knee", "spine3 spine2", "left_foot left_ankle"),
    *("right_foot right_ankle", "neck spine3", "left_collar spine3", "right_collar spine3", "head neck"),
    *("left_shoulder left_collar", "right_shoulder right_collar", "left_elbow left_shoulder"),
    *("right_elbow right_shoulder", "left_wrist left_elbow", "right_wrist right_elbow"),
)
# column of a joint, and its parent's name
_Layout = dict[str, tuple[int, str]]


def _chain(first: int, names: Sequence[str], parent: str, side: str = "") -> _Layout:
    """Return joints in columns that follow each other, each the child of the one before."""
    listed = [side + name for name in names]
    return {name: (first + n, listed[n - 1] if n else parent) for n, name in enumerate(listed)}


# Columns of the joints that are needed, by the number of joints. Source: nv-tlabs/kimodo, and its kin ARDY,
# skeleton/definitions.py; all members of the SMPL family have the same first 22 joints.
_SMPL: _Layout = {row.split()[0]: (column, row.split()[1]) for column, row in enumerate(_SMPL_TREE)}
_LAYOUTS: dict[int, _Layout] = {
    77: _chain(0, _SOMA_TRUNK, "-")
    | _chain(11, _ARM, "Chest", "Left")
    | _chain(39, _ARM, "Chest", "Right")
    | _chain(67, _LEG, "Hips", "Left")
    | _chain(72, _LEG, "Hips", "Right"),
    30: _chain(0, _SOMA_TRUNK, "-")
    | _chain(10, _ARM, "Chest", "Left")
    | _chain(16, _ARM, "Chest", "Right")
    | _chain(22, _LEG, "Hips", "Left")
    | _chain(26, _LEG, "Hips", "Right"),
    27: _chain(0, _CORE_TRUNK, "-")
    | _chain(7, _ARM, "Spine3", "Right")
    | _chain(13, _ARM, "Spine3", "Left")
    | _chain(19, _CORE_LEG, "Hips", "Right")
    | _chain(23, _CORE_LEG, "Hips", "Left"),
    **dict.fromkeys((22, 24, 45, 52, 55, 73, 127, 144), _SMPL),
}


def holds_human_joints(path: Path) -> bool:
    """Return whether an ``.npz`` holds joint positions of a human, and no motion of a robot."""
    shapes = archive_shapes(path)
    return not _ROBOT & set(shapes) and _places(shapes) is not None


def read_joint_file(path: str | Path, fps: float | None = None) -> Mocap:
    """Read joint positions ``[T, J, 3]`` of a human from an ``.npz``.

    Joints are known by their names where the archive has them, else by their number: 77 or 30 of SOMA, 27 of ARDY's
    skeleton, 22 and more of the SMPL family.

    Args:
        path: the file.
        fps: frames a second, where the user states them; else the archive does, and 30 for Kimodo.

    Raises:
        MotionError: naming the file, when it holds no such joints or does not state its frame rate.
    """
    where = f"NPZ file {str(path)!r}"
    try:
        arrays = read_archive(Path(path))
        name = _places({name: array.shape for name, array in arrays.items()})
        if name is None:
            refuse_human_body(arrays)
            has = ", ".join(f"{name!r} {array.shape}" for name, array in list(arrays.items())[:6]) or "nothing"
            raise MotionError(
                f"no joint positions of a human, expected {' or '.join(_PLACES)} of (frames, joints, 3) with "
                f"'joint_names' beside them or in SMPL's order (22 joints and more); it has {has}"
            )
        notes = []
        if name == _KIMODO and fps is None and not states_rate(arrays) and not stated_rates(Path(path), []):
            arrays["fps"] = np.array(KIMODO_FPS)
            notes.append("fps as Kimodo writes it")
        times = [*times_of_fields(arrays).values()][:1] if fps is None else []
        rate, source = take_rate(arrays, fps, Path(path))
        notes += [f"fps from {source}"] if source in ELSEWHERE else []
        places = arrays[name].astype(np.float64)
        if not np.isfinite(places).all():
            raise MotionError(f"{name!r} holds a value that is not finite")
        listed = _names(arrays, places.shape[1])
        named = listed is not None
        layout = {name: (column, "-") for column, name in enumerate(listed or ())}
        layout = layout if named else _LAYOUTS[places.shape[1]]
    except MotionError as error:
        raise MotionError(f"{where}: {error}") from None
    except Exception as error:  # whatever a parser stumbles over: the file is broken
        raise MotionError(f"{where}: not a readable .npz file ({error})") from error
    if not named:
        notes.append(f"joints by their number, {places.shape[1]}")
    columns = [column for column, _ in layout.values()]
    positions = places[:, columns]
    found = arrays.get("global_rot_mats")
    with_rotations = found is not None and found.shape == (*places.shape[:2], 3, 3)
    rotations = found[:, columns].astype(np.float64) if with_rotations and found is not None else None
    if times and len(times[0]) == len(positions):
        told, between = even_frames(times[0], rate)
        notes += [told] if told else []
        if between is not None:
            before, weight = between
            start, end = positions[before], positions[before + 1]
            positions = start + weight[:, None, None] * (end - start)
            rotations = None  # feet are turned as their toes point
    index = {name: number for number, name in enumerate(layout)}
    parents = tuple(index.get(parent, -1) for _, parent in layout.values())
    up = "y" if name == _KIMODO else None
    return Mocap(tuple(layout), parents, positions, rotations, rate, np.zeros((len(layout), 3)), tuple(notes), up)


def _names(arrays: Mapping[str, np.ndarray], count: int) -> list[str] | None:
    """Return the names of so many joints, or None where the archive has none.

    Raises:
        MotionError: for another number of names, or one that comes twice.
    """
    key = next((key for key in _NAMES if key in arrays), None)
    if key is None:
        return None
    listed = strings(arrays[key], key)
    if len(listed) != count:
        if key == _OF_ANYTHING:
            return None
        raise MotionError(f"{key!r} has {counted(len(listed), 'name')}, expected {count}")
    if twice := [name for name, times in Counter(listed).items() if times > 1]:
        raise MotionError(f"{key!r} has {short(twice[0])} twice, expected each joint once")
    return listed


def _places(shapes: Mapping[str, tuple[int, ...]]) -> str | None:
    """Return which array holds the joints."""
    named = any(name in shapes for name in _NAMES)
    for name in _PLACES:
        shape = shapes.get(name, ())
        if len(shape) == 3 and shape[2] == 3 and (shape[1] in _LAYOUTS or (named and shape[1] >= len(ROLES))):
            return name
    return None
