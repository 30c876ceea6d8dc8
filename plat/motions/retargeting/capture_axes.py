"""Which axis of a capture's world points up, whether left is left, and how the trunk leans in the rest pose."""

from collections.abc import Mapping

import numpy as np

from plat.errors import MotionError
from plat.motions.retargeting.mocap import Mocap
from plat.motions.retargeting.skeletons import SIDES

__all__ = ["AXES", "check_sides", "find_up", "rest_pitches"]

AXES = {"x": 0, "y": 1, "z": 2}
_NAMES = "xyz"
# A body stands along an axis when from ankles to neck it points along it this much, on average.
_STANDING = 0.8
# A standing body's lowest joint over the floor, lowest and highest (legs).
_FLOOR = (-0.08, 0.35)
# Heights over the floor of a lying body: lowest and highest of its hips, of nearly all of its joints, and of those that
# touch the floor (legs).
_LYING_HIPS = (0.0, 0.45)
_LYING = (-0.1, 0.7)
_TOUCHING = (-0.25, 0.25)
# A floor that is where it should be, and parts that are below it (legs).
_EXACT, _BELOW = 0.05, -0.05
# Who lies does not go further than this sideways (legs).
_ROLLS = 1.0
# Nobody moves further than this along the vertical (legs).
_CLIMB = 1.6
# A rest pose whose legs and trunk are in line, and along an axis, by this much.
_IN_LINE = 0.9
_BEHIND = -0.3
_TURN_IT = "turn it so that y or z is up, or state the axis: plat motions convert --up"


def find_up(
    at: dict[str, np.ndarray], rest: dict[str, np.ndarray], leg: float, stated: int | None, where: str
) -> tuple[int, list[str]]:
    """Return the axis that points up, and notes.

    A body that stands along an axis says that this one is up, unless it lies: then it is low along the axis that is
    really up. A floor at height 0 and the rest pose decide between the two. A stated axis counts as one more
    hint; where it contradicts the motion and nothing decides, the file is refused.

    Args:
        at: role to its places ``[T, 3]``, in the file's units.
        rest: role to its place in the rest pose ``[3]``.
        leg: length of a leg, in the file's units.
        stated: by the map, or None.
        where: for the error message.

    Raises:
        MotionError: where the axis cannot be determined.
    """
    trunk = at["neck"] - 0.5 * (at["left_ankle"] + at["right_ankle"])
    upright = (trunk / np.linalg.norm(trunk, axis=1, keepdims=True).clip(1e-9)).mean(0)
    body = np.stack(list(at.values())) / leg
    lowest, travel = body.min((0, 1)), np.ptp(at["hips"], axis=0) / leg
    hips = np.median(at["hips"], 0) / leg
    along = int(np.argmax(upright))
    stands = upright[along] > _STANDING
    if stated is not None and upright[stated] < -_STANDING:
        raise MotionError(f"{where}: along the stated up axis {_NAMES[stated]} the head is below the feet; {_TURN_IT}")
    if stands and along == stated:
        return along, []
    hint = _rest_up(rest)
    lying_along = int(np.argmax(np.abs(upright)))
    low, high = np.percentile(body, (20, 90), axis=(0, 1))
    touching = np.percentile(body, 2, axis=(0, 1))
    is_low = (_LYING_HIPS[0] < hips) & (hips < _LYING_HIPS[1]) & (_LYING[0] < low) & (high < _LYING[1])
    is_low &= (_TOUCHING[0] < touching) & (touching < _TOUCHING[1])
    # of three axes one is up, one is along the body, and along the third nobody walks who lies
    is_low &= (
        np.array([travel[3 - axis - lying_along] if axis != lying_along else np.inf for axis in range(3)]) < _ROLLS
    )
    if not stands:
        if stated is not None:
            if upright.min() < -_STANDING and not is_low[stated]:
                down = _NAMES[int(upright.argmin())]
                raise MotionError(
                    f"{where}: {_NAMES[stated]} should be up, and the body stands along -{down} and does not lie on a "
                    f"floor; {_TURN_IT}"
                )
            return stated, []
        fitting = [axis for axis in (1, 2) if _FLOOR[0] < lowest[axis] < _FLOOR[1] and travel[axis] < _CLIMB]
        if hint in fitting or len(fitting) == 1:
            up = hint if hint is not None and hint in fitting else fitting[0]
            return up, [f"{_NAMES[up]} taken as up, by the floor: nobody stands"]
        if upright.min() < -_STANDING:
            down = _NAMES[int(upright.argmin())]
            raise MotionError(
                f"{where}: which axis is up cannot be determined, and the head points along -{down}; {_TURN_IT}"
            )
        raise _untold(where)
    standing_hints = [_FLOOR[0] < lowest[along] < _FLOOR[1] and travel[along] < _CLIMB, hint == along]
    others = [axis for axis in ((stated,) if stated is not None else (1, 2)) if axis != along]
    lying = {axis: 2 * bool(is_low[axis]) + (hint == axis) for axis in others}
    # files have y or z up, and x hardly ever
    for_standing = 2 * bool(standing_hints[0]) + standing_hints[1] - (along == 0 and hint != 0)
    best = max(lying, key=lambda axis: lying[axis])
    if abs(touching[along]) < _EXACT and touching[best] < _BELOW:
        for_standing += 1
    if for_standing > lying[best] and for_standing > 0:
        told = (
            []
            if stated is None
            else [f"{_NAMES[along]} up and not {_NAMES[stated]}, as stated: the body stands along it"]
        )
        return along, told
    if lying[best] > for_standing:
        return best, [f"{_NAMES[best]} up: the body lies along {_NAMES[along]}"]
    if stated is not None:
        raise MotionError(
            f"{where}: {_NAMES[stated]} should be up, and the body stands along {_NAMES[along]}; does it lie? "
            "State the axis that is up: plat motions convert --up, or 'up' in a map (--map)"
        )
    raise _untold(where)


