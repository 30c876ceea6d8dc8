"""What a retargeted motion could not do that the human did, in words."""

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np
import torch

from plat.motions.checks.collision import self_penetration
from plat.motions.clip import MotionClip
from plat.motions.retargeting.geometry import TRACKED
from plat.motions.retargeting.options import SolverOptions
from plat.motions.retargeting.targets import Targets
from plat.robots.kinematics import ForwardKinematics
from plat.robots.robot import Robot

__all__ = ["shortfalls"]

# What is worth a word: a body this far from its target, the robot raised or a target raised by this much, links this
# deep in each other (m), and a joint at its speed limit for so many frames.
_OFF, _RAISED, _INSIDE = 0.1, 0.02, 0.03
_AT_LIMIT = 3
# A foot whose contact is above this stands.
_STANDS = 0.9
# Collisions are looked for this often (Hz).
_COLLISION_RATE = 10.0


def shortfalls(
    clip: MotionClip,
    targets: Targets,
    robot: Robot,
    options: SolverOptions,
    raised: Mapping[str, float],
    lifted: np.ndarray,
    heights: np.ndarray,
    bodies: Sequence[str],
) -> tuple[str, ...]:
    """Return what was not reached, a phrase each; nothing for a motion that follows the human.

    Args:
        clip: the motion.
        targets: where the bodies should be.
        robot: whose they are.
        options: give the speed limit of the joints.
        raised: role to how far its target was raised above the floor (m).
        lifted: height by which the robot was raised ``[T]`` (m).
        heights: of the lowest points of the robot's parts before that ``[T, G]`` (m).
        bodies: name of the body of each part.
    """
    told = []
    poses = torch.from_numpy(clip.qpos).float()
    names = tuple(TRACKED[role] for role in targets.positions)
    reached = ForwardKinematics(robot, names)(*poses.split((3, 4, robot.num_joints), -1))[0].numpy()
    off = np.linalg.norm(reached - np.stack(list(targets.positions.values()), 1), axis=-1)
    frame, column = np.unravel_index(off.argmax(), off.shape)
    if off[frame, column] > _OFF:
        role = _called(list(targets.positions)[column])
        told.append(f"{role} {100 * off[frame, column]:.0f} cm off its target at {frame / clip.fps:.1f} s")
    fast = np.abs(np.diff(clip.qpos[:, 7:], axis=0)) * clip.fps > 0.999 * options.max_joint_speed
    joint = int(fast.sum(0).argmax())
    if fast[:, joint].sum() >= _AT_LIMIT:
        told.append(f"{_called(robot.joint_names[joint])} at its speed limit for {fast[:, joint].sum()} frames")
    if max(contact.max() for contact in targets.contact.values()) <= _STANDS:
        told.append("no foot ever stands still on the floor")
    kept = [f"{_called(role)} by {100 * depth:.0f} cm" for role, depth in raised.items() if depth > _RAISED]
    if kept:
        told.append(f"kept out of the floor: {', '.join(kept)}")
    frame = int(lifted.argmax())
    if lifted[frame] > _RAISED:
        part = _called(bodies[int(heights[frame].argmin())].removesuffix("_link"))
        told.append(f"raised by {100 * lifted[frame]:.0f} cm at {frame / clip.fps:.1f} s, for the {part} on the floor")
    data = mujoco.MjData(robot.shared_model)
    every = max(1, round(clip.fps / _COLLISION_RATE))
    depths = [self_penetration(robot.shared_model, pose, data) for pose in clip.qpos[::every]]
    frame = int(np.argmax(depths))
    if depths[frame] > _INSIDE:
        told.append(f"links {100 * depths[frame]:.0f} cm inside each other at {frame * every / clip.fps:.1f} s")
    return tuple(told)


def _called(name: str) -> str:
    return name.replace("_", " ")
