"""What the readers of all formats share."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from plat.errors import MotionError
from plat.motions.checks.feet import Soles
from plat.motions.clip import MotionClip
from plat.robots.robot import Robot

__all__ = ["MotionFile", "QuatOrder", "ReadOptions", "arrange_joints", "make_clip", "number", "strings"]

QuatOrder = Literal["wxyz", "xyzw"]

# Further than any motion goes, and still less than its numbers are in another unit.
_FARTHEST = 1000.0
_WIDEST = 4 * np.pi
_FPS = (1.0, 1000.0)


@dataclass(frozen=True)
class ReadOptions:
    """What the user says about files.

    Args:
        robot: whose motions they are.
        quat_order: order of the root quaternion, where the user states it.
        fps: frames a second, where the user states it.
    """

    robot: Robot
    quat_order: QuatOrder | None = None
    fps: float | None = None

    @cached_property
    def soles(self) -> Soles:
        """Of the robot; made once for all files."""
        return Soles(self.robot)


@dataclass(frozen=True)
class MotionFile:
    """A motion file that was read.

    Attributes:
        path: of the file.
        format: what it was taken for.
        clips: its motions.
        notes: what was assumed, detected or filled in, a phrase each.
    """

    path: Path
    format: str
    clips: list[MotionClip]
    notes: tuple[str, ...] = ()

    @property
    def facts(self) -> str:
        """Format, frame rate and notes in one line."""
        rates = sorted({round(clip.fps, 3) for clip in self.clips})
        return ", ".join((self.format, f"{'/'.join(f'{rate:g}' for rate in rates)} fps", *self.notes))


def arrange_joints(
    angles: np.ndarray, names: Sequence[str] | None, robot: Robot, field: str
) -> tuple[np.ndarray, list[str]]:
    """Joint angles ``[T, n]`` of a file in the robot's order ``[T, J]``, and notes on what was done.

    Joints are matched by ``names`` where the file has them; else they must stand in the robot's order. Wrists may be
    missing, as in files for the G1 with 23 joints: they get the default pose.

    Raises:
        MotionError: for another number of joints, or names that the robot does not have.
    """
    wrists = [name for name in robot.joint_names if "wrist" in name]
    without_wrists = [name for name in robot.joint_names if name not in wrists]
    if angles.ndim != 2 or angles.dtype.kind not in "fiu":
        raise MotionError(f"{field!r} has shape {angles.shape} and type {angles.dtype}, expected (frames, joints)")
    expected = f"{robot.num_joints} joints of {robot.name!r}"
    if names is None:
        known = {robot.num_joints: list(robot.joint_names), len(without_wrists): without_wrists}
        if angles.shape[1] not in known:
            raise MotionError(
                f"{field!r} has {angles.shape[1]} joints, expected the {expected}, "
                f"or {len(without_wrists)} without the wrists"
            )
        listed = known[angles.shape[1]]
    else:
        listed = [name.removesuffix("_joint") for name in names]
        missing, unknown = sorted(set(robot.joint_names) - set(listed)), sorted(set(listed) - set(robot.joint_names))
        if unknown or set(missing) not in (set(), set(wrists)):
            raise MotionError(f"'joint_names' lacks {missing} and has the unknown {unknown}, expected the {expected}")
        if len(listed) != angles.shape[1] or len(set(listed)) != len(listed):
            raise MotionError(
                f"'joint_names' has {len(listed)} names, expected one for each of {angles.shape[1]} joints"
            )
    arranged = np.tile(robot.default_joint_pos.numpy(), (len(angles), 1)).astype(np.float64)
    arranged[:, [robot.joint_names.index(name) for name in listed]] = angles
    notes = []
    if names is not None and listed != [name for name in robot.joint_names if name in listed]:
        notes.append("joints reordered by name")
    if len(listed) < robot.num_joints:
        notes.append("no wrists in the file: default pose")
    return arranged, notes


def make_clip(
    name: str,
    root_pos: np.ndarray,
    root_quat: np.ndarray,
    joint_pos: np.ndarray,
    fps: float,
    robot: Robot,
    quat_order: QuatOrder,
    fields: tuple[str, str],
) -> MotionClip:
    """A checked clip from the parts of a file; ``fields`` are what the file calls root position and quaternion.

    Raises:
        MotionError: for parts that do not fit together, are not in metres and radians, or an impossible frame rate.
    """
    for field, values, width in zip(fields, (root_pos, root_quat), (3, 4), strict=True):
        if values.shape != (len(joint_pos), width) or values.dtype.kind not in "fiu":
            raise MotionError(f"{field!r} has shape {values.shape}, expected {(len(joint_pos), width)} numbers")
    for what, values, most, unit in (
        (fields[0], root_pos, _FARTHEST, "metres"),
        ("joint angles", joint_pos, _WIDEST, "radians"),
    ):
        largest = np.abs(values[np.isfinite(values)]).max(initial=0.0)
        if largest > most:
            raise MotionError(f"{what!r} has values up to {largest:.4g}, expected {unit}")
    if not _FPS[0] <= fps <= _FPS[1]:
        raise MotionError(f"fps is {fps:g}, expected {_FPS[0]:g} to {_FPS[1]:g} frames a second")
    if quat_order == "xyzw":
        root_quat = root_quat[:, [3, 0, 1, 2]]
    return MotionClip(name, np.concatenate((root_pos, root_quat, joint_pos), 1), fps).checked(robot)


def number(value: Any, field: str) -> float:
    """A number from a scalar or an array that holds one."""
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.item()
    if not isinstance(value, (int, float)):
        raise MotionError(f"{field!r} is of type {type(value).__name__}, expected one number")
    return float(value)


def strings(value: Any, field: str) -> list[str]:
    """Names from an array or list of strings."""
    listed = value.ravel().tolist() if isinstance(value, np.ndarray) else value
    if not isinstance(listed, (list, tuple)) or not all(isinstance(name, str) for name in listed):
        raise MotionError(f"{field!r} is not a list of names")
    return list(listed)
