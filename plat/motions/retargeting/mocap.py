"""A human's motion as capture files have it: a skeleton, and where its joints are."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from plat.errors import MotionError

__all__ = ["FPS", "LARGEST_RADIANS", "Mocap", "check_extent", "checked_rate", "may_be_radians", "turns_all_around"]

# A body with fingers and a face has 200 joints.
_MOST_JOINTS = 2000
_GENEROUS_NUMBERS, _MOST_NUMBERS_A_BYTE = 8 << 20, 4
_LEAST_RADIANS = 0.5  # what is below is a rest pose
LARGEST_RADIANS = 7.0
"""No body has an angle above this in radians. In degrees all are below it only near a rest pose that stands."""
# Length of the mean of a joint's rotations: 1 where it rests, 0 where it turns all around. Of 333 clips
# (Bandai-Namco, CMU, MASS) none has more than two joints below 0.79.
_ALL_AROUND, _MOST_AROUND = 0.6, 2
FPS = (8.0, 1000.0)
"""Frames a second of motion capture, lowest and highest."""


@dataclass(frozen=True)
class Mocap:
    """The motion of a skeleton of J joints over T frames.

    Attributes:
        names: of joints and end sites; the end site of ``Hand`` is called ``Hand_end``.
        parents: index of the parent of each, -1 for a root.
        positions: ``[T, J, 3]``, in the file's own units and world axes.
        rotations: ``[T, J, 3, 3]``, from the joint's axes to those of the world; None where there are only positions.
        fps: frames a second.
        rest: places of the joints in the skeleton's rest pose ``[J, 3]``.
        notes: what was assumed or put right, a phrase each.
        up: axis that points up as the format has it, ``x``, ``y`` or ``z``; None where it has none.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    positions: np.ndarray
    rotations: np.ndarray | None
    fps: float
    rest: np.ndarray
    notes: tuple[str, ...] = ()
    up: str | None = None


def check_extent(where: str, joints: int, frames: int, size: int) -> None:
    """Raise for a capture whose skeleton and frames need far more memory than its file.

    A joint with a channel takes at least two bytes a frame; those without take none, and twelve numbers in memory.

    Args:
        where: begins the message.
        joints: of its skeleton, with end sites.
        frames: of its motion.
        size: bytes of the file.

    Raises:
        MotionError: for more than 2,000 joints, or more than four numbers a byte and 8 million.

    >>> check_extent("BVH file 'a.bvh'", joints=80, frames=400_000, size=300_000_000)
    """
    if joints > _MOST_JOINTS:
        raise MotionError(f"{where}: {joints} joints, expected at most {_MOST_JOINTS}")
    if 12 * joints * frames > max(_GENEROUS_NUMBERS, _MOST_NUMBERS_A_BYTE * size):
        raise MotionError(
            f"{where}: {joints} joints over {frames} frames in {size / 1e6:.3g} MB: most of them do not move"
        )


def checked_rate(path: str | Path, seconds: float) -> float:
    """Return the frames a second of a stated frame time (s).

    Raises:
        MotionError: for a rate that no capture has, with the rates that the number may mean.

    >>> checked_rate("a.bvh", 0.0333333)
    30.0
    """
    # files round the frame time: 0.0333333 is 30 frames a second
    fps = 1.0 / seconds
    fps = float(round(fps)) if abs(fps - round(fps)) < 1e-3 * fps else fps
    if FPS[0] <= fps <= FPS[1]:
        return fps
    meant = []
    for what, rate in (("milliseconds", 1e3 / seconds), ("microseconds", 1e6 / seconds), ("a rate", seconds)):
        if FPS[0] <= rate <= FPS[1]:
            meant.append(
                f"{rate:.4g} if it is in {what}" if what != "a rate" else f"{rate:.4g} if it is the rate itself"
            )
    told = f" ({', '.join(meant)})" if meant else ""
    raise MotionError(
        f"BVH file {str(path)!r}: 'Frame Time' {seconds:g} s is {fps:.3g} frames a second, expected {FPS[0]:g} to "
        f"{FPS[1]:g}{told}; state it: --fps"
    )


def may_be_radians(angles: np.ndarray) -> bool:
    """Return whether the angles ``[T, C]`` of a body are small enough for radians, and move too much for a rest pose.

    >>> may_be_radians(np.array([[0.0, 1.5], [0.4, -1.5]])), may_be_radians(np.array([[0.0, 1.5], [0.4, -90.0]]))
    (True, False)
    """
    largest, moving = np.abs(angles).max(initial=0.0), np.ptp(angles, axis=0).max(initial=0.0)
    return bool(_LEAST_RADIANS < largest <= LARGEST_RADIANS and moving >= _LEAST_RADIANS)


def turns_all_around(rotations: np.ndarray, parents: Sequence[int]) -> bool:
    """Return whether more than two joints turn all around, as those of nobody do: degrees taken for radians.

    Args:
        rotations: of the joints to the world ``[T, J, 3, 3]``.
        parents: index of the parent of each, -1 for a root, which may turn as it likes.
    """
    around = 0
    for joint, parent in enumerate(parents):
        if parent >= 0:
            turn = (rotations[:, parent].swapaxes(-1, -2) @ rotations[:, joint]).mean(0)
            around += bool(np.linalg.svd(turn, compute_uv=False)[-1] < _ALL_AROUND)
    return around > _MOST_AROUND
