"""Isolated single-frame steps of joints: errors of retargeting and tracking that no motor can follow."""

from dataclasses import dataclass

import numpy as np

from plat.bounds import Positive, check_value
from plat.motions.clip import MotionClip
from plat.robots import G1, Robot

__all__ = ["SPREAD_SECONDS", "JointStep", "SmoothedSteps", "joint_steps", "smooth_steps"]

# A step is this much faster than anything else of the joint within _AROUND (s) to both sides.
_ISOLATED = 3.0
_AROUND = 0.1

SPREAD_SECONDS = 0.15
"""How long to both sides a step is spread over (s)."""


@dataclass(frozen=True)
class JointStep:
    """Single-frame step of a joint.

    Attributes:
        joint: its name.
        frame: the last one before the step.
        speed: of the step (rad/s).
    """

    joint: str
    frame: int
    speed: float

    def __str__(self) -> str:
        return f"of {self.joint} after frame {self.frame} at {self.speed:.0f} rad/s"


@dataclass(frozen=True)
class SmoothedSteps:
    """Clip whose single-frame steps were smoothed.

    Attributes:
        clip: the smoothed motion.
        steps: how many were found.
        largest_change: of any joint angle (rad).
    """

    clip: MotionClip
    steps: int
    largest_change: float


def joint_steps(clip: MotionClip, speed: float = 10.0, robot: Robot = G1) -> list[JointStep]:
    """Return the isolated single-frame steps of a clip, by time.

    A joint steps if between two frames it is faster than ``speed``, and three times as fast as between any others
    within 0.1 s. An excursion of one frame, there and back, is two steps. A fast kick speeds up and slows down over
    several frames, so it is none.

    Args:
        clip: a motion.
        speed: below it nothing is a step (rad/s).
        robot: names the joints.

    >>> qpos = G1.default_qpos[None].repeat(60, 0)
    >>> qpos[30:, 7] += 0.5
    >>> [(step.joint, step.frame, round(step.speed)) for step in joint_steps(MotionClip("step", qpos, 30.0))]
    [('left_hip_pitch', 29, 15)]
    """
    clip.check(robot)
    check_value("single-frame steps: speed", speed, Positive)
    found, _ = _steps(clip, speed)
    speeds = np.abs(np.diff(clip.qpos[:, 7:].astype(np.float64), axis=0)) * clip.fps
    return [
        JointStep(robot.joint_names[joint], int(frame), float(speeds[frame, joint]))
        for frame, joint in np.argwhere(found)
    ]


def smooth_steps(clip: MotionClip, speed: float = 10.0, robot: Robot = G1) -> SmoothedSteps:
    """Spread the isolated single-frame steps of a clip over 0.15 s to both sides.

    What a step adds to the joint's usual change between frames is replaced by a smooth ramp of the same height. The
    joint's other motion in that time stays, and no angle is carried beyond a limit.

    Args:
        clip: a motion.
        speed: below it nothing is a step (rad/s).
        robot: gives the joint limits.

    >>> qpos = G1.default_qpos[None].repeat(60, 0)
    >>> qpos[30:, 7] += 0.5
    >>> smoothed = smooth_steps(MotionClip("step", qpos, 30.0))
    >>> smoothed.steps, round(smoothed.largest_change, 2), joint_steps(smoothed.clip)
    (1, 0.21, [])
    """
    clip.check(robot)
    check_value("single-frame steps: speed", speed, Positive)
    found, usual = _steps(clip, speed)
    qpos = clip.qpos.astype(np.float64)
    angles = qpos[:, 7:]
    before = angles.copy()
    change = np.diff(before, axis=0)
    reach = max(1, round(SPREAD_SECONDS * clip.fps))
    for frame, joint in np.argwhere(found):
        height = change[frame, joint] - usual[frame, joint]
        first, last = max(0, frame - reach), min(len(angles) - 1, frame + 1 + reach)
        share = np.linspace(0.0, 1.0, last - first + 1)
        ramp = share**2 * (3 - 2 * share)
        step = np.arange(first, last + 1) > frame
        angles[first : last + 1, joint] += height * (ramp - step)
    low, high = robot.joint_range.double().numpy().T
    np.clip(angles, np.minimum(low, before.min(0)), np.maximum(high, before.max(0)), out=angles)
    smoothed = MotionClip(clip.name, qpos.astype(clip.qpos.dtype), clip.fps, clip.notes)
    return SmoothedSteps(smoothed, int(found.sum()), float(np.abs(angles - before).max()))


def _steps(clip: MotionClip, speed: float) -> tuple[np.ndarray, np.ndarray]:
    """Return which changes between frames are isolated steps ``[T - 1, J]``, and how much is usual around each."""
    change = np.diff(clip.qpos[:, 7:].astype(np.float64), axis=0)
    fast = np.abs(change)
    reach = max(2, round(_AROUND * clip.fps))
    count = len(change)
    found = np.zeros(change.shape, bool)
    usual = np.zeros(change.shape)
    for frame, joint in np.argwhere(fast * clip.fps > speed):
        around = [other for other in range(max(0, frame - reach), min(count, frame + reach + 1)) if other != frame]
        # an excursion of one frame: the way back stands beside the way there
        ways = [
            other
            for other in (frame - 1, frame + 1)
            if other in around
            and change[other, joint] * change[frame, joint] < 0
            and 0.5 < fast[other, joint] / fast[frame, joint] < 2
        ]
        partner = max(ways, key=lambda other: fast[other, joint], default=None)
        others = [other for other in around if other != partner]
        if others and fast[frame, joint] > _ISOLATED * fast[others, joint].max():
            found[frame, joint] = True
            usual[frame, joint] = np.median(change[others, joint])
    return found, usual
