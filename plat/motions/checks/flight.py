"""Whether a motion has the right frame rate, seen by how fast it falls."""

import math
from dataclasses import dataclass

import mujoco
import numpy as np
import torch

from plat.motions.checks.feet import Soles
from plat.motions.clip import MotionClip
from plat.robots.robot import Robot

__all__ = ["Flight"]

_GRAVITY = 9.81
# In flight are both soles this far over where they rest (m).
_HEIGHT = 0.05
# Shortest and longest flight (frames), and how far the mass falls in it at least (m).
_FRAMES = (5, 400)
_FALL = 0.02
# Share of the height's variance that a parabola explains, at least: a body that leans on something falls otherwise.
_FREE = 0.99
# Motions are scaled to the robot and time is not, so that things fall at 0.75 g. Of 87 clips with a
# flight (CMU, HDM05, SIE, ASE, g1-moves, ASAP) the rate that gravity gives is 0.72 to 1.62 times the true one, median
# 1.13.
_LOW, _HIGH = 0.66, 1.7


@dataclass(frozen=True)
class Flight:
    """The free fall of a motion.

    Attributes:
        fall: of the center of mass in a frame, per frame (m), in the flight in which it is fastest.
    """

    fall: float

    @classmethod
    def of(cls, clip: MotionClip, robot: Robot, points: torch.Tensor | None = None) -> "Flight | None":
        """Return the fall of a clip, or None where it has no flight. The clip's frame rate is not looked at.

        Args:
            clip: the motion.
            robot: whose it is.
            points: of its soles ``[T, 2, P, 3]`` where they are known, see :class:`~plat.motions.checks.feet.Soles`.
        """
        points = Soles(robot).points(torch.from_numpy(clip.qpos)) if points is None else points
        low = points[..., 2].amin((1, 2)).numpy()
        up = low > np.percentile(low, 10) + _HEIGHT
        edges = np.flatnonzero(np.diff(np.concatenate(([0], up.astype(int), [0]))))
        falls = []
        for start, end in zip(edges[::2], edges[1::2], strict=True):
            # the ends of a clip cut flights, and a body that hangs there is in none
            if _FRAMES[0] <= end - start <= _FRAMES[1] and start > 0 and end < len(up):
                falls.append(_fall(clip.qpos[start:end], robot))
        return cls(max(falls)) if falls and max(falls) > 0 else None

    @property
    def likely_rate(self) -> float:
        """Return the frames a second with which it falls at one g."""
        return math.sqrt(_GRAVITY / self.fall)

    def gravity(self, fps: float) -> float:
        """Return the acceleration of the fall at a frame rate, in g."""
        return (fps / self.likely_rate) ** 2

    def fits(self, fps: float) -> bool:
        """Return whether a frame rate makes it fall as robots' motions do, give or take what is usual."""
        return _LOW < self.likely_rate / fps < _HIGH


def _fall(qpos: np.ndarray, robot: Robot) -> float:
    """Return how fast the center of mass falls (m per frame squared), 0 where it does not fall freely."""
    model, data = robot.shared_model, mujoco.MjData(robot.shared_model)
    height = np.empty(len(qpos))
    for frame, pose in enumerate(qpos):
        data.qpos[:] = pose
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        height[frame] = data.subtree_com[1, 2]
    time = np.arange(len(qpos)) - 0.5 * (len(qpos) - 1)
    fit = np.polyfit(time, height, 2)
    rest = ((height - np.polyval(fit, time)) ** 2).sum() / max(((height - height.mean()) ** 2).sum(), 1e-12)
    return max(0.0, -2 * float(fit[0])) if rest < 1 - _FREE and -fit[0] * time[-1] ** 2 > _FALL else 0.0
