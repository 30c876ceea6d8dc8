"""A human's motion as capture files have it: a skeleton, and where its joints are."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from plat.errors import MotionError

__all__ = ["FPS", "Mocap", "checked_rate"]

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
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    positions: np.ndarray
    rotations: np.ndarray | None
    fps: float
    rest: np.ndarray
    notes: tuple[str, ...] = ()


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
