"""Which columns of a table are the root, which the joints, and which neither."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from plat.errors import MotionError
from plat.motions.formats.clock import counts_frames, numbering_fault
from plat.motions.formats.joint_orders import usual_orders
from plat.motions.formats.quaternion_order import QuatOrder
from plat.motions.formats.spellings import (
    Column,
    classify_columns,
    different_words,
    is_generic,
    stated_length,
    stating,
    tokens,
    units_in_comments,
)
from plat.motions.formats.text_tables import Table
from plat.motions.formats.turns import EULER, euler_to_quat, turns_of_three
from plat.motions.formats.units import METERS, Units, must_be_radians
from plat.motions.formats.unnamed_joints import OPTIONAL, without_wrists
from plat.robots.robot import Robot
from plat.words import counted

__all__ = ["TableColumns", "is_pose", "place_first", "split_columns"]

# Nobody turns so far from frame to frame in a quarter of all frames (rad).
_FASTEST_TURN = 0.15
# what a header calls the root's columns in BONES-SEED's tables, which are in cm and degrees
_SEED = {"translate", "rotate"}
# words for a number of frames, which goes on in a motion, and of motions, which does not change
_FRAME = {"frame", "frames", "step"}
_SEVERAL = {"episode", "clip", "motion", "sequence", "take", "trial", "traj", "trajectory"}
# words of how long a frame takes, and how much even ones may waver
_LENGTHS = {"dt", "timestep", "step", "delta", "frame"}
_EVEN = 0.2
# seconds and the rest of them in two columns; clocks that go on while a simulation waits
_SECONDS, _NANOSECONDS = {"sec", "secs"}, {"nsec", "nsecs", "nanosec", "nanosecs"}
_OF_WALLS = {"wall", "system", "host", "recv", "received", "receive", "log", "rosbag"}
# share of the steps of a count that are its usual one, whatever the column is called
_MOST = 0.8
# columns that may stand before the root: a counter, the time
_MOST_BEFORE = 2
# what lengths of quaternions may differ by rounding
_SAME_LENGTH = 1e-4
# words of what may stand for the root, and beside it is none
_NEAR_ROOT = {"torso", "trunk", "odom", "odometry"}
# words that only Euler angles have in their names
_NAMED_ANGLES = {"roll", "pitch", "yaw", "euler"}
_DEGREES, _RADIANS = {"deg", "degree", "degrees"}, {"rad", "radian", "radians"}


@dataclass(frozen=True)
class TableColumns:
    """The columns of a table by what they are, not converted.

    Attributes:
        place: of the root ``[T, 3]``.
        quat: of the root ``[T, 4]``.
        joints: angles ``[T, n]``.
        names: of the joints, where the header gives them.
        order: of ``quat``, where the header gives it.
        times: of the frames ``[T]`` and their unit, where there are any.
        seed: whether the header is that of BONES-SEED.
        notes: what was left out or assumed.
        turn: what three columns of an orientation, of which ``quat`` was made, were read as; empty for a quaternion.
        turns: quaternions ``[T, 4]`` (``wxyz``) of three columns by what they may be, the usual one first; none where
            the file has quaternions, or names its angles.
        units: of ``place``, where the header or comments state them.
    """

    place: np.ndarray
    quat: np.ndarray
    joints: np.ndarray
    names: list[str] | None = None
    order: QuatOrder | None = None
    times: tuple[np.ndarray, str] | None = None
    seed: bool = False
    notes: tuple[str, ...] = ()
    turn: str = ""
    turns: Mapping[str, np.ndarray] = field(default_factory=dict)
    units: Units | None = None


def split_columns(table: Table, robot: Robot) -> TableColumns:
    """Return the parts of a table, found by its header as far as that says them, else by place.

    Raises:
        MotionError: for a number of columns that no layout has, or names that are not understood.
    """
    kinds = classify_columns(table.header, robot) if table.header else []
    _refuse_several(table, kinds)
    counters, times = _counters(table, kinds)
    by_kind = {
        kind: [n for n, column in enumerate(kinds) if column.kind == kind] for kind in ("place", "quat", "euler")
    }
    by_kind = {kind: _of_root(table.header, found, 4 if kind == "quat" else 3) for kind, found in by_kind.items()}
    place = _axes(kinds, by_kind["place"], "xyz")
    turn = _axes(kinds, by_kind["quat"], "wxyz") or _axes(kinds, by_kind["euler"], "xyz")
    joints = [n for n, column in enumerate(kinds) if column.kind == "joint"]
    left_out = [n for n in range(table.values.shape[1]) if n not in counters]
    if place and turn and len(joints) > len(robot.joint_names) // 2:
        rest = [n for n in left_out if n not in (*place, *turn, *joints)]
        return _by_name(table, kinds, place, turn, joints, rest, times, robot)
    root = [*place, *_as_listed(kinds, turn)] if place and len(turn) == 4 else []
    at = left_out.index(root[0]) if root else 0
    if left_out[at : at + len(root)] != root or at > _MOST_BEFORE:
        left_out = [*root, *(n for n in left_out if n not in root)]
    return _by_place(table, kinds, [n for n in left_out if not kinds or kinds[n].kind != "derived"], times, robot)


def _by_name(
    table: Table,
    kinds: list[Column],
    place: list[int],
    turn: list[int],
    joints: list[int],
    rest: list[int],
    times: tuple[np.ndarray, str] | None,
    robot: Robot,
) -> TableColumns:
    values = table.values
    _refuse_empty(table, [*place, *turn, *joints])
    said = units_in_comments(table.comments)
    unknown = [table.header[n] for n in rest if kinds[n].kind == "unknown"]
    lacking = [name for name in robot.joint_names if name not in {kinds[n].part for n in joints}]
    lacking = [name for name in lacking if "wrist" not in name and name not in OPTIONAL]
    if lacking and unknown:
        raise MotionError(f"the header has the unknown {sorted(unknown)[:8]} and lacks the joints {lacking[:8]}")
    notes: list[str] = []
    told, turns = "", dict[str, np.ndarray]()
    if rest:
        shown = ", ".join(repr(table.header[n]) for n in rest[:3])
        notes.append(f"{counted(len(rest), 'column')} left out ({shown}{', ...' if len(rest) > 3 else ''})")
    seed = {word for n in (*place, *turn) for word in tokens(table.header[n])} >= _SEED
    if len(turn) == 4:
        turn = _as_listed(kinds, turn)
        quat, order = values[:, turn], "".join(kinds[n].part for n in turn)
    else:
        named = seed or any(set(tokens(table.header[n])) & _NAMED_ANGLES for n in turn)
        turns = _turns(values[:, turn], stating([table.header[n] for n in turn], said.root), seed, named)
        told, quat = next(iter(turns.items()))
        order = "wxyz"
        turns = {} if len(turns) == 1 else turns
    names = [kinds[n].part for n in joints]
    stated = stating([table.header[n] for n in joints], said.joints)
    angles, more = _in_radians(values[:, joints], stated, [names], robot, seed)
    notes += more
    at, units = _in_one_unit(values[:, place], stating([table.header[n] for n in place], said.length))
    return TableColumns(at, quat, angles, names, order, times, seed, tuple(notes), told, turns, units)  # type: ignore[arg-type]


def _in_radians(
    angles: np.ndarray, stated: Sequence[str], orders: Sequence[Sequence[str]], robot: Robot, seed: bool = False
) -> tuple[np.ndarray, list[str]]:
    """Return joint angles ``[T, n]`` in radians where their columns state degrees, and notes; else as they are.

    Args:
        angles: of the joints.
        stated: names of the columns, with their units.
        orders: names of the joints; several where the table names none.
        robot: whose joints they are.
        seed: whether the table is one of BONES-SEED.
    """
    in_degrees = any(_DEGREES & set(tokens(name)) for name in stated)
    if in_degrees and any(must_be_radians(angles, names, robot) for names in orders):
        return angles, [
            f"joint angles in radians, though the file says degrees: none is above {np.abs(angles).max():.2g}"
        ]
    if not in_degrees and not (seed and np.abs(angles).max() > np.pi):
        return angles, []
    kept = np.array([bool(_RADIANS & set(tokens(name))) for name in stated])
    angles = np.where(in_degrees and kept, angles, np.deg2rad(angles))
    return angles, ["some joint angles in degrees, as the header says" if kept.any() else "joint angles in degrees"]


def _turns(values: np.ndarray, header: Sequence[str], seed: bool, named: bool) -> dict[str, np.ndarray]:
    """Return the quaternions ``[T, 4]`` that three columns may be, by what they are called, the usual one first.

    Args:
        values: ``[T, 3]``.
        header: their names.
        seed: whether they are those of BONES-SEED.
        named: whether they are called angles.
    """
    units: tuple[str, ...] = ("radians", "degrees")
    words = {word for name in header for word in tokens(name)}  # what they state comes first
    if seed or np.abs(values).max() > 2 * np.pi or _whirls(values):
        units = ("degrees",)
    elif words & _DEGREES:
        units = ("degrees", "radians")
    elif words & _RADIANS:
        units = ("radians",)
    turns: dict[str, np.ndarray] = {}
    for unit in units:
        angles = np.deg2rad(values) if unit == "degrees" else values
        found = {EULER: euler_to_quat(angles)} if named else turns_of_three(angles)
        turns |= {f"{told} in {unit}": quat for told, quat in found.items()}
    return turns


def _by_place(
    table: Table, kinds: list[Column], columns: list[int], times: tuple[np.ndarray, str] | None, robot: Robot
) -> TableColumns:
    values = table.values[:, columns]
    notes: list[str] = []
    sizes = (robot.num_joints, len(without_wrists(robot)))
    joints = values.shape[1] - 7
    usual = (*sizes, 2 * sizes[0] + 6)  # with velocities
    for before in range(1, _MOST_BEFORE + 1):
        if joints not in usual and joints - before in usual and all(_even(values[:, n]) for n in range(before)):
            # first columns that go on evenly and are no coordinates: a counter, or the time
            first, values = values[:, :before], values[:, before:]
            columns, joints = columns[before:], joints - before
            for column in first.T:
                if not counts_frames(column):
                    times = (column, "")
            break
    if not table.header and joints == 2 * sizes[0] + 6:
        values, columns, joints = values[:, : 7 + sizes[0]], columns[: 7 + sizes[0]], sizes[0]
        notes.append(f"the last {sizes[0] + 6} columns left out (velocities)")
    if not table.header and joints == sizes[0] + 7 and is_pose(place_first(values[:, -7:])[0]):
        values, columns, joints = values[:, :-7], columns[:-7], sizes[0]
        notes.append("the last 7 columns left out (an object)")
    if not table.header and joints in sizes:
        values, found = place_first(values)
        notes += found
    if joints not in sizes:
        all_columns, left = table.values.shape[1], values.shape[1]
        told = f", {left} without counts, times and what is derived" if left < all_columns else ""
        raise MotionError(
            f"row 1 has {counted(all_columns, 'column')}{told}, expected {7 + sizes[0]} "
            f"(root xyz, quaternion, joints), {7 + sizes[1]} without the wrists, or a header that names them"
        )
    names = None
    if table.header:
        listed = [table.header[n] for n in columns[7:]]
        if any(kinds[n].kind == "joint" for n in columns[7:]):
            names = listed
        elif (all(map(is_generic, listed)) and not different_words(listed)) or _are_numbered(listed):
            notes.append("the header names no joints: the robot's order")
        else:
            odd = sorted({name for name in listed if not is_generic(name)} | different_words(listed))
            raise MotionError(f"the header has the unknown {odd[:8]}, expected names of the robot's joints, or none")
    order = _order(table.header, columns[3:7])
    _refuse_empty(table, columns)
    header = [table.header[n] if table.header else "" for n in columns]
    said = units_in_comments(table.comments)
    place, units = _in_one_unit(values[:, :3], stating(header[:3], said.length))
    orders = [
        [name for name in listed if joints == robot.num_joints or "wrist" not in name]
        for listed in (robot.joint_names, *usual_orders(robot).values())
    ]
    angles, found = _in_radians(values[:, 7:], stating(header[7:], said.joints), orders, robot)
    notes += found
    return TableColumns(place, values[:, 3:7], angles, names, order, times, notes=tuple(notes), units=units)


def _in_one_unit(place: np.ndarray, names: Sequence[str]) -> tuple[np.ndarray, Units | None]:
    """Return places ``[T, 3]`` and the unit that the names of their columns state: meters where each has another."""
    stated = [stated_length([name]) for name in names]
    if None in stated or len(set(stated)) == 1:
        return place, stated_length(names)
    return place * [METERS[unit] for unit in stated if unit is not None], "m"


def _refuse_empty(table: Table, columns: Sequence[int]) -> None:
    for n in columns:
        if n in table.empty:
            name = f" ({table.header[n]!r:.40})" if table.header else ""
            raise MotionError(f"row {table.empty[n]}, column {n + 1}{name} is empty, expected a number")


def _are_numbered(names: Sequence[str]) -> bool:
    """Return whether names are the same but for numbers that count up: ``state.position3``, ``state.position4``."""
    found = [re.fullmatch(r"(\D*)(\d+)(\D*)", name) for name in names]
    parts = [match.groups() for match in found if match is not None]
    counts = [int(number) for _, number, _ in parts]
    alike = len(parts) == len(names) and len({(before, after) for before, _, after in parts}) == 1
    return alike and counts == list(range(counts[0], counts[0] + len(counts)))


def _whirls(angles: np.ndarray) -> bool:
    """Return whether angles would turn a root faster than any body, if they were in radians."""
    steps = np.abs((np.diff(angles, axis=0) + np.pi) % (2 * np.pi) - np.pi)
    return len(steps) > 1 and float(np.quantile(steps.max(1), 0.75)) > _FASTEST_TURN


def _counters(table: Table, kinds: Sequence[Column]) -> tuple[list[int], tuple[np.ndarray, str] | None]:
    """Return the columns that count frames or tell the time, and the times: of several clocks one that goes evenly."""
    counters, clocks = [], []
    for n, column in enumerate(kinds):
        values = table.values[:, n]
        if column.kind == "time":
            counters.append(n)
            values = _times_of_steps(values) if set(tokens(table.header[n])) & _LENGTHS else values
            if not counts_frames(values, column.part):
                clocks.append((n, values, column.part))
        elif column.kind == "count" and (table.header[n] or (n == 0 and _even(values))):
            counters.append(n)
    found = {n: set(tokens(table.header[n])) for n, _, _ in clocks}
    whole = next((values for n, values, _ in clocks if found[n] & _SECONDS), None)
    parts = next((values for n, values, _ in clocks if found[n] & _NANOSECONDS), None)
    if whole is not None and parts is not None and parts.max() < 1e9:
        return counters, (whole - whole[0] + 1e-9 * parts, "s")  # as ROS has them
    clocks.sort(key=lambda clock: bool(found[clock[0]] & _OF_WALLS))
    usual = next((clock for clock in clocks if _even(clock[1])), clocks[0] if clocks else None)
    return counters, None if usual is None else usual[1:]


def _times_of_steps(values: np.ndarray) -> np.ndarray:
    """Return times for a column that has how long each frame takes, as ``dt``; else the column."""
    rest = values[1:]
    lengths = len(rest) > 1 and rest.min() > 0 and (np.diff(rest) <= 0).any() and np.ptp(rest) < _EVEN * rest.mean()
    return np.arange(len(values)) * rest.mean() if lengths else values


def _refuse_several(table: Table, kinds: Sequence[Column]) -> None:
    """Raise where a column says that a table holds several motions, lacks frames, or has some twice.

    Raises:
        MotionError: naming the column, and the row after which it does not go on.
    """
    for n, column in enumerate(kinds):
        name, values = table.header[n], table.values[:, n]
        words = set(tokens(name))
        fault = None
        if column.kind == "count":
            fault = numbering_fault(values) if words & _FRAME or _counts_up(values) else None
        elif column.kind != "time" and words & _SEVERAL and (anew := _begins_anew(values)).any():
            fault = int(anew.argmax()), "are these several motions? Write a file for each"
        if fault is not None:
            row, what = fault
            raise MotionError(
                f"column {n + 1} ({name!r:.40}) goes from {values[row]:g} to {values[row + 1]:g} after frame {row}: "
                f"{what}, or leave the column out"
            )


def _begins_anew(values: np.ndarray) -> np.ndarray:
    """Return where the number of a motion changes ``[T - 1]``; what changes all the time is none."""
    anew = np.diff(values) != 0
    return anew & bool((values % 1 == 0).all() and anew.sum() < len(values) / 2)


def _counts_up(values: np.ndarray) -> bool:
    """Return whether numbers are whole and most of them go on by one step: a count, and no number of something."""
    steps = np.diff(values)
    found, counts = np.unique(steps, return_counts=True)
    usual = counts.argmax() if len(steps) else 0
    return len(steps) > 0 and bool((values % 1 == 0).all() and found[usual] > 0 and counts[usual] > _MOST * len(steps))


def _of_root(header: Sequence[str], columns: list[int], count: int) -> list[int]:
    """Return the columns of the root, where more than so many may be: those of a torso beside it are not."""
    if len(columns) <= count:
        return columns
    return [n for n in columns if not set(tokens(header[n])) & _NEAR_ROOT] or columns


def _axes(kinds: Sequence[Column], columns: list[int], axes: str) -> list[int]:
    """Return the columns in the order of the axes, or nothing where they are not these, each once."""
    found = {kinds[n].part: n for n in columns}
    return [found[axis] for axis in axes] if len(columns) == len(axes) == len(found) and set(found) == set(axes) else []


def place_first(values: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Return columns that begin with a pose with its place before its quaternion, and a note if they had it behind.

    So Drake lists them, and with it the data set of OmniRetarget.

    >>> place_first(np.array([[1.0, 0, 0, 0, 2, 3, 0.7, 5], [1, 0, 0, 0, 2, 3, 0.8, 5]]))[0][0]
    array([2. , 3. , 0.7, 1. , 0. , 0. , 0. , 5. ])
    """
    if is_pose(values[:, :7]) or not is_pose(values[:, [4, 5, 6, 0, 1, 2, 3]]):
        return values, []
    first, behind = (np.linalg.norm(values[:, start : start + 4], axis=1) for start in (0, 3))
    if np.ptp(first) > np.ptp(behind) + _SAME_LENGTH:  # quaternions of another length, at a place that is one by chance
        return values, []
    return values[:, [4, 5, 6, 0, 1, 2, 3, *range(7, values.shape[1])]], ["the root's quaternion before its place"]


def _as_listed(kinds: Sequence[Column], turn: list[int]) -> list[int]:
    """Return the columns of a quaternion as the table has them, if that is ``wxyz`` or ``xyzw``; else as ``wxyz``."""
    return sorted(turn) if "".join(kinds[n].part for n in sorted(turn)) in ("wxyz", "xyzw") else turn


def is_pose(values: np.ndarray) -> bool:
    """Return whether seven columns are a place and a unit quaternion."""
    return bool(np.abs(np.linalg.norm(values[:, 3:], axis=1) - 1).max(initial=0.0) < 0.01)


def _even(values: np.ndarray) -> bool:
    steps = np.diff(values)
    return len(steps) > 0 and steps[0] > 0 and bool(np.abs(steps - steps.mean()).max() < _EVEN * steps.mean())


def _order(header: list[str], columns: list[int]) -> QuatOrder | None:
    order = "".join(header[n][-1:].lower() for n in columns) if header else ""
    return order if order in ("wxyz", "xyzw") else None  # type: ignore[return-value]
