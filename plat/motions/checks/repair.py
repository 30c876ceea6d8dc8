"""Repairs of clips: feet to the floor, joints into their limits, ends off."""

from dataclasses import replace
from typing import Literal

import numpy as np
import torch

from plat.errors import MotionError
from plat.json_file import short
from plat.motions.checks.feet import Soles, ground_level, stance
from plat.motions.checks.underside import Underside
from plat.motions.clip import MotionClip
from plat.robots import G1, Robot
from plat.robots.kinematics import ForwardKinematics
from plat.rotations import quat_rotate_inverse

__all__ = ["Grounding", "clip_to_limits", "ground_feet", "level_feet", "trim_motion"]

Grounding = Literal["clip", "smooth"]

# Width of the mean over a floor that drifts (s).
_DRIFT_SECONDS = 0.3

# A foot stands when it rests, and is no higher than this over the lower one (m).
_STANDING_HEIGHT = 0.04

# How high resting feet may float for the sake of feet under the floor, median (m).
_FLOATING = 0.01

# Width of the mean over which a foot is levelled and let go (s).
_LEVEL_SECONDS = 0.15


def ground_feet(clip: MotionClip, how: Grounding = "clip", robot: Robot = G1) -> MotionClip:
    """Return the clip with its feet on the floor.

    Args:
        clip: a motion that floats or sinks.
        how: ``"clip"`` lowers or raises all frames alike, so that the lower foot rests at height 0 in the median.
            ``"smooth"`` follows a floor that drifts: its height is taken where the lower foot rests, carried on in
            between, so that jumps stay jumps, smoothed, and lowered where a foot would still be under it. That
            lowering makes resting feet float by 1 cm at most, in the median; the rest of a foot's dips stays.
        robot: the robot.

    Raises:
        MotionError: for a clip that is none of the robot's, and another way.

    >>> qpos = G1.default_qpos[None].repeat(60, 0)
    >>> qpos[:, 2] += 0.1
    >>> lowered = ground_feet(MotionClip("floating", qpos, 30.0)).qpos[0, 2] - qpos[0, 2]
    >>> round(float(lowered), 2)
    -0.1
    """
    clip.check(robot)
    if how not in ("clip", "smooth"):
        raise MotionError(f"motion {clip.name!r}: to be grounded by {short(how)}, expected 'clip' or 'smooth'")
    points = Soles(robot).points(torch.from_numpy(clip.qpos))
    resting = stance(points, clip.fps)
    # of who lies or kneels another part is on the floor
    low = np.minimum(points[..., 2].amin((-1, -2)).numpy(), Underside(robot).heights(clip.qpos).min(1))
    if how == "clip" or not resting.any():
        level: float | np.ndarray = ground_level(points, clip.fps, low)
    else:
        frames = np.arange(len(low))
        width = _DRIFT_SECONDS * clip.fps
        level = _smooth(np.interp(frames, frames[resting], low[resting]), width)
        # a foot that moves too fast to count as resting may still be lower than the floor between two rests
        sunk = np.maximum(level - low, 0)
        reach = _reach(width)
        windows = np.lib.stride_tricks.sliding_window_view(np.pad(sunk, reach, mode="edge"), 2 * reach + 1)
        raised = _smooth(windows.max(-1), width)
        # heels and toes that dip under the floor between short rests would lift the rests as well
        floating = float(np.median((low - level + raised)[resting]))
        level -= raised * min(1.0, _FLOATING / floating if floating > 0 else 1.0)
    qpos = clip.qpos.copy()
    qpos[:, 2] -= level
    return replace(clip, qpos=qpos)


