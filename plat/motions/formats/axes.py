"""Axes of a motion's world and of its root, from where the robot would stand in them."""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
import torch

from plat.errors import MotionError
from plat.motions.checks.feet import Soles, contact_slip
from plat.motions.checks.underside import Underside
from plat.motions.formats.units import METERS, Converted, leg_height
from plat.rotations_np import quat_multiply

__all__ = ["Up", "z_up"]

Up = Literal["x", "y", "z"]

# How much the root's own up axis lies along an axis of the world that is taken for up, mean over the frames.
_ALONG = 0.85
# Share by which a root is higher or lower than its legs reach, in one of the units.
_HEIGHT = 0.3
# A body rests on the floor whose lowest part is within twice this of it in most frames, and one stands whose lower
# sole is (m, median); and how uneven that may be.
_FLOOR, _FLAT, _MOST = 0.05, 0.03, 0.7
# Share of the frames in which the lower foot is lower than on the floor, and what uneven soles count.
_RESTING, _UNEVEN = 0.2, 0.2
# Share of the first one's sliding below which other axes are better.
_CLEARLY = 0.75
# Frames that are looked at for it.
_SOME = 50
_HALF = np.sqrt(0.5)


class _Frame(NamedTuple):
    """How a file's coordinates become those of a world whose z axis is up.

    Attributes:
        place: column of the file for each of x, y and z, and its sign.
        turn: quaternion from the file's world to ours; None where the root's own axes are named otherwise as well.
        vector: for these: column and sign of each component of the quaternion's vector.
        told: what is found, for a note.
    """

    place: tuple[tuple[int, int, int], tuple[int, int, int]]
    turn: tuple[float, float, float, float] | None
    vector: tuple[tuple[int, int, int], tuple[int, int, int]]
    told: str

    def places(self, root_pos: np.ndarray) -> np.ndarray:
        return root_pos[:, self.place[0]] * self.place[1]

    def quaternions(self, root_quat: np.ndarray) -> np.ndarray:
        if self.turn is not None:
            return quat_multiply(np.tile(self.turn, (len(root_quat), 1)), root_quat)
        vector = root_quat[:, 1:][:, self.vector[0]] * self.vector[1]
        return np.concatenate((root_quat[:, :1], vector), 1)


_SAME = ((0, 1, 2), (1, 1, 1))
# the world alone is turned, and the root's z axis points up in it
_TURNED = {
    "x": _Frame(((2, 1, 0), (-1, 1, 1)), (_HALF, 0.0, -_HALF, 0.0), _SAME, "x axis up in the file, turned to z"),
    "y": _Frame(((0, 2, 1), (1, -1, 1)), (_HALF, _HALF, 0.0, 0.0), _SAME, "y axis up in the file, turned to z"),
}
# y up and z forward in the world and in the root alike, as animation programs and game engines have it
_RENAMED = (
    _Frame(((2, 0, 1), (1, 1, 1)), None, ((2, 0, 1), (1, 1, 1)), "y up and z forward in the file, of the root as well"),
    _Frame(((2, 0, 1), (1, -1, 1)), None, ((2, 0, 1), (-1, 1, -1)), "y up, z forward and left-handed axes in the file"),
)


