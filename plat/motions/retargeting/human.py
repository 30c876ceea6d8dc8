"""From a capture and a map to the motion of a human in meters, z up."""

from dataclasses import dataclass

import numpy as np

from plat.errors import MotionError
from plat.motions.retargeting.builtin import with_joints
from plat.motions.retargeting.capture_axes import AXES, check_sides, find_up
from plat.motions.retargeting.mocap import Mocap
from plat.motions.retargeting.skeletons import SIDES, UNITS, SkeletonMap

__all__ = ["Human", "read_human"]

# Thigh and shin together of any human, and of most, in m.
_LEG_LENGTH = (0.45, 1.3)
_USUAL_LEG = 0.84
# Shin over thigh, arm over leg, and hips to shoulders over leg, lowest and highest. Of captures of people the last is
# 0.44 to 0.6; four-legged animals with a human's joint names have 1.
_SHIN, _ARM, _TRUNK = (0.4, 2.5), (0.3, 2.0), (0.25, 0.95)
# Nobody's legs get shorter or longer than this, as shares of their median.
_CONSTANT = (0.5, 1.5)
# A pose before the motion: joints go this far to the next frame (legs), and this many times as far as later.
_POSED, _LEAP = 0.15, 6.0
_POSED_FRAMES = 3
# A pose of more frames is held: nothing goes further than this to the next one (legs), as in no motion of a body.
_HELD = 1e-4
# A pose may be blended into the motion within this long (s), where a joint goes this fast (m/s), and later by less than
# this share of it: CMU's files for Daz begin so.
_BLENDED, _BLEND_SPEED, _CALM = 0.1, 20.0, 0.25
# Nobody's hips go faster than this (m/s, median).
_FASTEST = 12.0


@dataclass(frozen=True)
class Human:
    """The motion of a human over T frames, in m, the z axis up, beginning over the origin.

    Attributes:
        positions: role to ``[T, 3]``.
        rotations: of the ankles' joints, role to ``[T, 3, 3]`` (joint to world, the joint's axes being the file's).
        leg: thigh and shin together, mean of both sides and all frames.
        notes: what was found against the map or assumed, a phrase each.
    """

    positions: dict[str, np.ndarray]
    rotations: dict[str, np.ndarray]
    leg: float
    notes: tuple[str, ...] = ()


def read_human(
    mocap: Mocap, skeleton: SkeletonMap, where: str, up: str | None = None, units: str | None = None
) -> Human:
    """Return what retargeting needs of a capture; ``where`` is for the error messages.

    A pose before the first frame, as many exports have it, is left out.

    Args:
        mocap: the capture.
        skeleton: its map.
        where: begins the messages.
        up: the axis that points up, where the user states it: no motion overrules that.
        units: one of :data:`UNITS`, the same way.

    Raises:
        MotionError: when a joint of the map is missing, the up axis cannot be determined, left and right are
            exchanged, or limbs have lengths that no human's have.
    """
    with_joints(skeleton, mocap, where)
    indices = {role: mocap.names.index(name) for role, name in skeleton.joints.items()}
    raw = {role: mocap.positions[:, index] for role, index in indices.items()}
    leg = _leg(raw, skeleton, where)
    notes = [*mocap.notes]
    first = _posed_frames(raw, leg) or _blended_frames(raw, leg, mocap.fps)
    if first:
        raw = {role: position[first:] for role, position in raw.items()}
        notes.append(f"first {'frame' if first == 1 else f'{first} frames'} left out: a pose before the motion")
    check_sides(raw, where, skeleton.name)
    rest = {role: mocap.rest[index] for role, index in indices.items()}
    stated = AXES.get(skeleton.up, AXES.get(mocap.up or ""))
    axis, told = (AXES[up], []) if up is not None else find_up(raw, rest, leg, stated, where)
    unit, more = (UNITS[units], []) if units is not None else _unit(leg, skeleton)
    speed = unit * float(np.median(np.linalg.norm(np.diff(raw["hips"], axis=0), axis=1))) * mocap.fps
    if len(raw["hips"]) > _POSED_FRAMES and speed > _FASTEST:
        raise MotionError(
            f"{where}: hips go at {speed:.0f} m/s; is their place in another unit than the skeleton, or the frame rate "
            f"{mocap.fps:g} wrong (plat motions convert --fps)?"
        )
    # a cyclic change of axes is a rotation, so that left stays left
    axes = [(axis + 1) % 3, (axis + 2) % 3, axis]
    origin = np.append(raw["hips"][0, axes[:2]], 0.0)
    positions = {role: unit * (position[:, axes] - origin) for role, position in raw.items()}
    rotations = {
        f"{side}_ankle": _foot_axes(positions, side)
        if mocap.rotations is None
        else mocap.rotations[first:, indices[f"{side}_ankle"]][:, axes]
        for side in SIDES
    }
    return Human(positions, rotations, unit * leg, (*notes, *told, *more))