def level_feet(clip: MotionClip, robot: Robot = G1) -> MotionClip:
    """Return the clip with the soles of standing feet level, as far as the ankles reach.

    Motion that was estimated from video stands on the edges of its feet, tilted by ten to thirty degrees: a pose that a
    robot can only copy by balancing on its toes. Here the ankles are turned until the sole is level wherever a foot
    rests near the height of the lower one. Nothing else moves, so ground the feet afterwards.

    Args:
        clip: a motion.
        robot: the robot; each foot is the body of an ankle's roll joint (x), which follows its pitch joint (y).

    Raises:
        MotionError: for a robot with other ankles.

    >>> qpos = G1.default_qpos[None].repeat(60, 0)
    >>> ankle = 7 + G1.joint_names.index("left_ankle_pitch")
    >>> qpos[:, ankle] += 0.3
    >>> round(float(qpos[0, ankle] - level_feet(MotionClip("toes down", qpos, 30.0)).qpos[0, ankle]), 1)
    0.3
    """
    clip.check(robot)
    model = robot.shared_model
    qpos = torch.from_numpy(clip.qpos.copy()).double()
    points = Soles(robot).points(qpos)
    low = points[..., 2].amin(-1)
    _, foot_quat = ForwardKinematics(robot, robot.feet)(*qpos.split((3, 4, robot.num_joints), -1))
    upward = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64).expand(len(qpos), 3)
    low_angle, high_angle = robot.joint_range.double().unbind(-1)
    for foot, name in enumerate(robot.feet):
        standing = stance(points[:, foot : foot + 1], clip.fps) & (low[:, foot] < low.amin(-1) + _STANDING_HEIGHT)
        share = torch.from_numpy(_smooth(standing.double().numpy(), _LEVEL_SECONDS * clip.fps))
        body = model.body(name).id
        roll, pitch = _ankle(robot, body, name)
        # the upward direction in the foot's frame, and turned back by roll and pitch in the shin's
        x, y, z = quat_rotate_inverse(foot_quat[:, foot], upward).unbind(-1)
        y, z = _turn(y, z, qpos[:, 7 + roll])
        z, x = _turn(z, x, qpos[:, 7 + pitch])
        for joint, level in ((roll, -y.clamp(-1, 1).asin()), (pitch, torch.atan2(x, z))):
            angle = qpos[:, 7 + joint]
            angle += share * (level.clamp(low_angle[joint], high_angle[joint]) - angle)
    return replace(clip, qpos=qpos.numpy())


def _ankle(robot: Robot, foot: int, name: str) -> tuple[int, int]:
    """Return the columns of roll and pitch of a foot's ankle among the robot's joints."""
    model = robot.shared_model
    joints = [int(model.body_jntadr[body]) for body in (foot, model.body_parentid[foot])]
    for joint, axis in zip(joints, np.eye(3), strict=False):
        if joint < 1 or not np.allclose(model.jnt_axis[joint], axis, atol=0.1):
            raise MotionError(
                f"feet of robot {robot.name!r} cannot be leveled: {name!r} is not the body of a roll joint (x) after a "
                "pitch joint (y)"
            )
    return joints[0] - 1, joints[1] - 1  # the root's is 0


def clip_to_limits(clip: MotionClip, robot: Robot = G1) -> MotionClip:
    """Return the clip with every joint angle inside the joint's limits.

    Raises:
        MotionError: for a clip that is none of the robot's.
    """
    clip.check(robot)
    low, high = robot.joint_range.numpy().T
    return replace(clip, qpos=np.concatenate((clip.qpos[:, :7], clip.qpos[:, 7:].clip(low, high)), 1))


def trim_motion(clip: MotionClip, start: float = 0.0, end: float = 0.0) -> MotionClip:
    """Return the clip without its first ``start`` and last ``end`` seconds.

    Raises:
        MotionError: when less than two frames would be left.
    """
    inside = start >= 0 and end >= 0 and start + end <= clip.duration  # nan is not
    first, last = (round(start * clip.fps), len(clip.qpos) - round(end * clip.fps)) if inside else (0, 0)
    if last - first < 2:
        raise MotionError(
            f"motion {clip.name!r}: {clip.duration:.2f} s cannot lose {start} s at the start and {end} s at the end"
        )
    return replace(clip, qpos=clip.qpos[first:last])


def _turn(first: torch.Tensor, second: torch.Tensor, angle: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Two coordinates of vectors, turned in their plane from the first axis toward the second."""
    return first * angle.cos() - second * angle.sin(), first * angle.sin() + second * angle.cos()


def _smooth(values: np.ndarray, width: float) -> np.ndarray:
    """Gaussian mean over about ``width`` frames; the ends are carried on."""
    reach = _reach(width)
    weight = np.exp(-0.5 * (np.arange(-reach, reach + 1) / (0.5 * width)) ** 2)
    return np.convolve(np.pad(values, reach, mode="edge"), weight / weight.sum(), mode="valid")


def _reach(width: float) -> int:
    return max(1, round(width))
