"""Units of a motion, from what the robot would do in them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch

from plat.errors import MotionError
from plat.motions.checks.feet import Soles, lowest_step
from plat.motions.checks.underside import Underside
from plat.robots.robot import Robot
from plat.spec.proportions import in_proportion
from plat.words import counted

__all__ = [
    "METERS",
    "Angles",
    "Converted",
    "Units",
    "angles_in_radians",
    "leg_height",
    "must_be_radians",
    "place_in_meters",
    "roughly_in_radians",
    "unit_quaternions",
]

Units = Literal["m", "cm", "mm", "in", "ft"]
Angles = Literal["degrees", "radians"]

# A quaternion outside of this is no rounding and no averaging, but another column.
_LENGTHS = (0.8, 1.25)
_ROUNDING = 1e-2
# Further than any motion goes in meters, wider than any joint turns in radians.
_FARTHEST = 1000.0
_WIDEST = 4 * np.pi
# Degrees are believed where the joints then stay within this much of their limits (rad).
_LIMIT_SLACK = 0.35
# Where so many joints are this far beyond their limits (rad) in more than this share of the frames, angles are in
# degrees. In fewer frames they are broken, and one or two joints are so.
_MANY, _FAR_BEYOND, _SHARE = 4, 0.5, 0.5
# A joint has turned around where, whole turns taken off, it keeps its limits in this share of its frames beyond them,
# and goes on by less than this from the frames before and behind (rad).
_MOST, _STEADY = 0.9, 1.0
# Some joint of a motion in radians goes beyond this (rad), and no motion in degrees that keeps the limits of radians.
_STILL = 0.5
# Root height over what the legs need, in a motion in these units. In meters it is about 1.
_UNITS = {
    "feet": (2.4, 4.3, 0.3048),
    "inches": (24.0, 60.0, 0.0254),
    "centimeters": (60.0, 250.0, 0.01),
    "millimeters": (400.0, 2500.0, 0.001),
}
# Share by which a standing root is higher or lower than its legs reach, and the height of one that lies (m).
_STANDING, _LYING = 0.3, 0.05

METERS: dict[Units, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
"""Meters a unit."""

_HIGHEST = 5.0
# Nobody's root is higher for half of a motion (m), of a robot whose root stands at 0.76 m.
_HIGH = 1.6
# Up component of the root's own up axis, mean over the frames, below which a robot does not stand, and how far the
# lowest part of one that lies is from the floor (m, median).
_UPRIGHT, _RESTING = 0.5, 0.04
# Legs that reach less than this are folded below a leaning trunk, and no measure of the root's height (m); of a robot
# whose root stands at 0.76 m.
_FOLDED = 0.5


@dataclass(frozen=True)
class Converted:
    """Values in the units that plat works with.

    Attributes:
        values: in these units.
        notes: what was done to them, a phrase each.
        doubt: why the unit cannot be determined, where that is so; empty else.
    """

    values: np.ndarray
    notes: tuple[str, ...] = ()
    doubt: str = ""


def unit_quaternions(quat: np.ndarray, field: str) -> Converted:
    """Return quaternions ``[T, 4]`` made unit, with a note where they were off by more than rounding.

    Raises:
        MotionError: when a length says that these are no quaternions.
    """
    length = np.linalg.norm(quat, axis=1)
    frame = int(np.abs(length - 1).argmax())
    if not _LENGTHS[0] <= length[frame] <= _LENGTHS[1]:
        raise MotionError(
            f"the root quaternion of frame {frame} ({field}) has length {length[frame]:.4g}, expected 1; "
            "is it another column?"
        )
    notes: tuple[str, ...] = ()
    if abs(length[frame] - 1) > _ROUNDING:
        notes = (f"root quaternions of length {length.min():.3f} to {length.max():.3f} made unit",)
    return Converted(quat / length[:, None], notes)


def angles_in_radians(joint_pos: np.ndarray, robot: Robot) -> Converted:
    """Return joint angles ``[T, J]`` in radians.

    Degrees are known by values that only degrees can have, in most frames. Whole turns are taken off, as of angles
    that are written from 0 to 2 pi.

    Raises:
        MotionError: for angles that are neither radians nor degrees.
    """
    largest = np.abs(joint_pos).max(initial=0.0)
    if not np.isfinite(largest):
        return Converted(joint_pos)  # the clip's check tells where
    turned = _turned_back(joint_pos, robot)
    low, high = robot.joint_range.double().numpy().T
    many = (np.maximum(low - turned.values, turned.values - high) > _FAR_BEYOND).sum(1) >= _MANY
    odd = many | (np.abs(turned.values) > _WIDEST).any(1)
    if len(odd) == 0 or odd.mean() <= _SHARE:
        return turned  # the checks tell of single frames
    within = _turned_back(np.deg2rad(joint_pos), robot)
    radians = within.values
    if np.maximum(low - radians, radians - high).max() > _LIMIT_SLACK:
        if largest <= _WIDEST:
            return Converted(joint_pos)  # the checks tell how far beyond the limits
        raise MotionError(f"'joint angles' has values up to {largest:.4g}, expected radians")
    # so small in degrees nothing would move, and not by whole turns of radians
    if largest <= _WIDEST and np.abs(np.diff(joint_pos, axis=0)).max(initial=0.0) > 2 * np.pi - _STEADY:
        raise MotionError(
            "'joint angles' has steps of about 6.28 beyond the joints' limits, expected radians within them"
        )
    return Converted(radians, ("joint angles in degrees", *within.notes))


def roughly_in_radians(angles: np.ndarray) -> np.ndarray:
    """Return angles ``[T, n]`` of joints in any order in radians, from -pi to pi.

    They are in degrees where in most frames some value is wider than any joint turns in radians.
    """
    degrees = len(angles) > 0 and (np.abs(angles) > _WIDEST).any(1).mean() > _SHARE
    radians = np.deg2rad(angles) if degrees else angles
    return (radians + np.pi) % (2 * np.pi) - np.pi


def _turned_back(joint_pos: np.ndarray, robot: Robot) -> Converted:
    """Return angles ``[T, J]`` without the whole turns that lead joints far beyond their limits, and a note on them.

    A single frame that is off by something else stays as it is.
    """
    low, high = robot.joint_range.double().numpy().T
    far = np.maximum(low - joint_pos, joint_pos - high) > _FAR_BEYOND
    if not far.any():
        return Converted(joint_pos)
    turns = np.where(far & (np.abs(joint_pos) <= _WIDEST), np.round((joint_pos - (low + high) / 2) / (2 * np.pi)), 0.0)
    within = joint_pos - 2 * np.pi * turns
    kept = far & (np.maximum(low - within, within - high) <= _LIMIT_SLACK)
    within = np.where(kept, within, joint_pos)
    ends = kept[1:] != kept[:-1]
    steady = ends & (np.abs(np.diff(within, axis=0)) < _STEADY)
    right = (kept.sum(0) > _MOST * far.sum(0)) & (steady.sum(0) >= _MOST * ends.sum(0))
    if not right.any():
        return Converted(joint_pos)
    names = [name for name, turned in zip(robot.joint_names, right, strict=True) if turned]
    more = ", ..." if len(names) > 3 else ""
    told = f"whole turns taken off {counted(len(names), 'joint')} ({', '.join(names[:3])}{more})"
    return Converted(np.where(right, within, joint_pos), (told,))


def must_be_radians(angles: np.ndarray, names: Sequence[str], robot: Robot) -> bool:
    """Return whether angles of named joints ``[T, n]``, stated to be degrees, move a robot in radians alone.

    In radians they then keep the joints' limits, and in degrees hardly anything moves.
    """
    low, high = robot.joint_range.double().numpy()[[robot.joint_names.index(name) for name in names]].T
    kept = np.maximum(low - angles, angles - high).max() <= _LIMIT_SLACK
    return bool(kept and np.abs(angles).max() > _STILL)


def place_in_meters(
    root_pos: np.ndarray,
    quat: np.ndarray,
    joint_pos: np.ndarray,
    soles: Soles,
    field: str,
    stated: Units | None = None,
    written: Units | None = None,
) -> Converted:
    """Return root positions ``[T, 3]`` in meters; the unit is known by the height that the legs need.

    That of the file's header or comments counts where the robot stands in it, or lies in it and stands in none.

    Args:
        root_pos: in a world whose z axis is up.
        quat: orientation of the root (``wxyz``) ``[T, 4]``.
        joint_pos: ``[T, J]`` (rad).
        soles: of the robot.
        field: what the file calls the position.
        stated: the unit, where the user states it.
        written: the unit, where the file's header or a comment states it.

    Raises:
        MotionError: for a height that is a standing robot's in no unit.
    """
    if stated is not None:
        return Converted(root_pos * METERS[stated])
    if written is None:
        return _in_shown_unit(root_pos, quat, joint_pos, soles, field)
    heights = {unit: float(np.median(root_pos[:, 2])) * meters for unit, meters in METERS.items()}
    need = leg_height(joint_pos, soles)
    upright = _is_upright(quat)
    standing = {unit for unit, height in heights.items() if upright and abs(height / need - 1) < _STANDING}
    if written in standing or (not standing and _LYING < heights[written] < need):
        told = () if written == "m" else (f"root position in {written}, as the file says",)
        return Converted(root_pos * METERS[written], told)
    found = _in_shown_unit(root_pos, quat, joint_pos, soles, field)
    return replace(found, notes=found.notes or (f"root position in meters, though the file says {written}",))


def _in_shown_unit(
    root_pos: np.ndarray, quat: np.ndarray, joint_pos: np.ndarray, soles: Soles, field: str
) -> Converted:
    """Return root positions in meters, from the unit that the motion shows; see :func:`place_in_meters`."""
    largest = np.abs(root_pos).max(initial=0.0)
    median = float(np.median(root_pos[:, 2]))
    if abs(median) < in_proportion(_HIGH, soles.robot.root_height) and largest <= _FARTHEST:
        return Converted(root_pos)
    need = leg_height(joint_pos, soles)
    height = median / need
    doubt = ""
    if not _is_upright(quat):  # its height over the legs' reach says nothing
        lying = _units_of_lying(root_pos, quat, joint_pos, soles)
        if len(lying) == 1:
            return Converted(root_pos * _UNITS[lying[0]][2], (f"root position in {lying[0]}: so it lies on the floor",))
        rests = " and ".join(f"in {unit}" for unit in lying) or "in no unit"
        doubt = (
            f"the unit of places cannot be determined: {field!r} has the root of a robot that lies at {median:.4g}, "
            f"and it rests on the floor {rests}; state it: plat motions convert --units"
        )
    for unit, (low, high, meters) in _UNITS.items():
        if low < abs(height) < high:
            # what hangs in the air in meters may still do so
            slips = [_slip(place, quat, joint_pos, soles) for place in (root_pos, root_pos * meters)]
            if unit == "feet" and slips[0] < slips[1]:
                continue
            told = f"root position in {unit}: it is {height:.0f} times as high as in meters"
            return Converted(root_pos * meters, (told,), doubt)
    if largest > _FARTHEST:
        raise MotionError(
            f"{field!r} has values up to {largest:.4g}, expected meters (or state the unit: "
            "plat motions convert --units)"
        )
    if abs(height) > _HIGHEST:
        raise MotionError(
            f"{field!r} has the root {height * need:.4g} above the floor, expected meters: the legs reach {need:.2f} "
            "(or state the unit: plat motions convert --units)"
        )
    return Converted(root_pos)


def _is_upright(quat: np.ndarray) -> bool:
    """Return whether the root's own up axis points up, mean over the frames."""
    return bool((1 - 2 * (quat[:, 1] ** 2 + quat[:, 2] ** 2)).mean() > _UPRIGHT)


