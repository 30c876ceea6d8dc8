"""BVH files: a skeleton and its motion, as the world positions of its joints."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from plat.errors import MotionError

__all__ = ["Bvh", "read_bvh", "rotation_about"]

_CHANNELS = tuple(f"{axis}{kind}" for kind in ("position", "rotation") for axis in "XYZ")


@dataclass(frozen=True)
class Bvh:
    """The motion of a skeleton of J joints over T frames.

    Attributes:
        names: of joints and end sites; the end site of ``Hand`` is called ``Hand_end``.
        parents: index of the parent of each, -1 for a root.
        positions: ``[T, J, 3]``, in the file's own units and world axes.
        rotations: ``[T, J, 3, 3]``, from the joint's axes to those of the world.
        fps: frames a second.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    positions: np.ndarray
    rotations: np.ndarray
    fps: float


@dataclass
class _Joint:
    name: str
    parent: int
    offset: np.ndarray
    channels: tuple[int, ...] = ()


def read_bvh(path: str | Path) -> Bvh:
    """Read a BVH file and work out where its joints are.

    A rotation is the product of the joint's rotation channels in the order of the file. A position channel takes the
    place of the joint's ``OFFSET`` along that axis, as the data sets that have such channels mean it.

    Raises:
        MotionError: naming file and line, when the file is missing, broken or cut short.

    >>> import tempfile
    >>> text = '''HIERARCHY
    ... ROOT hips
    ... {
    ...   OFFSET 0 0 0
    ...   CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
    ...   End Site
    ...   {
    ...     OFFSET 1 0 0
    ...   }
    ... }
    ... MOTION
    ... Frames: 1
    ... Frame Time: 0.02
    ... 0 90 0 90 0 0
    ... '''
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(folder, "turn.bvh").write_text(text)
    ...     bvh = read_bvh(Path(folder, "turn.bvh"))
    >>> bvh.names, bvh.fps, bvh.positions[0, 1].round(6).tolist()
    (('hips', 'hips_end'), 50.0, [0.0, 91.0, 0.0])
    """
    try:
        text = Path(path).read_text(encoding="utf-8-sig", errors="replace")
    except OSError as error:
        raise MotionError(f"BVH file {str(path)!r}: cannot be read ({error})") from error
    lines = _Lines(path, text)
    joints = _hierarchy(lines)
    values, fps = _motion(lines, sum(len(joint.channels) for joint in joints))
    positions, rotations = _forward_kinematics(joints, values)
    names, parents = zip(*((joint.name, joint.parent) for joint in joints), strict=True)
    return Bvh(names, parents, positions, rotations, fps)


class _Lines:
    """The words of the lines that are not empty, one line after the other."""

    def __init__(self, path: str | Path, text: str):
        self._path = path
        self._rows = [(number, row) for number, line in enumerate(text.splitlines(), 1) if (row := line.split())]
        self._next = 0

    def take(self, expected: str) -> list[str]:
        """Next line; ``expected`` says what it should be when the file ends here."""
        if self._next == len(self._rows):
            raise MotionError(f"BVH file {str(self._path)!r}: ends where {expected} was expected")
        self._next += 1
        return self._rows[self._next - 1][1]

    def rest(self) -> list[tuple[int, list[str]]]:
        """All that follow, with their line numbers."""
        return self._rows[self._next :]

    def wrong(self, expected: str, line: int | None = None) -> MotionError:
        """The error for the line that was taken last, or another one."""
        number, row = self._rows[self._next - 1]
        shown = "" if line else f"{' '.join(row)[:60]!r}, "
        return MotionError(f"BVH file {str(self._path)!r}, line {line or number}: {shown}expected {expected}")

    def numbers(self, words: list[str], count: int, expected: str) -> np.ndarray:
        """Words of the last line as finite numbers."""
        try:
            values = np.array([float(word) for word in words])
        except ValueError:
            raise self.wrong(expected) from None
        if len(values) != count or not np.isfinite(values).all():
            raise self.wrong(expected)
        return values


def _hierarchy(lines: _Lines) -> list[_Joint]:
    if lines.take("HIERARCHY") != ["HIERARCHY"]:
        raise lines.wrong("HIERARCHY")
    joints: list[_Joint] = []
    open_joints: list[int] = []
    while True:
        row = lines.take("the end of the hierarchy and MOTION")
        parent = open_joints[-1] if open_joints else -1
        if row[0] == "ROOT" or (row[0] == "JOINT" and open_joints):
            if len(row) < 2:
                raise lines.wrong("the name of a joint")
            _open(lines, joints, open_joints, " ".join(row[1:]), parent)
        elif row[:2] == ["End", "Site"] and open_joints:
            _open(lines, joints, open_joints, f"{joints[parent].name}_end", parent)
        elif row[0] == "OFFSET" and open_joints:
            joints[parent].offset = lines.numbers(row[1:], 3, "OFFSET with three numbers")
        elif row[0] == "CHANNELS" and open_joints:
            joints[parent].channels = _channels(lines, row)
        elif row == ["}"] and open_joints:
            open_joints.pop()
        elif row == ["MOTION"] and joints and not open_joints:
            return joints
        else:
            raise lines.wrong("ROOT, JOINT, End Site, OFFSET, CHANNELS, a closing brace or, after the last, MOTION")


