"""What the readers of all formats share."""

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np

from plat.bounds import Bounded, Range
from plat.errors import ConfigError, MotionError
from plat.json_file import short
from plat.motions.checks.feet import Soles
from plat.motions.clip import MotionClip
from plat.motions.formats.axes import Up, z_up
from plat.motions.formats.joint_columns import robot_columns
from plat.motions.formats.units import (
    Angles,
    Converted,
    Units,
    angles_in_radians,
    place_in_meters,
    unit_quaternions,
)
from plat.motions.formats.unnamed_joints import unnamed_joints
from plat.robots.robot import Robot
from plat.words import counted

__all__ = [
    "FPS",
    "OTHER_ORDER",
    "FrameRate",
    "MotionFile",
    "QuatOrder",
    "ReadOptions",
    "arrange_joints",
    "check_rate",
    "make_clip",
    "number",
    "of_motion",
    "other_angles",
    "strings",
]

QuatOrder = Literal["wxyz", "xyzw"]

OTHER_ORDER = "joints in another order than the robot's: only so are its poses likely"
"""Note of some of a robot's joints, without names."""

FPS = (1, 1000)
"""Least and most frames a second of a motion."""

FrameRate: TypeAlias = Annotated[float, Range(*FPS)]
"""Frames a second that a motion may have."""


@dataclass(frozen=True)
class ReadOptions(Bounded):
    """What the user says about files.

    Args:
        robot: whose motions they are.
        quat_order: order of the root quaternion, where the user states it.
        fps: frames a second, where the user states it.
        up: axis of the world that points up, where the user states it.
        units: of places, where the user states it.
        angles: their unit in captures of humans, where the user states it.

    Raises:
        MotionError: for a value that is none of these.
    """

    robot: Robot
    quat_order: QuatOrder | None = None
    fps: FrameRate | None = None
    up: Up | None = None
    units: Units | None = None
    angles: Angles | None = None

    def __post_init__(self) -> None:
        try:
            super().__post_init__()
        except ConfigError as error:
            raise MotionError(f"stated of motions: {str(error).removeprefix('ReadOptions: ')}") from None

    @cached_property
    def soles(self) -> Soles:
        """Return the soles of the robot; made once for all files."""
        return Soles(self.robot)


@dataclass(frozen=True)
class MotionFile:
    """A motion file that was read.

    Attributes:
        path: of the file.
        format: what it was taken for.
        clips: its motions.
        notes: what was assumed, detected or filled in, a phrase each.
        unheard: what may be stated of files, by its name in :class:`ReadOptions`, and says nothing about this one.
        marked: whether plat wrote it, so that nothing about it is to be guessed.
        rate_fits: whether its frame rate was assumed, and its motion fits that.
        broken: motions of it that were left out: what is wrong with each.
    """

    path: Path
    format: str
    clips: list[MotionClip]
    notes: tuple[str, ...] = ()
    unheard: tuple[str, ...] = ()
    marked: bool = False
    rate_fits: bool = False
    broken: tuple[MotionError, ...] = ()

    @property
    def facts(self) -> str:
        """Return format, frame rate and notes of file and clips in one line."""
        rates = sorted({round(clip.fps, 3) for clip in self.clips})
        notes = dict.fromkeys((*self.notes, *(note for clip in self.clips for note in clip.notes)))
        return ", ".join((self.format, f"{'/'.join(f'{rate:g}' for rate in rates)} fps", *notes))


def arrange_joints(
    angles: np.ndarray, names: Sequence[str] | None, robot: Robot, field: str
) -> tuple[np.ndarray, list[str]]:
    """Return joint angles ``[T, n]`` of a file in the robot's order ``[T, J]``, and notes on what was done.

    Joints are matched by ``names`` where the file has them, however it spells them; else they must stand in the
    robot's order. Wrists, and the waist's roll and pitch where there are names, may be missing, as in files for the
    G1 with 23 joints: they get the default pose. Named columns of something else are left out.

    Raises:
        MotionError: for another number of joints, or names that the robot does not have.
    """
    if angles.ndim != 2 or angles.dtype.kind not in "fiu":
        raise MotionError(f"{field!r} has shape {angles.shape} and type {angles.dtype}, expected (frames, joints)")
    if names is None:
        listed = unnamed_joints(angles, robot, field)
        notes = [] if _in_order(listed, robot) else [OTHER_ORDER]
    else:
        columns, listed, left_out = robot_columns(names, angles.shape[1], robot)
        angles = angles[:, columns]
        notes = [] if _in_order(listed, robot) else ["joints reordered by name"]
        notes += [f"{counted(len(left_out), 'column')} left out ({', '.join(left_out[:3])})"] if left_out else []
    arranged = np.tile(robot.default_joint_pos.numpy(), (len(angles), 1)).astype(np.float64)
    arranged[:, [robot.joint_names.index(name) for name in listed]] = angles
    missing = [name for name in robot.joint_names if name not in listed]
    if missing and missing == [name for name in robot.joint_names if "wrist" in name]:
        notes.append("no wrists in the file: default pose")
    elif missing:
        notes.append(f"default pose for the missing {', '.join(missing)}")
    return arranged, notes


def _in_order(listed: Sequence[str], robot: Robot) -> bool:
    return list(listed) == [name for name in robot.joint_names if name in listed]


