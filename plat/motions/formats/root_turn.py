"""Readings of a root's orientation beside the usual ones, and which of them makes the feet stand."""

from collections.abc import Mapping, Sequence

import numpy as np
import torch

from plat.errors import MotionError
from plat.motions.checks.feet import Soles, foot_steps
from plat.motions.clip import MotionClip
from plat.rotations import quat_rotate

__all__ = ["likeliest_turn", "refuse_other_turns", "turn_cost"]

# Of three numbers the reading is believed that costs this much less than any other.
_MARGIN = 0.3
# Up component of the root's own up axis, mean over the frames, below which a robot does not stand as it was read, and
# what is wrong is another thing.
_UPRIGHT = 0.5
# Readings that turn the root by less than this from each other are one (rad, largest over the frames).
_SAME = 0.01
# Frames that are looked at, in blocks of so many.
_MOST_FRAMES, _BLOCK = 300, 100
# Clips of a file that are looked at. A file has one convention, so most of them must agree.
_EXAMINED = 5
# Seconds of a clip, at least: feet that stand for a moment say nothing.
_SHORTEST = 0.5
# Nobody's feet and height are steadier than this (m/s, m, m).
_SLOW, _EVEN, _LEVEL = 0.03, 0.01, 0.01
# Where w, x, y and z of a quaternion would stand, had it been written otherwise, their signs, and how much less it must
# cost. Of 1,401 clips (Bandai-Namco, CMU, HDM05, SIE, ASE, g1-moves, ASAP, PBHC) the highest gains are 0.12, -0.39,
# -0.03 and -0.24, and of 468 of them the last two are -0.93 and -0.64. So misread, 98 to 100 % of them are seen.
_OTHERS = {
    "the conjugate, from world to root": ((0, 1, 2, 3), (1, -1, -1, -1), 0.2),
    "zyxw": ((3, 2, 1, 0), (1, 1, 1, 1), 0.2),
    "wzyx": ((0, 3, 2, 1), (1, 1, 1, 1), 0.1),
    "the conjugate, from world to root, as xyzw": ((3, 0, 1, 2), (1, -1, -1, -1), 0.1),
    "xyzw where it was read as wxyz": ((3, 0, 1, 2), (1, 1, 1, 1), 0.2),
    "wxyz where it was read as xyzw": ((1, 2, 3, 0), (1, 1, 1, 1), 0.2),
}
_ORDERS = ("xyzw where it was read as wxyz", "wxyz where it was read as xyzw")


def turn_cost(qpos: np.ndarray, fps: float, soles: Soles) -> float:
    """Return how little a motion stands: it leans, its steadier foot slides or rolls, its height varies.

    Logarithms of speed, unevenness and height's spread: 0.7 is twice as much of one of them.

    Args:
        qpos: ``[T, 7 + J]``.
        fps: frames a second.
        soles: of the robot.
    """
    poses = torch.from_numpy(_some_frames(np.asarray(qpos, dtype=np.float64)))
    up = quat_rotate(poses[:, 3:7], poses.new_tensor([0.0, 0.0, 1.0]))[:, 2].mean()
    points = soles.points(poses)
    height = points[..., 2]
    before, after = foot_steps(points)
    speed = (after - before).norm(dim=-1) * fps
    uneven = height.amax(-1) - height.amin(-1)
    spread = height.amin((1, 2)).std()
    return float(
        3 * (1 - up)
        + (speed.amin(0).mean() + _SLOW).log()
        + 0.5 * (uneven.amin(-1).mean() + _EVEN).log()
        + 0.5 * (spread + _LEVEL).log()
    )


def likeliest_turn(readings: Mapping[str, np.ndarray], fps: float, soles: Soles) -> tuple[str, bool, tuple[str, ...]]:
    """Return the reading that the feet confirm, whether they do, and the readings that they leave open.

    The first one is returned where the feet decide for none, and all that are the same as it belong to it.

    Args:
        readings: motions ``[T, 7 + J]`` of one file, the usual reading first.
        fps: frames a second.
        soles: of the robot.
    """
    first, *others = readings
    apart = [name for name in others if _angle(readings[first], readings[name]) > _SAME]
    if not apart:
        return first, True, ()
    costs = {name: turn_cost(readings[name], fps, soles) for name in (first, *apart)}
    best = min(costs, key=lambda name: costs[name])
    rivals = tuple(name for name in costs if name != best and costs[name] - costs[best] < _MARGIN)
    rivals = tuple(name for name in rivals if _angle(readings[best], readings[name]) > _SAME)
    if not rivals:
        return best, True, ()
    return first, False, tuple(name for name in (best, *rivals) if name != first)


def refuse_other_turns(clips: Sequence[MotionClip], soles: Soles) -> None:
    """Raise where the feet of most clips stand only if the root's quaternions are read in an unusual way.

    Args:
        clips: of one file, as it was read.
        soles: of the robot.

    Raises:
        MotionError: naming the reading that fits.
    """
    long = [clip for clip in clips if len(clip.qpos) >= _SHORTEST * clip.fps]
    looked_at = [clip for clip in long[:: max(1, len(long) // _EXAMINED)][:_EXAMINED] if _up(clip.qpos) > _UPRIGHT]
    found: list[str] = []
    for left, clip in zip(range(len(looked_at))[::-1], looked_at, strict=True):
        cost = turn_cost(clip.qpos, clip.fps, soles)
        gains = {
            told: cost - margin - turn_cost(_as(clip.qpos, place, sign), clip.fps, soles)
            for told, (place, sign, margin) in _OTHERS.items()
        }
        best = max(gains, key=lambda told: gains[told])
        if gains[best] > 0:
            found.append(best)
        if len(found) + left <= len(looked_at) / 2:
            return
    if not found:
        return
    told = max(set(found), key=found.count)
    if told in _ORDERS:
        advice = f"state it: plat motions convert --quat-order {told[:4]}"
    else:
        advice = (
            "write it as wxyz from root to world, or state its order ("
            "plat motions convert --quat-order) to take it as it is"
        )
    raise MotionError(f"the feet stand only if its root quaternion is {told}: {advice}")


def _as(qpos: np.ndarray, place: tuple[int, ...], sign: tuple[int, ...]) -> np.ndarray:
    other = qpos.copy()
    other[:, 3:7] = qpos[:, 3:7][:, list(place)] * np.array(sign)
    return other


def _up(qpos: np.ndarray) -> float:
    x, y = qpos[:, 4], qpos[:, 5]
    return float((1 - 2 * (x * x + y * y)).mean())


def _angle(first: np.ndarray, second: np.ndarray) -> float:
    """Return the largest angle between the roots of two motions (rad)."""
    same = np.abs((first[:, 3:7].astype(np.float64) * second[:, 3:7]).sum(1)).clip(0, 1)
    return float(2 * np.arccos(same).max())


def _some_frames(qpos: np.ndarray) -> np.ndarray:
    """Return blocks of frames all over a long motion, or a shorter one as it is."""
    if len(qpos) <= _MOST_FRAMES:
        return qpos
    starts = np.linspace(0, len(qpos) - _BLOCK, _MOST_FRAMES // _BLOCK).astype(int)
    return qpos[(starts[:, None] + np.arange(_BLOCK)).ravel()]
