"""BVH files: a skeleton and its motion, as the world positions of its joints."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from plat.errors import MotionError
from plat.rotations_np import axis_rotation

__all__ = ["Bvh", "read_bvh"]

_CHANNELS = ("xposition", "yposition", "zposition", "xrotation", "yrotation", "zrotation")


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
    index: int
    name: str
    parent: int
    offset: Sequence[float] = (0.0, 0.0, 0.0)
    channels: Sequence[int] = ()


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
        self._taken = 0

    def __bool__(self) -> bool:
        return self._taken < len(self._rows)

    def take(self, expected: str) -> list[str]:
        """Next line; ``expected`` says what it should be when the file ends here."""
        if not self:
            raise MotionError(f"BVH file {str(self._path)!r}: ends where {expected} was expected")
        self._taken += 1
        return self._rows[self._taken - 1][1]

    def wrong(self, expected: str) -> MotionError:
        """The error for the line that was taken last."""
        number, row = self._rows[self._taken - 1]
        return MotionError(f"BVH file {str(self._path)!r}, line {number}: {' '.join(row)[:60]!r}, expected {expected}")

    def numbers(self, words: list[str], count: int, expected: str) -> list[float]:
        """Words of the line that was taken last as ``count`` finite numbers."""
        try:
            values = [float(word) for word in words]
        except ValueError:
            values = []
        if len(values) != count or not all(map(math.isfinite, values)):
            raise self.wrong(expected)
        return values


def _hierarchy(lines: _Lines) -> list[_Joint]:
    if lines.take("HIERARCHY") != ["HIERARCHY"]:
        raise lines.wrong("HIERARCHY")
    joints: dict[str, _Joint] = {}
    inside: list[_Joint] = []
    while True:
        row = lines.take("the rest of the hierarchy, then MOTION")
        if row == ["MOTION"] and joints and not inside:
            return list(joints.values())
        if row[0] == "ROOT" or (inside and row[0] == "JOINT"):
            joint = _Joint(len(joints), " ".join(row[1:]), inside[-1].index if inside else -1)
        elif inside and row[0] == "End":
            joint = _Joint(len(joints), f"{inside[-1].name}_end", inside[-1].index)
        else:
            if inside and row[0] == "OFFSET":
                inside[-1].offset = lines.numbers(row[1:], 3, "OFFSET with three numbers")
            elif inside and row[0] == "CHANNELS":
                inside[-1].channels = _channels(lines, row)
            elif inside and row == ["}"]:
                inside.pop()
            else:
                raise lines.wrong("ROOT, JOINT, End Site, OFFSET, CHANNELS, a closing brace or, after the last, MOTION")
            continue
        if not joint.name or joint.name in joints:
            raise lines.wrong("a name that no other joint has")
        if lines.take("an opening brace") != ["{"]:
            raise lines.wrong("an opening brace")
        joints[joint.name] = joint
        inside.append(joint)


def _channels(lines: _Lines, row: list[str]) -> list[int]:
    names = [name.lower() for name in row[2:]]
    if row[1:2] != [str(len(names))] or not set(names) <= set(_CHANNELS):
        raise lines.wrong(f"CHANNELS, their number, and as many of {', '.join(_CHANNELS)}")
    return [_CHANNELS.index(name) for name in names]


def _motion(lines: _Lines, width: int) -> tuple[np.ndarray, float]:
    """Channel values ``[T, width]`` and frames a second."""
    row = lines.take("'Frames:'")
    if row[0] != "Frames:" or len(row) != 2 or not row[1].isdecimal() or int(row[1]) < 1:
        raise lines.wrong("'Frames:' and a positive number")
    frames = int(row[1])
    row = lines.take("'Frame Time:'")
    seconds = lines.numbers(row[2:], 1, "'Frame Time:' and seconds")[0]
    if row[:2] != ["Frame", "Time:"] or seconds <= 0:
        raise lines.wrong("'Frame Time:' and positive seconds")
    values: list[list[float]] = []
    while len(values) < frames:
        row = lines.take(f"frame {len(values) + 1} of {frames}")
        values.append(lines.numbers(row, width, f"{width} finite numbers, one a channel"))
    if lines:
        lines.take("")
        raise lines.wrong(f"the end, for 'Frames:' says {frames}")
    # files round the frame time: 0.0333333 is 30 frames a second
    fps = 1.0 / seconds
    return np.array(values), float(round(fps)) if abs(fps - round(fps)) < 1e-3 * fps else fps


def _forward_kinematics(joints: list[_Joint], values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions ``[T, J, 3]`` and rotations ``[T, J, 3, 3]``; parents stand before their children."""
    positions = np.empty((len(values), len(joints), 3))
    rotations = np.empty((len(values), len(joints), 3, 3))
    column = 0
    for joint in joints:
        offset = np.tile(joint.offset, (len(values), 1))
        rotation = np.broadcast_to(np.eye(3), (len(values), 3, 3))
        for channel in joint.channels:
            if channel < 3:
                offset[:, channel] = values[:, column]
            else:
                rotation = rotation @ axis_rotation(channel - 3, np.deg2rad(values[:, column]))
            column += 1
        if joint.parent >= 0:
            parent = rotations[:, joint.parent]
            offset = positions[:, joint.parent] + (parent @ offset[..., None])[..., 0]
            rotation = parent @ rotation
        positions[:, joint.index], rotations[:, joint.index] = offset, rotation
    return positions, rotations