def make_clip(
    name: str,
    root_pos: np.ndarray,
    root_quat: np.ndarray,
    joint_pos: np.ndarray,
    fps: float,
    options: ReadOptions,
    quat_order: QuatOrder,
    fields: tuple[str, str],
    notes: Sequence[str] = (),
    written: Units | None = None,
    marked: bool = False,
) -> MotionClip:
    """Return a checked clip from the parts of a file, in meters and radians, z up.

    Args:
        name: of the clip.
        root_pos: ``[T, 3]``, in m, cm or mm.
        root_quat: ``[T, 4]``, of about unit length.
        joint_pos: ``[T, J]`` in the robot's order, in rad or degrees.
        fps: frames a second.
        options: gives the robot.
        quat_order: of ``root_quat``.
        fields: what the file calls root position and quaternion.
        notes: on this clip.
        written: unit of ``root_pos``, where the file's header or a comment states it.
        marked: whether plat wrote the file: it is in meters and radians, z up, whatever the robot does in it.

    Raises:
        MotionError: for parts that do not fit together, units that no motion has, or an impossible frame rate.
    """
    robot = options.robot
    for field, values, width in zip(fields, (root_pos, root_quat), (3, 4), strict=True):
        if values.shape != (len(joint_pos), width) or values.dtype.kind not in "fiu":
            advice = "; write rotation vectors, Euler angles or matrices as quaternions" * (width == 4)
            raise MotionError(f"{field!r} has shape {values.shape}, expected {(len(joint_pos), width)} numbers{advice}")
    check_rate(fps)
    if quat_order == "xyzw":
        root_quat = root_quat[:, [3, 0, 1, 2]]
    parts = (root_pos.astype(np.float64), root_quat.astype(np.float64), joint_pos.astype(np.float64))
    if len(joint_pos) < 2 or not all(np.isfinite(part).all() for part in parts):
        return MotionClip(name, np.concatenate(parts, 1), fps).checked(robot)  # says what is wrong
    quat = unit_quaternions(parts[1], fields[1])
    angles = Converted(parts[2]) if marked else angles_in_radians(parts[2], robot)
    up, units = options.up or ("z" if marked else None), options.units or ("m" if marked else None)
    upright, turned = z_up(parts[0], quat.values, angles.values, options.soles, up)
    place = place_in_meters(upright.values, turned.values, angles.values, options.soles, fields[0], units, written)
    found = (*quat.notes, *angles.notes, *upright.notes, *place.notes)
    qpos = np.concatenate((place.values, turned.values, angles.values), 1)
    return MotionClip(name, qpos, fps, tuple(dict.fromkeys((*notes, *found))), place.doubt).checked(robot)


def of_motion(name: str, error: MotionError) -> MotionError:
    """Return an error with the name of the motion that it is of before it, as a clip's own check has it."""
    named = f"motion {name!r}: "
    return error if str(error).startswith(named) else MotionError(f"{named}{error}")


def other_angles(angles: np.ndarray, others: np.ndarray) -> bool:
    """Return whether joint angles ``[T, J]`` are those of another motion, in whatever order and unit both are.

    >>> bent, turned = np.array([[0.1, 0.2], [0.1, 0.3]]), np.array([[0.2, 0.1], [0.3, 0.1]])
    >>> other_angles(bent, turned), other_angles(bent, np.rad2deg(bent)), other_angles(bent, bent + 0.1)
    (False, False, True)
    """
    if angles.shape != others.shape or {angles.dtype.kind, others.dtype.kind} - {*"fiu"}:
        return False
    one, other = np.sort(angles, axis=1), np.sort(others, axis=1)
    units = ((one, other), (one, np.rad2deg(other)), (np.rad2deg(one), other))
    return not any(np.allclose(a, b, rtol=1e-4, atol=1e-3, equal_nan=True) for a, b in units)


def check_rate(fps: float) -> None:
    """Raise for frames a second that no motion has.

    Raises:
        MotionError: naming the rate.
    """
    if not FPS[0] <= fps <= FPS[1]:
        meant = f" ({1 / fps:g} if that is the time of a frame)" if fps > 0 and FPS[0] <= 1 / fps <= FPS[1] else ""
        raise MotionError(f"fps is {fps:g}, expected {FPS[0]:g} to {FPS[1]:g} frames a second{meant}")


def number(value: Any, field: str) -> float:
    """Return a number from a scalar, or an array or list that holds one."""
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.item()
    if isinstance(value, (list, tuple)) and len(value) == 1:
        value = value[0]
    if isinstance(value, (str, bytes)):
        with contextlib.suppress(ValueError):
            value = float(value)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= 1e300:
        raise MotionError(f"{field!r} is {short(value)}, expected one number")
    return float(value)


def strings(value: Any, field: str) -> list[str]:
    """Return the names from an array or list of strings."""
    listed = value.ravel().tolist() if isinstance(value, np.ndarray) else value
    if isinstance(listed, (list, tuple)):
        listed = [name.decode("utf-8", "replace") if isinstance(name, bytes) else name for name in listed]
    if not isinstance(listed, (list, tuple)) or not all(isinstance(name, str) for name in listed):
        raise MotionError(f"{field!r} is not a list of names")
    return list(listed)
