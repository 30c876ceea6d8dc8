"""Motion clip: one recorded or generated motion, with its checks."""

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from plat.bounds import check_robot, is_finite
from plat.errors import MotionError
from plat.json_file import short
from plat.robots.robot import Robot
from plat.rotations_np import UNIT_TOLERANCE
from plat.words import counted

__all__ = ["ASSUMED_RATE", "MotionClip", "as_clips"]

ASSUMED_RATE = "fps assumed (another can stand in the file name: x_60fps.csv)"
"""Note of a clip whose frame rate nothing states and nothing in its motion confirms."""


@dataclass(frozen=True)
class MotionClip:
    """Motion clip of one robot.

    Args:
        name: what error messages and tables call it.
        qpos: ``[T, 7 + J]``: root position (m, world), root quaternion (``wxyz``, root to world), joint angles
            (rad, the robot's joint order). What is no array becomes one.
        fps: frames a second.
        notes: what was assumed, detected or filled in when it was read, a phrase each.
        doubt: why its file is refused unless it is read otherwise, as with another order of quaternions; empty for
            most.
    """

    name: str
    qpos: np.ndarray
    fps: float
    notes: tuple[str, ...] = ()
    doubt: str = ""

    def __post_init__(self) -> None:
        """Make arrays of lists and tensors, and numbers of a single one; :meth:`check` tells what is wrong."""
        with suppress(TypeError, ValueError, RuntimeError):
            object.__setattr__(self, "qpos", np.asanyarray(self.qpos))
        if not isinstance(self.fps, (int, float)) and is_finite(self.fps):
            object.__setattr__(self, "fps", float(self.fps))
        if isinstance(self.notes, list):
            object.__setattr__(self, "notes", tuple(self.notes))

    @property
    def duration(self) -> float:
        """Return the time from the first to the last frame (s)."""
        return (len(self.qpos) - 1) / self.fps

    def check(self, robot: Robot, least: int = 2) -> None:
        """Raise an error for a clip that is none of the robot's.

        Args:
            robot: whose joints the columns are.
            least: smallest number of frames.

        Raises:
            MotionError: as :meth:`checked`.
        """
        self._checked_norm(robot, least)

    def checked(self, robot: Robot) -> "MotionClip":
        """Return this clip in float32 with quaternions of exactly unit length.

        Raises:
            MotionError: for a wrong shape, fewer than two frames, a value that is not finite, a quaternion that
                is not of unit length, or a frame rate that is not positive.

        >>> from plat.robots import G1
        >>> MotionClip("short", np.zeros((5, 35)), 30.0).checked(G1)
        Traceback (most recent call last):
        plat.errors.MotionError: motion 'short': qpos has 35 columns, expected 36 (root xyz, quaternion wxyz, 29 joints)
        """
        norm = self._checked_norm(robot)
        qpos = self.qpos.astype(np.float64)
        qpos[:, 3:7] /= norm[:, None]
        return MotionClip(self.name, qpos.astype(np.float32), float(self.fps), self.notes, self.doubt)

    def _checked_norm(self, robot: Robot, least: int = 2) -> np.ndarray:
        """Return the lengths of the root's quaternions ``[T]`` of a clip that is whole."""
        check_robot(robot)
        if not isinstance(self.name, str):
            raise MotionError(f"motion {short(self.name)}: its name is no text")
        if not isinstance(self.notes, tuple):
            raise MotionError(f"motion {self.name!r}: notes is {short(self.notes)}, expected a tuple of texts")
        if not isinstance(self.qpos, np.ndarray):
            raise MotionError(f"motion {self.name!r}: qpos is {short(self.qpos)}, expected an array of numbers")
        qpos = self.qpos
        joints = robot.num_joints
        layout = f"root xyz, quaternion wxyz, {joints} joints"
        if qpos.ndim != 2 or qpos.dtype.kind not in "fiu":
            raise MotionError(
                f"motion {self.name!r}: qpos has shape {qpos.shape} and type {qpos.dtype}, "
                f"expected numbers of shape (frames, {7 + joints}) ({layout})"
            )
        if qpos.shape[1] != 7 + joints:
            raise MotionError(
                f"motion {self.name!r}: qpos has {counted(qpos.shape[1], 'column')}, expected {7 + joints} ({layout})"
            )
        if len(qpos) < least:
            raise MotionError(f"motion {self.name!r}: {counted(len(qpos), 'frame')}, expected at least {least}")
        if not (is_finite(self.fps) and self.fps > 0):
            raise MotionError(f"motion {self.name!r}: fps is {short(self.fps)}, expected a positive number")
        finite = np.isfinite(qpos)
        if not finite.all():
            frame, column = np.argwhere(~finite)[0]
            raise MotionError(
                f"motion {self.name!r}: qpos[{frame}, {column}] is {qpos[frame, column]}, expected a finite number"
            )
        norm = np.linalg.norm(qpos[:, 3:7], axis=1)
        frame = int(np.abs(norm - 1).argmax())
        if abs(norm[frame] - 1) > UNIT_TOLERANCE:
            raise MotionError(
                f"motion {self.name!r}: the root quaternion of frame {frame} (columns 3 to 6) has length "
                f"{norm[frame]:.4g}, expected 1"
            )
        return norm


def as_clips(clips: MotionClip | Iterable[MotionClip], told: str) -> list[MotionClip]:
    """Return clips as a list; one alone is a list of one.

    Args:
        clips: of any number.
        told: what takes them, for messages.

    Raises:
        MotionError: when there is something else among them.

    >>> as_clips(MotionClip("stand", np.zeros((2, 36)), 50.0), "motion library")[0].name
    'stand'
    """
    if isinstance(clips, MotionClip):
        return [clips]
    if not isinstance(clips, Iterable):
        raise MotionError(f"{told}: {short(clips)} in the place of clips, expected MotionClips")
    found = list(clips)
    for clip in found:
        if not isinstance(clip, MotionClip):
            raise MotionError(f"{told}: {short(clip)} among the clips, expected a MotionClip")
    return found
