"""Pickles of GMR and TWIST2, joblib's of ASAP and PBHC, which hold ``xyzw`` quaternions, and MimicKit's."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from plat.errors import MotionError
from plat.motions.clip import MotionClip
from plat.motions.formats.clock import StatedRate, rates_of_fields
from plat.motions.formats.common import MotionFile, QuatOrder, ReadOptions, arrange_joints, make_clip, strings
from plat.motions.formats.decompress import check_numbers, decompress
from plat.motions.formats.foreign import refuse_human_body
from plat.motions.formats.names import array_meaning
from plat.motions.formats.pace import settled_rate
from plat.motions.formats.quaternion_order import settle_joint_order, settle_quat_order
from plat.motions.formats.unnamed_joints import unnamed_joints
from plat.motions.formats.unpickle import PickledArray, unpickle
from plat.rotations_np import quat_from_rotvec

__all__ = ["read_fields", "read_pickle"]

# what GMR and TWIST2 call a field, and what ASAP and PBHC call it
_ROOT_POS = ("root_pos", "root_trans_offset", "root_trans", "base_pos")
_ROOT_QUAT = ("root_rot", "root_quat", "base_quat")
_JOINT_POS = ("dof_pos", "dof", "joint_pos")
_NAMES = ("joint_names", "dof_names", "joint_order", "motor_names")
# what MimicKit calls its rows of root position, rotation vector and joints
_FRAMES = "frames"
# what files are called that have a field, the last one without any of these
_KINDS = {"GMR pickle": "dof_pos", "MimicKit pickle": _FRAMES, "ASAP pickle": "dof", "pickle": ""}
# A motion takes milliseconds to look at, and a second of one takes kilobytes.
_FEW, _LEAST_BYTES = 16, 256


def read_pickle(path: Path, options: ReadOptions) -> MotionFile:
    """Read ``.pkl``: one motion, or a dictionary of motions by name. Nothing in the file is run."""
    packed = path.read_bytes()
    data = decompress(packed)
    return read_fields(path, unpickle(data), options, len(packed), len(data))


def read_fields(path: Path, content: Any, options: ReadOptions, packed: int, size: int) -> MotionFile:
    """Read one motion, or a dictionary of motions by name, from the objects that a file holds.

    Args:
        path: of the file.
        content: what :func:`~plat.motions.formats.unpickle.unpickle` made of it.
        options: what the user says.
        packed: bytes of the file.
        size: bytes of its content.

    Raises:
        MotionError: when it holds something else, or claims more than there is.
    """
    if isinstance(content, PickledArray):
        content = {"qpos": content}
    if isinstance(content, list) and content and all(isinstance(fields, dict) for fields in content):
        content = {f"{path.stem}_{number}": fields for number, fields in enumerate(content)}
    if not isinstance(content, dict) or not content:
        raise MotionError(f"it holds a {type(content).__name__}, expected a dictionary of a motion or of motions")
    refuse_human_body([name for name in content if isinstance(name, str)])
    single = any(name in content for name in (*_JOINT_POS, "qpos", _FRAMES)) or any(
        isinstance(name, str) and array_meaning(name) == "joint_pos" and not isinstance(fields, dict)
        for name, fields in content.items()
    )
    motions = {path.stem: content} if single else content
    if len(motions) > _FEW + packed // _LEAST_BYTES:
        raise MotionError(f"it names {len(motions)} motions, expected at least {_LEAST_BYTES} bytes for each")
    clips, orders = [], set[str]()
    # a file may name one array a thousand times: what is read must not be larger than what is there
    spare = size
    numbers = 0
    for name, fields in motions.items():
        if not isinstance(fields, dict):
            raise MotionError(f"entry {name!r:.60} is a {type(fields).__name__}, expected a dictionary of a motion")
        numbers += sum(map(_count, fields.values()))
        check_numbers(numbers, packed)
        try:
            clip, order = _read_motion(str(name), fields, options)
        except MotionError as error:
            raise error if single else MotionError(f"motion {name!r}: {error}") from None
        spare -= clip.qpos.nbytes // 4
        if spare < 0:
            raise MotionError("its motions are larger than the file")
        clips.append(clip)
        orders.add(order)
    kind = next(kind for kind, field in _KINDS.items() if any(field in fields for fields in (*motions.values(), [""])))
    return MotionFile(path, kind, clips, (f"quaternion {'/'.join(sorted(orders))}",))


def _read_motion(name: str, fields: dict[str, Any], options: ReadOptions) -> tuple[MotionClip, QuatOrder]:
    robot = options.robot
    fields, usual = _with_parts(_renamed(fields))
    root_pos, root_quat, joint_pos = (_array(fields, names) for names in (_ROOT_POS, _ROOT_QUAT, _JOINT_POS))
    listed = next((_unwrap(fields[key]) for key in _NAMES if key in fields), None)
    names = None if listed is None else strings(listed, "joint_names")
    without_wrists = [joint for joint in robot.joint_names if "wrist" not in joint]
    if names is None and joint_pos.ndim == 2 and joint_pos.shape[1] == len(without_wrists):
        try:
            names = unnamed_joints(joint_pos.astype(np.float64), robot, "/".join(_JOINT_POS))
        except MotionError:
            names = without_wrists  # the format of ASAP and PBHC
    arranged, notes = arrange_joints(joint_pos, names, robot, "/".join(_JOINT_POS))
    rates = _rates(fields) if options.fps is None else [(options.fps, "--fps")]
    fps = rates[0][0]
    called = ("/".join(_ROOT_POS), "/".join(_ROOT_QUAT))

    def read(joints: np.ndarray, order: QuatOrder, doubts: Sequence[str] = ()) -> MotionClip:
        return make_clip(name, root_pos, root_quat, joints, fps, options, order, called, (*doubts, *notes))

    stated = options.quat_order or usual
    if names is None and joint_pos.shape[1] == robot.num_joints:
        arranged, found = settle_joint_order(arranged, lambda joints: read(joints, stated).qpos, options, stated)
        notes += found
    clip, order = read(arranged, stated), stated
    if options.quat_order is None:
        in_file = clip.qpos.copy()
        if stated == "xyzw":
            in_file[:, 3:7] = clip.qpos[:, [4, 5, 6, 3]]
        order, doubts = settle_quat_order(in_file, fps, options.soles, stated)
        clip = read(arranged, order, doubts) if doubts else clip
    if len(rates) > 1:
        fps, told = settled_rate(rates, [clip], robot)
        clip = replace(clip, fps=fps, notes=(*clip.notes, told))
    return clip, order


def _renamed(fields: dict[str, Any]) -> dict[str, Any]:
    """Return fields with the names that plat knows root and joints by, where their own names say what they are."""
    named = dict(fields)
    for known, usual in (("root_pos", _ROOT_POS), ("root_quat", _ROOT_QUAT), ("joint_pos", _JOINT_POS)):
        found = [name for name in fields if isinstance(name, str) and array_meaning(name) == known]
        if found and not any(name in fields for name in (*usual, "qpos")):
            as_written = "root_rot" if known == "root_quat" and "xyzw" in found[0].lower() else known
            named[as_written] = fields[found[0]]
    return named


def _with_parts(fields: dict[str, Any]) -> tuple[dict[str, Any], QuatOrder]:
    """Return the fields of a motion with ``qpos`` taken apart, and the order that its quaternion usually has."""
    qpos = _unwrap(fields.get("qpos"))
    if isinstance(qpos, np.ndarray) and qpos.ndim == 2 and qpos.shape[1] > 7:
        parts = {"root_pos": qpos[:, :3], "root_rot": qpos[:, 3:7], "dof_pos": qpos[:, 7:]}
        return {**fields, **parts}, "wxyz"
    if _FRAMES in fields and not any(name in fields for name in _JOINT_POS):
        rows = _array(fields, (_FRAMES,))
        if rows.ndim != 2 or rows.shape[1] < 7:
            raise MotionError(
                f"{_FRAMES!r} has shape {rows.shape}, expected rows of root position, rotation vector and joint angles"
            )
        quat = quat_from_rotvec(rows[:, 3:6].astype(np.float64))
        return {**fields, "root_pos": rows[:, :3], "root_quat": quat, "dof_pos": rows[:, 6:]}, "wxyz"
    return fields, "xyzw" if "root_rot" in fields else "wxyz"


def _count(value: Any) -> int:
    """Return how many numbers an array has, or a list of equal rows would make."""
    value = _unwrap(value)
    if isinstance(value, list) and value and isinstance(value[0], list):
        return len(value) * len(value[0])
    return value.size if isinstance(value, np.ndarray) else 0


def _rates(fields: dict[str, Any]) -> list[StatedRate]:
    rates = rates_of_fields({name: _unwrap(value) for name, value in fields.items()})
    if not rates:
        raise MotionError("no field 'fps', expected the frames a second (or state them: --fps)")
    return rates


def _array(fields: dict[str, Any], names: tuple[str, ...]) -> np.ndarray:
    present = [name for name in names if name in fields]
    if not present:
        raise MotionError(f"no field {' or '.join(map(repr, names))}, only {sorted(map(str, fields))[:20]}")
    array = _unwrap(fields[present[0]])
    if isinstance(array, list) and all(isinstance(row, list) for row in array):
        widths = {len(row) for row in array}
        if len(widths) == 1 and all(isinstance(value, (int, float)) for row in array for value in row):
            return np.array(array, dtype=np.float64)
    if isinstance(array, np.ndarray) and array.ndim == 3 and 1 in array.shape[::2]:
        # one of a batch, or a column for each joint
        array = array[0] if len(array) == 1 else array[..., 0]
    if not isinstance(array, np.ndarray):
        raise MotionError(f"{present[0]!r} is a {type(array).__name__}, expected an array")
    return array


def _unwrap(value: Any) -> Any:
    return value.value if isinstance(value, PickledArray) else value