def _open(lines: _Lines, joints: list[_Joint], open_joints: list[int], name: str, parent: int) -> None:
    if any(joint.name == name for joint in joints):
        raise lines.wrong(f"a name that differs from the others ({name!r} is there already)")
    if lines.take("an opening brace") != ["{"]:
        raise lines.wrong("an opening brace")
    open_joints.append(len(joints))
    joints.append(_Joint(name, parent, np.zeros(3)))


def _channels(lines: _Lines, row: list[str]) -> tuple[int, ...]:
    known = {name.lower(): index for index, name in enumerate(_CHANNELS)}
    names = [name.lower() for name in row[2:]]
    if row[1:2] != [str(len(names))] or not set(names) <= set(known):
        raise lines.wrong(f"CHANNELS, their number, and as many of {', '.join(_CHANNELS)}")
    return tuple(known[name] for name in names)


def _motion(lines: _Lines, width: int) -> tuple[np.ndarray, float]:
    """Channel values ``[T, width]`` and frames a second."""
    row = lines.take("'Frames:'")
    if row[0] != "Frames:" or len(row) != 2 or not row[1].isdecimal() or int(row[1]) < 1:
        raise lines.wrong("'Frames:' and a positive number")
    frames = int(row[1])
    row = lines.take("'Frame Time:'")
    if row[:2] != ["Frame", "Time:"]:
        raise lines.wrong("'Frame Time:' and seconds")
    seconds = float(lines.numbers(row[2:], 1, "'Frame Time:' and seconds")[0])
    if seconds <= 0:
        raise lines.wrong("a positive frame time")
    rows = lines.rest()
    for number, row in rows:
        if len(row) != width:
            raise lines.wrong(f"{width} numbers, one a channel, but there are {len(row)}", number)
    if len(rows) != frames:
        raise lines.wrong(f"{frames} frames as 'Frames:' says, but there are {len(rows)}", rows[-1][0] if rows else None)
    try:
        values = np.array([row for _, row in rows], dtype=np.float64)
    except ValueError:
        values = np.full((1, 1), np.nan)
    if not np.isfinite(values).all():
        number = next(number for number, row in rows if not _finite(row))
        raise lines.wrong("finite numbers", number)
    # files round the frame time: 0.0333333 is 30 frames a second
    fps = 1.0 / seconds
    return values, float(round(fps)) if abs(fps - round(fps)) < 1e-3 * fps else fps


def _finite(row: list[str]) -> bool:
    try:
        return all(np.isfinite(float(word)) for word in row)
    except ValueError:
        return False


def _forward_kinematics(joints: list[_Joint], values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions ``[T, J, 3]`` and rotations ``[T, J, 3, 3]``; parents stand before their children."""
    positions = np.empty((len(values), len(joints), 3))
    rotations = np.empty((len(values), len(joints), 3, 3))
    column = 0
    for index, joint in enumerate(joints):
        offset = np.tile(joint.offset, (len(values), 1))
        rotation = np.broadcast_to(np.eye(3), (len(values), 3, 3))
        for channel in joint.channels:
            if channel < 3:
                offset[:, channel] = values[:, column]
            else:
                rotation = rotation @ rotation_about(channel - 3, np.deg2rad(values[:, column]))
            column += 1
        if joint.parent >= 0:
            parent = rotations[:, joint.parent]
            offset = positions[:, joint.parent] + (parent @ offset[..., None])[..., 0]
            rotation = parent @ rotation
        positions[:, index], rotations[:, index] = offset, rotation
    return positions, rotations


def rotation_about(axis: int, angle: np.ndarray) -> np.ndarray:
    """Rotation matrices ``[T, 3, 3]`` by angles ``[T]`` (rad) about the x, y or z axis (0, 1, 2)."""
    matrix = np.zeros((len(angle), 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix[:, axis, axis] = 1
    matrix[:, i, i] = matrix[:, j, j] = np.cos(angle)
    matrix[:, j, i] = np.sin(angle)
    matrix[:, i, j] = -matrix[:, j, i]
    return matrix
