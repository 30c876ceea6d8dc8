"""Whether a motion has the right frame rate, seen by how often it steps."""

import math
from dataclasses import dataclass

import numpy as np
import torch

from plat.motions.clip import MotionClip
from plat.robots.kinematics import ForwardKinematics
from plat.robots.robot import Robot
from plat.rotations import quat_rotate

__all__ = ["Cadence", "Tempo"]

# Steps a second of walking and running with a step of 1 m, and the power of the step's length with which they rise.
# Measured on 951 clips with regular steps of retargeted people (Bandai-Namco, CMU, HDM05, SIE, ASE, g1-moves); 99 % of
# them step at 0.62 to 1.64 times that rate.
_STEPS_PER_SECOND = 2.54
_POWER = 0.285
_USUAL = 1.6
# A foot is in front when it is this far before the other one (m).
_IN_FRONT = 0.08
_LEAST_STEPS = 4
# Standard deviation of the logarithm of steps' durations beyond which there is no gait.
_IRREGULAR = 0.35
# Who strides moves on by about a stride with each step (share of it, lowest and highest); who moves by less than the
# last share strides in place.
_MOVES, _IN_PLACE = (0.5, 3.0), 0.25
# Strides (m) below which someone may step in place.
_STRIDE = 0.15
# Steps are counted in so many frames: kinematics takes kilobytes for each.
_MOST_FRAMES = 20_000


@dataclass(frozen=True)
class Tempo:
    """The steps of a gait.

    Attributes:
        frames: from step to step, median.
        length: that the root moves in a step, median (m).
    """

    frames: float
    length: float

    @classmethod
    def of(cls, clip: MotionClip, robot: Robot) -> "Tempo | None":
        """Return the steps of a clip, or None where it has no regular gait. The clip's frame rate is not looked at."""
        cadence = Cadence.of(clip, robot)
        return None if cadence is None else cadence.tempo

    @property
    def likely_rate(self) -> float:
        """Return the frames a second with which the steps are as frequent as steps of that length usually are."""
        return self.frames * _STEPS_PER_SECOND * self.length**_POWER

    def ratio(self, fps: float) -> float:
        """Return how many times as often as usual it steps at a frame rate."""
        return fps / self.likely_rate

    def fits(self, fps: float) -> bool:
        """Return whether a frame rate makes the steps as frequent as people's, give or take what is usual."""
        return abs(math.log(self.ratio(fps))) < math.log(_USUAL)


@dataclass(frozen=True)
class Cadence:
    """Cadence of regular steps, medians.

    Attributes:
        frames: from step to step.
        length: that the root moves in a step (m).
        stride: how far the feet are apart (m).

    >>> from plat.robots import G1
    >>> Cadence.of(MotionClip("standing", G1.default_qpos[None].repeat(60, 0), 30.0), G1) is None
    True
    """

    frames: float
    length: float
    stride: float

    @classmethod
    def of(cls, clip: MotionClip, robot: Robot, feet: torch.Tensor | None = None) -> "Cadence | None":
        """Return the cadence of a clip. Steps that are few or irregular have none, and give None.

        Args:
            clip: the motion; its frame rate is not looked at.
            robot: whose it is.
            feet: their positions ``[T, 2, 3]`` (m, world) where they are known.
        """
        qpos = torch.from_numpy(clip.qpos[:_MOST_FRAMES]).double()
        if feet is None:
            feet, _ = ForwardKinematics(robot, robot.feet)(*qpos.split((3, 4, robot.num_joints), -1))
        forward = quat_rotate(qpos[:, 3:7], qpos.new_tensor([1.0, 0.0, 0.0]))[:, :2]
        forward = forward / forward.norm(dim=-1, keepdim=True).clamp_min(1e-6)
        apart = feet[: len(qpos), 0, :2] - feet[: len(qpos), 1, :2]
        lead = (apart * forward).sum(-1).numpy()
        turns = _extremes(lead)
        if len(turns) <= _LEAST_STEPS:
            return None
        frames = np.diff(turns)
        if np.log(frames).std() > _IRREGULAR:
            return None
        moved = np.linalg.norm(np.diff(clip.qpos[turns, :2].astype(np.float64), axis=0), axis=1)
        return cls(float(np.median(frames)), float(np.median(moved)), float(np.median(np.abs(lead[turns]))))

    @property
    def tempo(self) -> "Tempo | None":
        """Return the steps of who moves on with them; None for others."""
        moves = _MOVES[0] * self.stride < self.length < _MOVES[1] * self.stride
        return Tempo(self.frames, self.length) if moves else None

    @property
    def in_place(self) -> bool:
        """Return whether the feet stride and the root does not move: it is kept in place, or relative."""
        return self.stride > _STRIDE and self.length < _IN_PLACE * self.stride


def _extremes(lead: np.ndarray) -> np.ndarray:
    """Return the frames in which one foot is furthest before the other, one for each time that it goes in front."""
    found: list[int] = []
    sign = 0.0
    for frame, value in enumerate(lead):
        if abs(value) <= _IN_FRONT:
            continue
        if np.sign(value) != sign:
            sign = np.sign(value)
            found.append(frame)
        elif abs(value) > abs(lead[found[-1]]):
            found[-1] = frame
    return np.array(found, dtype=int)
