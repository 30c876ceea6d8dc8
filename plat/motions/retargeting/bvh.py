"""BVH files: a skeleton and its motion, as the world positions of its joints."""

import math
import re
from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from plat.errors import MotionError
from plat.files import decoded
from plat.motions.formats.units import Angles
from plat.motions.retargeting.mocap import Mocap, check_extent, checked_rate, may_be_radians, reads_better
from plat.rotations_np import axis_rotation
from plat.words import counted

__all__ = ["read_bvh"]

_DECIMAL_POINT = re.compile(r"\d\.\d")
_DECIMAL_COMMA = re.compile(r"(?<=\d),(?=\d)")
_CHANNELS = ("xposition", "yposition", "zposition", "xrotation", "yrotation", "zrotation")


@dataclass
class _Joint:
    index: int
    name: str
    parent: int
    offset: Sequence[float] = (0.0, 0.0, 0.0)
    channels: Sequence[int] = ()


def read_bvh(path: str | Path, fps: float | None = None, angles: Angles | None = None) -> Mocap:
    """Read a BVH file and work out where its joints are.

    A rotation is the product of the joint's rotation channels in the order of the file. A position channel takes the
    place of the joint's ``OFFSET`` along that axis, as the data sets that have such channels mean it. The frames that
    follow count, whatever ``Frames:`` says. Of several roots a note tells.

    Args:
        path: the file.
        fps: frames a second, where the user states them; else ``Frame Time`` does.
        angles: their unit, where the user states it; else degrees, unless a body moves so in radians alone.

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
        data = Path(path).read_bytes()
    except OSError as error:
        raise MotionError(f"BVH file {str(path)!r}: cannot be read ({error})") from error
    text, told = _with_points(decoded(data))
    lines = _Lines(path, text)
    joints = _hierarchy(lines)
    values, seconds, notes = _motion(lines, sum(len(joint.channels) for joint in joints), timed=fps is None)
    rate = fps or checked_rate(path, seconds)
    if fps is None and abs(rate * seconds - 1) > 1e-3:
        notes = (*notes, f"{rate:g} fps assumed for the rounded 'Frame Time' {seconds:g}")
    check_extent(f"BVH file {str(path)!r}", len(joints), len(values), len(text))
    positions, rotations, of_angles = _settled(joints, values, angles)
    bodies = sum(joint.parent < 0 for joint in joints)
    of_bodies = (f"one of {bodies} skeletons in the file",) if bodies > 1 else ()
    notes = (*told, *notes, *of_angles, *of_bodies)
    names, parents = zip(*((joint.name, joint.parent) for joint in joints), strict=True)
    rest = np.zeros((len(joints), 3))
    for joint in joints:
        rest[joint.index] = np.add(joint.offset, rest[joint.parent] if joint.parent >= 0 else 0.0)
    return Mocap(names, parents, positions, rotations, rate, rest, notes)


def _with_points(text: str) -> tuple[str, tuple[str, ...]]:
    """Return a text with points for decimal commas, as programs of some countries write them, and a note on that.

    A comma among points is no such thing.
    """
    if _DECIMAL_COMMA.search(text) and not _DECIMAL_POINT.search(text):
        return _DECIMAL_COMMA.sub(".", text), ("decimal commas",)
    return text, ()


class _Lines:
    """The words of the lines that are not empty, one line after the other.

    Lines are split when they are taken: the words of an hour of motion would fill gigabytes.
    """

    def __init__(self, path: str | Path, text: str):
        self._path = path
        self._rows = (
            (number, row) for number, line in enumerate(text.splitlines(), 1) for row in _split_braces(line.split())
        )
        self._last: tuple[int, list[str]] = (0, [])
        self._following = next(self._rows, None)

    def __bool__(self) -> bool:
        return self._following is not None

    def take(self, expected: str) -> list[str]:
        """Return the next line; ``expected`` says what it should be when the file ends here."""
        if self._following is None:
            raise MotionError(f"BVH file {str(self._path)!r}: ends where {expected} was expected")
        self._last, self._following = self._following, next(self._rows, None)
        return self._last[1]

    def wrong(self, expected: str) -> MotionError:
        """Return the error for the line that was taken last."""
        number, row = self._last
        return MotionError(f"BVH file {str(self._path)!r}, line {number}: {' '.join(row)[:60]!r}, expected {expected}")

    def numbers(self, words: list[str], count: int, expected: str) -> list[float]:
        """Return the words of the line that was taken last as ``count`` finite numbers."""
        try:
            values = [float(word) for word in words]
        except ValueError:
            values = []
        if len(values) == count and all(map(math.isfinite, values)):
            return values
        odd = next((repr(word)[:40] for word in words if not _is_finite(word)), str(len(words)))
        raise self.wrong(f"{expected}, found {odd}" if words else expected)


def _is_finite(word: str) -> bool:
    try:
        return math.isfinite(float(word))
    except ValueError:
        return False


def _split_braces(words: list[str]) -> list[list[str]]:
    """Return the words of a line as lines of which a brace is one of its own."""
    rows: list[list[str]] = [[]]
    for word in words:
        if word in ("{", "}"):
            rows += [[word], []]
        else:
            rows[-1].append(word)
    return [row for row in rows if row]


def _hierarchy(lines: _Lines) -> list[_Joint]:
    if [word.upper() for word in lines.take("HIERARCHY")] != ["HIERARCHY"]:
        raise lines.wrong("HIERARCHY")
    joints: dict[str, _Joint] = {}
    inside: list[_Joint] = []
    while True:
        row = lines.take("the rest of the hierarchy, then MOTION")
        keyword = row[0].upper()
        if keyword == "MOTION" and len(row) == 1 and joints and not inside:
            return list(joints.values())
        if keyword == "ROOT" or (inside and keyword == "JOINT"):
            joint = _Joint(len(joints), " ".join(row[1:]), inside[-1].index if inside else -1)
        elif inside and keyword == "END":
            joint = _Joint(len(joints), f"{inside[-1].name}_end", inside[-1].index)
        else:
            if inside and keyword == "OFFSET":
                inside[-1].offset = lines.numbers(row[1:], 3, "OFFSET with three numbers")
            elif inside and keyword == "CHANNELS":
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


def _motion(lines: _Lines, width: int, timed: bool) -> tuple[np.ndarray, float, tuple[str, ...]]:
    """Return channel values ``[T, width]``, the frame time (s; 0 where none is asked for), and notes."""
    told = re.fullmatch(r"frames\s*:\s*(\d+)", " ".join(lines.take("'Frames:'")), re.IGNORECASE)
    if not told or int(told[1]) < 1:
        raise lines.wrong("'Frames:' and a positive number")
    row = re.fullmatch(r"frame\s*time\s*:\s*(\S+)(?: s)?", " ".join(lines.take("'Frame Time:'")), re.IGNORECASE)
    seconds, expected = 0.0, "'Frame Time:' and positive seconds (or state the rate: plat motions convert --fps)"
    if timed or not row:
        seconds = lines.numbers([row[1]] if row else [], 1, expected)[0]
        if seconds <= 0:
            raise lines.wrong(expected)
    values = array("d", lines.numbers(lines.take("frame 1"), width, f"{width} finite numbers, one a channel"))
    frames = 1
    while lines:
        row_of_values = lines.take("")
        values.extend(lines.numbers(row_of_values, width, f"{width} finite numbers, one a channel"))
        frames += 1
    count = int(told[1])
    notes = () if frames == count else (f"{counted(frames, 'frame')}, for 'Frames:' says {count}",)
    return np.array(values).reshape(frames, width), seconds, notes


def _settled(
    joints: list[_Joint], values: np.ndarray, angles: Angles | None
) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Return positions, rotations and a note, with angles in the unit that is stated, or that the motion shows."""
    turns = np.array([channel >= len("xyz") for joint in joints for channel in joint.channels])
    if angles == "radians" or (angles is None and may_be_radians(values[:, turns])):
        radians = _forward_kinematics(joints, np.where(turns, np.rad2deg(values), values))
        if angles == "radians":
            return *radians, ()
        degrees = _forward_kinematics(joints, values)
        if reads_better(radians[0], degrees[0], [joint.parent for joint in joints]):
            return *radians, ("angles in radians: in degrees nobody stands or moves so",)
        largest = np.abs(values[:, turns]).max()
        return *degrees, (
            f"angles in degrees, as BVH has them, though none is above {largest:.2g} (else: "
            "plat motions convert --angles)",
        )
    return *_forward_kinematics(joints, values), ()


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