def check_sides(at: dict[str, np.ndarray], where: str, name: str) -> None:
    """Raise where toes point behind the pelvis, or shoulders and hips have their sides exchanged.

    Args:
        at: role to its places ``[T, 3]``, whatever the axes.
        where: for the error message.
        name: of the map.

    Raises:
        MotionError: when left and right are exchanged, in the map or in the file.
    """
    left = at["left_hip"] - at["right_hip"]
    forward = np.cross(left, at["neck"] - 0.5 * (at["left_hip"] + at["right_hip"]))
    forward /= np.linalg.norm(forward, axis=1, keepdims=True).clip(1e-9)
    votes = []
    for side in SIDES:
        toe = at[f"{side}_toe"] - at[f"{side}_ankle"]
        toe /= np.linalg.norm(toe, axis=1, keepdims=True).clip(1e-9)
        knee = at[f"{side}_knee"] - 0.5 * (at[f"{side}_hip"] + at[f"{side}_ankle"])
        length = np.linalg.norm(at[f"{side}_knee"] - at[f"{side}_hip"], axis=1).mean()
        votes += [
            float((toe * forward).sum(1).mean()),
            float(np.clip(4 * (knee * forward).sum(1).mean() / length, -1, 1)),
        ]
    if np.mean(votes[::2]) < _BEHIND and np.mean(votes) < _BEHIND / 2:
        raise MotionError(
            f"{where}: toes point behind the pelvis: left and right are exchanged, in skeleton map {name!r} or in the "
            "file (exchange them in a map, --map), or its axes are left-handed (turn the sign of one)"
        )
    shoulders = at["left_shoulder"] - at["right_shoulder"]
    if float((left * shoulders).sum(1).mean()) < 0:
        raise MotionError(
            f"{where}: shoulders and hips have left and right the other way round; see skeleton map {name!r}"
        )


def rest_pitches(mocap: Mocap, joints: Mapping[str, str]) -> tuple[float, float] | None:
    """Return by how many degrees the lines of pelvis and torso lean back in a rest pose that stands, else None.

    Args:
        mocap: whose rest pose it is.
        joints: of a skeleton map, role to name.
    """
    rest = {role: mocap.rest[mocap.names.index(name)] for role, name in joints.items()}
    axis = _rest_up(rest)
    if axis is None:
        return None
    up = np.eye(3)[axis]

    def lean(start: str, end: str, joint: str) -> float:
        line, forward = rest[end] - rest[start], np.cross(rest[f"left_{joint}"] - rest[f"right_{joint}"], up)
        back = -(line @ forward) / max(float(np.linalg.norm(forward)), 1e-9)
        return round(float(np.degrees(np.arctan2(back, line @ up))), 1) + 0.0

    return lean("hips", "spine", "hip"), lean("chest", "neck", "shoulder")


def _rest_up(rest: dict[str, np.ndarray]) -> int | None:
    """Return the axis along which the rest pose stands, or None where it is no pose that stands."""
    ankles = 0.5 * (rest["left_ankle"] + rest["right_ankle"])
    hips = 0.5 * (rest["left_hip"] + rest["right_hip"])
    legs, trunk = hips - ankles, rest["neck"] - hips
    lengths = np.linalg.norm(legs), np.linalg.norm(trunk)
    if min(lengths) < 1e-9:
        return None
    legs, trunk = legs / lengths[0], trunk / lengths[1]
    axis = int(np.argmax(legs))
    return axis if legs @ trunk > _IN_LINE and legs[axis] > _IN_LINE else None


def _untold(where: str) -> MotionError:
    return MotionError(
        f"{where}: which axis is up cannot be determined from the poses; state it: "
        "plat motions convert --up, or 'up' in a map"
    )
