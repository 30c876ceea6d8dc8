"""Pickles of GMR and TWIST2, joblib's of ASAP and PBHC, which hold ``xyzw`` quaternions, and MimicKit's."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from plat.errors import MotionError
from plat.motions.clip import MotionClip
from plat.motions.formats.clock import (
    STATED,
    StatedRate,
    distinct_rates,
    evenly_timed,
    rate_fields,
    rates_of_fields,
    stated_rates,
    times_of_fields,
)
from plat.motions.formats.columns import place_first
from plat.motions.formats.common import (
    OTHER_ORDER,
    MotionFile,
    QuatOrder,
    ReadOptions,
    arrange_joints,
    make_clip,
    of_motion,
    other_angles,
    strings,
)
from plat.motions.formats.decompress import check_numbers, decompress
from plat.motions.formats.foreign import refuse_human_body
from plat.motions.formats.joint_columns import listed_joints, texts
from plat.motions.formats.joint_orders import JointOrderError, SidesError, in_robot_order
from plat.motions.formats.pace import rate_of_file
from plat.motions.formats.quaternion_order import settle_joint_order, settle_quat_order
from plat.motions.formats.spellings import array_meaning
from plat.motions.formats.unnamed_joints import unnamed_joints, without_wrists
from plat.motions.formats.unpickle import PickledArray, unpickle
from plat.motions.paths import distinct_names
from plat.rotations_np import quat_from_rotvec

__all__ = ["read_fields", "read_pickle"]

# what GMR and TWIST2 call a field, and what ASAP and PBHC call it
_ROOT_POS = ("root_pos", "root_trans_offset", "root_trans", "base_pos")
_ROOT_QUAT = ("root_rot", "root_quat", "base_quat")
_JOINT_POS = ("dof_pos", "dof", "joint_pos")
_FIELD = "/".join(_JOINT_POS)
_NAMES = ("joint_names", "dof_names", "joint_order", "motor_names")
# what MimicKit calls its rows of root position, rotation vector and joints
_FRAMES = "frames"
# what files are called that have a field, the last one without any of these
_KINDS = {"GMR pickle": "dof_pos", "MimicKit pickle": _FRAMES, "ASAP pickle": "dof", "pickle": ""}
# what a dictionary of all motions of a file is called, or the one motion of a group
_OF_ALL = frozenset(("motions", "motion", "data", "clips", "clip", "sequences", "sequence"))
_MOST_GROUPED = 1_000_000
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
    if isinstance(content, PickledArray) or (isinstance(content, list) and content and isinstance(content[0], list)):
        content = {"qpos": content}
    if isinstance(content, list) and content and all(isinstance(fields, dict) for fields in content):
        content = {f"{path.stem}_{number}": fields for number, fields in enumerate(content)}
    if not isinstance(content, dict) or not content:
        raise MotionError(f"it holds a {type(content).__name__}, expected a dictionary of a motion or of motions")
    refuse_human_body([name for name in content if isinstance(name, str)])
    single = any(name in content for name in (*_JOINT_POS, *_ROOT_POS, *_ROOT_QUAT, "qpos", _FRAMES)) or any(
        isinstance(name, str) and array_meaning(name) == "joint_pos" and not isinstance(fields, dict)
        for name, fields in content.items()
    )
    kinds = {type(value) for value in content.values()}
    if not single and PickledArray in kinds and dict not in kinds:
        raise MotionError(f"no field {' or '.join(map(repr, _JOINT_POS))}, only {sorted(map(str, content))[:20]}")
    motions = {path.stem: content} if single else _with_what_holds_for_all(_ungrouped(content, path.stem))
    if len(motions) > _FEW + packed // _LEAST_BYTES:
        raise MotionError(f"it names {len(motions)} motions, expected at least {_LEAST_BYTES} bytes for each")
    read: dict[Any, _Motion] = {}

    broken: list[MotionError] = []

    @contextmanager
    def apart(name: Any, refused: bool = False) -> Iterator[None]:
        try:
            yield
        except MotionError as error:
            told = error if single else of_motion(str(name), error)
            if refused:
                raise told from None
            broken.append(told)

    # a file may name one array a thousand times: what is read must not be larger than what is there
    spare = size
    numbers = 0
    for name, fields in motions.items():
        if not isinstance(fields, dict):
            raise MotionError(f"entry {name!r:.60} is a {type(fields).__name__}, expected a dictionary of a motion")
        numbers += sum(map(_count, fields.values()))
        check_numbers(numbers, packed)
        with apart(name):
            refuse_human_body([field for field in fields if isinstance(field, str)])
            read[name] = _Motion.of(path, str(name), fields, options)
    short = [name for name, motion in read.items() if motion.joint_pos.ndim == 2 and len(motion.joint_pos) < 2]
    if len(short) < len(read):  # else the check of a clip says what is wrong
        read = {name: motion for name, motion in read.items() if name not in short}
    clips, orders = [], set[str]()
    for name, layout in _layouts(read, apart).items():
        with apart(name):
            clip, order = read[name].clip(layout)
            clips.append(clip)
            orders.add(order)
            spare -= clip.qpos.nbytes // 4
        if spare < 0:
            raise MotionError("its motions are larger than the file")
    if not clips:
        raise broken[0]
    kind = next(kind for kind, field in _KINDS.items() if any(field in fields for fields in (*motions.values(), [""])))
    unheard = () if any(motion.options is options for motion in read.values()) else ("quat_order",)
    notes = [f"quaternion {'/'.join(sorted(orders))}"]
    if short:
        notes.append(f"left out, with less than 2 frames: {', '.join(map(str, short[:3]))}")
    return MotionFile(path, kind, clips, tuple(notes), unheard, broken=tuple(broken))


@dataclass(frozen=True)
class _Layout:
    """Which joints the columns of a motion are, and what is to be said of it."""

    joints: tuple[str, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Motion:
    """One motion of a file, as it is written there.

    Attributes:
        path: of the file.
        name: of the clip.
        root_pos: ``[T, 3]``.
        root_quat: ``[T, 4]``, in the order ``stated``.
        joint_pos: ``[T, n]``.
        names: of its columns, where the file has them.
        rates: that its fields state, the first one first.
        times: of its frames, none or one ``[T]``.
        stated: order of the quaternion by the options or the format.
        options: what the user says.
        notes: on its fields.
    """

    path: Path
    name: str
    root_pos: np.ndarray
    root_quat: np.ndarray
    joint_pos: np.ndarray
    names: list[str] | None
    rates: list[StatedRate]
    times: list[np.ndarray]
    stated: QuatOrder
    options: ReadOptions
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, path: Path, name: str, fields: dict[str, Any], options: ReadOptions) -> "_Motion":
        fields = _renamed(fields)
        if _of_rotation_vectors(fields):  # whose quaternion is made here
            options = replace(options, quat_order=None)
        beside = {name: _array(fields, (name,)) for name in _JOINT_POS if name in fields} if "qpos" in fields else {}
        fields, usual = _with_parts(fields)
        root_pos, root_quat, joint_pos = (_array(fields, names) for names in (_ROOT_POS, _ROOT_QUAT, _JOINT_POS))
        plain = _unwrapped(fields)
        listed = next((_unwrap(fields[key]) for key in _NAMES if key in fields), None)
        if listed is None and joint_pos.ndim == 2:
            listed = listed_joints(plain, (joint_pos.shape[1],), options.robot)
        names = None if listed is None else strings(listed, "joint_names")
        rates = _rates(path, plain) if options.fps is None else [(options.fps, STATED)]
        times = [*times_of_fields(plain).values()][:1] if options.fps is None else []
        order = options.quat_order or usual
        notes = [
            f"{field!r} left out, which has another motion than 'qpos'"
            for field, angles in beside.items()
            if other_angles(joint_pos, angles)
        ]
        return cls(path, name, root_pos, root_quat, joint_pos, names, rates, times, order, options, tuple(notes))

    def layout(self) -> _Layout | None:
        """Return what the joints without names are by the poses they make; None where names or their number say it.

        Raises:
            JointOrderError: where the poses leave it open.
        """
        robot, joint_pos = self.options.robot, self.joint_pos
        if self.names is not None or joint_pos.ndim != 2 or joint_pos.dtype.kind not in "fiu":
            return None
        if joint_pos.shape[1] == len(without_wrists(robot)):
            joints = unnamed_joints(joint_pos.astype(np.float64), robot, _FIELD)
            in_order = joints == [name for name in robot.joint_names if name in joints]
            return _Layout(tuple(joints), () if in_order else (OTHER_ORDER,))
        if joint_pos.shape[1] != robot.num_joints:
            return None
        joints, notes = settle_joint_order(
            joint_pos.astype(np.float64), lambda joints: self._read(joints, self.stated).qpos, self.options, self.stated
        )
        return _Layout(tuple(joints), tuple(notes))

    def clip(self, layout: _Layout | None) -> tuple[MotionClip, QuatOrder]:
        """Return the clip, and the order that its quaternions turned out to have."""
        robot, order = self.options.robot, self.stated
        joint_pos, names = self.joint_pos, self.names
        notes: tuple[str, ...] = ()
        if layout is not None and len(layout.joints) == robot.num_joints:
            joint_pos, notes = in_robot_order(joint_pos, layout.joints, robot), layout.notes
        elif layout is not None:
            names, notes = [name for name in robot.joint_names if name in layout.joints], layout.notes
            joint_pos = joint_pos[:, [layout.joints.index(name) for name in names]]
        joint_pos, more = arrange_joints(joint_pos, names, robot, _FIELD)
        notes = (*self.notes, *more, *notes)
        as_stated = clip = self._read(joint_pos, order, notes)
        if self.options.quat_order is None:
            order, doubts = settle_quat_order(
                lambda order: (as_stated if order == self.stated else self._read(joint_pos, order)).qpos,
                clip.fps,
                self.options.soles,
                order,
            )
            clip = self._read(joint_pos, order, (*doubts, *notes)) if doubts else clip
        fps, told = rate_of_file(self.path, self.rates, [clip], robot)
        clip = replace(clip, fps=fps, notes=(*clip.notes, *told))
        return (evenly_timed(clip, self.times[0]) if self.times else clip), order

    def _read(self, joint_pos: np.ndarray, order: QuatOrder, notes: tuple[str, ...] = ()) -> MotionClip:
        fps, called = self.rates[0][0], ("/".join(_ROOT_POS), "/".join(_ROOT_QUAT))
        return make_clip(self.name, self.root_pos, self.root_quat, joint_pos, fps, self.options, order, called, notes)


def _layouts(
    motions: Mapping[Any, _Motion], apart: Callable[..., AbstractContextManager[None]]
) -> dict[Any, _Layout | None]:
    """Return the layout of the motions of a file; one that leaves it open has that of the others, if these agree.

    Args:
        motions: by name.
        apart: takes the error of a motion that is broken, and raises that of one that is ``refused``.

    Raises:
        MotionError: for the first motion that leaves its layout open, where the others do not tell either.
    """
    layouts: dict[Any, _Layout | None] = {}
    doubts: dict[Any, JointOrderError] = {}
    for key, motion in motions.items():
        with apart(key):
            try:
                layouts[key] = motion.layout()
            except JointOrderError as error:
                doubts[key] = error
    for key, doubt in doubts.items():
        count, robot = motions[key].joint_pos.shape[1], motions[key].options.robot
        others = {layout.joints for layout in layouts.values() if layout is not None and len(layout.joints) == count}
        if len(others) == 1:
            layouts[key] = _Layout(others.pop(), ("joints as in the file's other motions",))
        elif count != robot.num_joints and not isinstance(doubt, SidesError):
            assumed = f"which {count} joints it has assumed, as ASAP and PBHC have them: its poses leave it open"
            layouts[key] = _Layout(tuple(without_wrists(robot)), (assumed,))
        else:
            with apart(key, refused=True):
                raise doubt
    return {key: layouts[key] for key in motions if key in layouts}


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
    qpos = _array(fields, ("qpos",)) if isinstance(fields.get("qpos"), list) else _unwrap(fields.get("qpos"))
    if isinstance(qpos, np.ndarray) and qpos.ndim == 2 and qpos.shape[1] > 7 and qpos.dtype.kind in "fiu":
        qpos, _ = place_first(qpos)
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


def _of_rotation_vectors(fields: Mapping[Any, Any]) -> bool:
    """Return whether the fields of a motion are those of MimicKit."""
    return _FRAMES in fields and "qpos" not in fields and not any(name in fields for name in _JOINT_POS)


def _count(value: Any) -> int:
    """Return how many numbers an array has, or a list of equal rows would make."""
    value = _unwrap(value)
    first = _unwrap(value[0]) if isinstance(value, list) and value else None
    if isinstance(first, np.ndarray):
        return len(value) * first.size
    if isinstance(first, (list, tuple)):
        return len(value) * len(first)
    return value.size if isinstance(value, np.ndarray) else 0


def _with_what_holds_for_all(content: dict[Any, Any]) -> dict[Any, Any]:
    """Return the motions of a file by name, each with the rate and the names of joints that stand beside them."""
    if not all(map(_is_about, content.values())):
        about = {name: value for name, value in content.items() if _is_about(value)}
        content = {name: value for name, value in content.items() if name not in about}
        content |= {name: part for value in about.values() for name, part in value.items() if name not in content}
    names = [name for name, value in content.items() if name in _NAMES or texts(_unwrap(value))]
    names = [name for name in names if not isinstance(content[name], dict)]
    beside = {name for name, value in content.items() if name in names or _is_single(value)}
    motions = {name: value for name, value in content.items() if name not in beside}
    if not motions or not all(isinstance(fields, dict) for fields in motions.values()):
        return content
    named, rates = {name: content[name] for name in names}, {name: content[name] for name in rate_fields(beside)}
    return {name: {**named, **({} if rate_fields(fields) else rates), **fields} for name, fields in motions.items()}


def _ungrouped(content: dict[Any, Any], stem: str) -> dict[Any, Any]:
    """Return what dictionaries of motions in a dictionary hold, as ``{"motions": {"walk": ...}}``, in one dictionary.

    Names of groups stand before those of their motions, unless they are such as *motions*. What holds for all may stand
    in a dictionary of its own.

    Args:
        content: of a file.
        stem: name of a motion that has no other.

    Raises:
        MotionError: for more motions than are believed of any file.
    """
    groups = {
        name: value
        for name, value in content.items()
        if isinstance(value, dict) and value and all(isinstance(fields, dict) for fields in value.values())
    }
    if not groups:
        return content
    if sum(map(len, groups.values())) > _MOST_GROUPED:
        raise MotionError(f"it names more than {_MOST_GROUPED} motions")
    found: dict[Any, Any] = {}
    for name, value in content.items():
        if name not in groups:
            found |= value if _is_about(value) else {name: value}
    labels, grouped = [], []
    for group, motions in groups.items():
        for name, fields in motions.items():
            parts = [str(part) for part in (group, name) if str(part).lower() not in _OF_ALL]
            labels.append("_".join(parts) or stem)
            grouped.append(fields)
    apart = distinct_names([*map(str, found), *labels])[len(found) :]
    return found | dict(zip(apart, grouped, strict=True))


def _is_about(value: Any) -> bool:
    """Return whether a value is a dictionary of single numbers and of texts, and no motion."""
    return isinstance(value, dict) and all(_is_single(part) or bool(texts(_unwrap(part))) for part in value.values())


def _is_single(value: Any) -> bool:
    """Return whether a value is one number or text, or a list of it."""
    value = _unwrap(value[0] if isinstance(value, list) and len(value) == 1 else value)
    return value.size == 1 if isinstance(value, np.ndarray) else isinstance(value, (str, int, float, type(None)))


def _rates(path: Path, fields: dict[str, Any]) -> list[StatedRate]:
    rates = rates_of_fields(fields)
    rates = rates or distinct_rates(stated_rates(path, []))
    if not rates:
        raise MotionError("no field 'fps', expected the frames a second (or state them: plat motions convert --fps)")
    return rates


def _array(fields: dict[str, Any], names: tuple[str, ...]) -> np.ndarray:
    present = [name for name in names if name in fields]
    if not present:
        raise MotionError(f"no field {' or '.join(map(repr, names))}, only {sorted(map(str, fields))[:20]}")
    array = _unwrap(fields[present[0]])
    if isinstance(array, list) and (rows := _rows(array)) is not None:
        return rows
    if isinstance(array, np.ndarray) and array.ndim == 3 and 1 in array.shape[::2]:
        # one of a batch, or a column for each joint
        array = array[0] if len(array) == 1 else array[..., 0]
    if not isinstance(array, np.ndarray):
        raise MotionError(f"{present[0]!r} is a {type(array).__name__}, expected an array")
    return array


def _rows(listed: list[Any]) -> np.ndarray | None:
    """Return the array of rows of equal length, each a list, a tuple or an array of numbers; None for other things."""
    rows = [_unwrap(row) for row in listed]
    rows = [row.tolist() if isinstance(row, np.ndarray) and row.ndim == 1 else row for row in rows]
    if not all(isinstance(row, (list, tuple)) for row in rows) or len({len(row) for row in rows}) != 1:
        return None
    fits = all(isinstance(value, (int, float)) for row in rows for value in row)
    return np.array(rows, dtype=np.float64) if fits else None


def _unwrap(value: Any) -> Any:
    return value.value if isinstance(value, PickledArray) else value


def _unwrapped(fields: Mapping[Any, Any]) -> dict[Any, Any]:
    """Return fields with arrays for what stands for them, also in dictionaries among them."""
    plain = {name: _unwrap(value) for name, value in fields.items()}
    return {
        name: {key: _unwrap(part) for key, part in value.items()} if isinstance(value, dict) else value
        for name, value in plain.items()
    }
