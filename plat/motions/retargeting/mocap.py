"""A human's motion as capture files have it: a skeleton, and where its joints are."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from plat.errors import MotionError
from plat.motions.formats.rate import RATES

__all__ = ["FPS", "LARGEST_RADIANS", "Mocap", "check_extent", "checked_rate", "may_be_radians", "reads_better"]

# A body with fingers and a face has 200 joints.
_MOST_JOINTS = 2000
_GENEROUS_NUMBERS, _MOST_NUMBERS_A_BYTE = 8 << 20, 4
_LEAST_RADIANS = 0.5  # what is below is a rest pose
LARGEST_RADIANS = 7.0
"""No body has an angle above this in radians. In degrees all are below it only near a rest pose that stands."""
# Feet hold still, and only in the right unit of angles. Captures of six kinds in radians (Bandai-Namco, CMU, MASS) move
# by at most 0.43 of what they do in degrees; people who stand, sway or glide in small degrees by at least 0.59.
_STILLER = 0.5
# Cosine to their mean direction: LAFAN1's skeleton is such a bundle before it turns, and no body is.
_BUNDLED = 0.97
# A rounded frame time makes another rate of a usual one by a smaller share than this.
_ROUNDED = 0.025
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
    """Return the frames a second of a stated frame time (s), the usual one of a rounded time.

    Raises:
        MotionError: for a rate that no capture has, with the rates that the number may mean.

    >>> checked_rate("a.bvh", 0.0333333), checked_rate("a.bvh", 0.017), checked_rate("a.bvh", 0.033367)
    (30.0, 60.0, 29.969730572122156)
    """
    # files round the frame time: 0.0333333 is 30 frames a second, and 0.017 are 60
    fps = 1.0 / seconds
    last = 10.0 ** -len(f"{seconds:.10f}".rstrip("0").partition(".")[2])  # decimal that is written
    usual = [rate for rate in RATES if abs(1 / rate - seconds) < last and abs(rate - fps) < _ROUNDED * fps]
    if abs(fps - round(fps)) < 1e-3 * fps:
        fps = float(round(fps))
    elif len(usual) == 1:
        fps = usual[0]
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
        f"{FPS[1]:g}{told}; state it: plat motions convert --fps"
    )


def may_be_radians(angles: np.ndarray) -> bool:
    """Return whether the angles ``[T, C]`` of a body are small enough for radians, and move too much for a rest pose.

    >>> may_be_radians(np.array([[0.0, 1.5], [0.4, -1.5]])), may_be_radians(np.array([[0.0, 1.5], [0.4, -90.0]]))
    (True, False)
    """
    largest, moving = np.abs(angles).max(initial=0.0), np.ptp(angles, axis=0).max(initial=0.0)
    return bool(_LEAST_RADIANS < largest <= LARGEST_RADIANS and moving >= _LEAST_RADIANS)


def reads_better(places: np.ndarray, others: np.ndarray, parents: Sequence[int]) -> bool:
    """Return whether joints are where a body's are, and in another reading of the file, with angles smaller, are not.

    In the other one either no end of a limb holds still, frame by frame, or all are on one side of the root.

    Args:
        places: of the joints ``[T, J, 3]``.
        others: those of the other reading.
        parents: index of the parent of each, -1 for a root.
    """
    ends = [joint for joint in range(len(parents)) if joint not in set(parents)]
    if len(places) < 2 or len(ends) < 2:
        return False
    moved, other = (np.median(np.linalg.norm(np.diff(at[:, ends], axis=0), axis=-1).min(1)) for at in (places, others))
    bundled, before = (_bundled(at[:, ends] - at[:, :1]) for at in (others, places))
    return bool(moved < _STILLER * other or (bundled and not before))


def _bundled(ends: np.ndarray) -> bool:
    """Return whether the ends of limbs ``[T, E, 3]`` lie in about the same direction from the root."""
    ways = ends / np.linalg.norm(ends, axis=-1, keepdims=True).clip(1e-9)
    mean = ways.mean(1, keepdims=True)
    mean = mean / np.linalg.norm(mean, axis=-1, keepdims=True).clip(1e-9)
    return bool(np.median((ways * mean).sum(-1).min(1)) > _BUNDLED)