def z_up(
    root_pos: np.ndarray, root_quat: np.ndarray, joint_pos: np.ndarray, soles: Soles, stated: Up | None = None
) -> tuple[Converted, Converted]:
    """Return root positions and quaternions (``wxyz``) in a world whose z axis is up.

    Another axis is recognized if the robot is upright along it, at the height of its legs, and would not lie on the
    floor otherwise. Files whose root has its z axis forward, as their world has, are known so too.

    Args:
        root_pos, root_quat: ``[T, 3]``, in any unit, and ``[T, 4]``.
        joint_pos: ``[T, J]`` (rad).
        soles: of the robot.
        stated: the axis that is up, where the user states it.

    Raises:
        MotionError: for a robot that lies if z is up, and stands if another axis is.
    """
    unchanged = Converted(root_pos), Converted(root_quat)
    if stated == "z":
        return unchanged
    w, x, y, z = root_quat.T
    own_z = np.mean((2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)), axis=1)
    own_y = float(np.mean(1 - 2 * (x * x + z * z)))
    if stated is not None:
        candidates = [_TURNED[stated]]
    elif own_z[:2].max() >= _ALONG:
        candidates = [_TURNED["xy"[int(own_z[:2].argmax())]]]
    else:
        candidates = []
    if not candidates or (stated == "y" and own_z[1] < own_y):
        candidates = [*_RENAMED] if own_y >= _ALONG and stated in (None, "y") else candidates
    if not candidates:
        return unchanged
    need = leg_height(joint_pos, soles)
    height = float(np.median(candidates[0].places(root_pos)[:, 2])) / need
    units = [meters for meters in METERS.values() if abs(height * meters - 1) < _HEIGHT]
    if stated is not None:
        scale = units[0] if units else 1.0
        frame = _steadiest(candidates if units else [_TURNED[stated]], scale * root_pos, root_quat, joint_pos, soles)
        return Converted(frame.places(root_pos)), Converted(frame.quaternions(root_quat))
    if not units:
        return unchanged
    frame = _steadiest(candidates, units[0] * root_pos, root_quat, joint_pos, soles)
    stands = _stands(_qpos(frame, units[0] * root_pos, root_quat, joint_pos), soles)
    as_it_is = [meters for meters in METERS.values() if np.median(np.abs(meters * root_pos[:, 2] / need - 1)) < _HEIGHT]
    as_high = bool(as_it_is)
    if as_high and not (stands and units[0] in as_it_is):
        return unchanged
    if _rests(units[0] * root_pos, root_quat, joint_pos, soles):
        if stands and not as_high:
            raise MotionError(
                f"it lies if z is up, and stands if {frame.told[0]} is: state which: plat motions convert --up"
            )
        return unchanged
    return Converted(frame.places(root_pos), (frame.told,)), Converted(frame.quaternions(root_quat))


def _steadiest(
    frames: Sequence[_Frame], place: np.ndarray, quat: np.ndarray, joint_pos: np.ndarray, soles: Soles
) -> _Frame:
    """Return the one in which the feet are flattest and slide least; the first unless another is clearly better."""
    if len(frames) == 1:
        return frames[0]
    slides = [_slide(_qpos(frame, place, quat, joint_pos), soles) for frame in frames]
    best = int(np.argmin(slides))
    return frames[best] if slides[best] < _CLEARLY * slides[0] else frames[0]


def _qpos(frame: _Frame, place: np.ndarray, quat: np.ndarray, joint_pos: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.concatenate((frame.places(place), frame.quaternions(quat), joint_pos), 1))


def _rests(place: np.ndarray, quat: np.ndarray, joint_pos: np.ndarray, soles: Soles) -> bool:
    """Return whether the lowest part of the robot, whichever that is, is on the floor in most frames."""
    qpos = np.concatenate((place, quat, joint_pos), 1)
    some = qpos[np.linspace(0, len(qpos) - 1, min(len(qpos), _SOME)).round().astype(int)]
    return float((np.abs(Underside(soles.robot).heights(some).min(1)) < 2 * _FLOOR).mean()) > _MOST


def _stands(qpos: torch.Tensor, soles: Soles) -> bool:
    """Return whether the lower sole is on the floor and flat."""
    height = soles.points(qpos)[..., 2]
    lower = height[torch.arange(len(height)), height.amin(-1).argmin(-1)]
    level, uneven = lower.amin(-1).median(), (lower.amax(-1) - lower.amin(-1)).median()
    return abs(float(level)) < _FLOOR and float(uneven) < _FLAT


def _slide(qpos: torch.Tensor, soles: Soles) -> float:
    """Return how far feet on the floor slide in a frame, mean, and a share of how uneven the lower sole is (m)."""
    points = soles.points(qpos)
    height = points[..., 2]
    lower = height[torch.arange(len(height)), height.amin(-1).argmin(-1)]
    level = float(height.amin((1, 2)).quantile(_RESTING))
    return contact_slip(points, level, 1.0) + _UNEVEN * float((lower.amax(-1) - lower.amin(-1)).median())