def _foot_axes(at: dict[str, np.ndarray], side: str) -> np.ndarray:
    """Return axes ``[T, 3, 3]`` that go with a foot: toward the toe, and as near to the line of the hips as can be."""
    forward = at[f"{side}_toe"] - at[f"{side}_ankle"]
    forward = forward / np.linalg.norm(forward, axis=1, keepdims=True).clip(1e-9)
    left = at["left_hip"] - at["right_hip"]
    left = left - forward * (left * forward).sum(1, keepdims=True)
    left = left / np.linalg.norm(left, axis=1, keepdims=True).clip(1e-9)
    return np.stack((forward, left, np.cross(forward, left)), -1)


def _leg(raw: dict[str, np.ndarray], skeleton: SkeletonMap, where: str) -> float:
    """Return the length of thigh and shin, in the file's units, after a look at the proportions."""

    def length(start: str, end: str) -> float:
        return float(np.mean([np.linalg.norm(raw[f"{s}_{end}"] - raw[f"{s}_{start}"], axis=1).mean() for s in SIDES]))

    thigh, shin = length("hip", "knee"), length("knee", "ankle")
    arm = length("shoulder", "elbow") + length("elbow", "wrist")
    middle = {part: 0.5 * (raw[f"left_{part}"] + raw[f"right_{part}"]) for part in ("hip", "shoulder")}
    trunk = float(np.median(np.linalg.norm(middle["shoulder"] - middle["hip"], axis=1)))
    if thigh + shin == 0:
        raise MotionError(f"{where}: legs without length; are hips, knees and ankles of the skeleton map right?")
    _check_constant(raw, where)
    for what, share, (low, high) in (
        ("shin to thigh", shin / max(thigh, 1e-9), _SHIN),
        ("arm to leg", arm / (thigh + shin), _ARM),
        ("trunk to leg", trunk / (thigh + shin), _TRUNK),
    ):
        if not low < share < high:
            raise MotionError(
                f"{where}: {what} is {share:.2f}, as no human has it; is skeleton map {skeleton.name!r} right?"
            )
    return thigh + shin


def _check_constant(raw: dict[str, np.ndarray], where: str) -> None:
    """Raise where legs change their length: a tracker writes zeros where it lost a body."""
    bones = [
        (f"{side}_{start}", f"{side}_{end}") for side in SIDES for start, end in (("hip", "knee"), ("knee", "ankle"))
    ]
    lengths = np.sum([np.linalg.norm(raw[end] - raw[start], axis=1) for start, end in bones], 0)
    shares = lengths / np.median(lengths[lengths > 0])
    odd = np.flatnonzero((shares < _CONSTANT[0]) | (shares > _CONSTANT[1]))
    if len(odd):
        others = f" and {len(odd) - 1} more" if len(odd) > 1 else ""
        raise MotionError(
            f"{where}: legs have {shares[odd[0]]:.2g} times their usual length in frame {odd[0] + 1}{others}, as where "
            "a body was lost; fill these frames in, or cut the file there"
        )


def _posed_frames(raw: dict[str, np.ndarray], leg: float) -> int:
    """Return how many frames come before a leap into the motion, of which the first are a pose, or all are one."""
    steps = np.linalg.norm(np.diff(np.stack(list(raw.values())), axis=1), axis=-1).max(0) / leg
    held = int(np.append(steps > _HELD, True).argmax()) + 1
    for last in (held, *range(_POSED_FRAMES, 0, -1)):
        if last > len(steps) - 2:
            continue
        if steps[last - 1] > _POSED and steps[last - 1] > _LEAP * steps[last : last + 10].max():
            return last
    return 0


def _blended_frames(raw: dict[str, np.ndarray], leg: float, fps: float) -> int:
    """Return how many frames lead from a pose into the motion, faster than anybody moves."""
    steps = np.linalg.norm(np.diff(np.stack(list(raw.values())), axis=1), axis=-1).max(0) * fps * _USUAL_LEG / leg
    start = steps[: round(_BLENDED * fps)]
    if len(steps) <= 2 * len(start) or not (start > _BLEND_SPEED).any():
        return 0
    last = 1 + int(np.flatnonzero(start > _CALM * start.max())[-1])
    after = steps[last : last + 2 * len(start)]
    return last if last < len(start) and after.max() < _CALM * start.max() else 0


def _unit(leg: float, skeleton: SkeletonMap) -> tuple[float, list[str]]:
    """Return meters a unit, and notes where that is not what the map states."""
    stated = None if skeleton.units == "auto" else float(UNITS.get(str(skeleton.units), skeleton.units))
    if stated is not None and _LEG_LENGTH[0] < stated * leg < _LEG_LENGTH[1]:
        return stated, []
    fitting = {name: unit for name, unit in UNITS.items() if _LEG_LENGTH[0] < unit * leg < _LEG_LENGTH[1]}
    if fitting:
        name = min(fitting, key=lambda name: abs(np.log(fitting[name] * leg / _USUAL_LEG)))
        told = [] if stated is None else [f"lengths in {name} and not as map {skeleton.name!r} says, by the legs"]
        return fitting[name], told
    return _USUAL_LEG / leg, [
        f"unit of lengths unknown: legs of {leg:.4g} taken as {_USUAL_LEG} m (else: plat motions convert --units)"
    ]