def _units_of_lying(root_pos: np.ndarray, quat: np.ndarray, joint_pos: np.ndarray, soles: Soles) -> list[str]:
    """Return the units in which the lowest part of a body, whichever that is, rests on the floor."""
    some = np.linspace(0, len(root_pos) - 1, min(len(root_pos), 50)).round().astype(int)
    underside = Underside(soles.robot)
    found = []
    for unit, (_, _, meters) in _UNITS.items():
        qpos = np.concatenate((meters * root_pos, quat, joint_pos), 1)[some]
        if abs(float(np.median(underside.heights(qpos).min(1)))) < _RESTING:
            found.append(unit)
    return found


def _slip(root_pos: np.ndarray, quat: np.ndarray, joint_pos: np.ndarray, soles: Soles) -> float:
    """Return how far the lowest point of the soles goes sideways from frame to frame, median (m)."""
    before, after = lowest_step(soles.points(torch.from_numpy(np.concatenate((root_pos, quat, joint_pos), 1))))
    return float((after - before)[:, :2].norm(dim=-1).median())


def leg_height(joint_pos: np.ndarray, soles: Soles) -> float:
    """Return the height of the root over the lower sole of an upright robot, median over some frames (m)."""
    some = joint_pos[np.linspace(0, len(joint_pos) - 1, min(len(joint_pos), 50)).round().astype(int)]
    qpos = np.concatenate((np.tile([0.0, 0, 0, 1, 0, 0, 0], (len(some), 1)), some), 1)
    low = soles.points(torch.from_numpy(qpos))[..., 2].amin((-1, -2))
    return max(in_proportion(_FOLDED, soles.robot.root_height), -float(low.median()))
