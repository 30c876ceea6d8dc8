"""Jumps of a whole motion from one frame to the next, as where two clips were put together."""

from collections import Counter
from dataclasses import replace
from itertools import pairwise

import numpy as np
import torch

from plat.motions.checks.settings import ValidationLimits
from plat.motions.checks.steps import joint_steps
from plat.motions.clip import MotionClip
from plat.robots import G1, Robot
from plat.rotations import quat_conjugate, quat_multiply, quat_to_rotvec

__all__ = ["cut_motion", "root_jumps"]

# So many joints that step between the same two frames are no errors of joints: the pose is another one.
_TOGETHER = 4


def root_jumps(qpos: torch.Tensor, limits: ValidationLimits) -> list[int]:
    """Return the frames at which the root's path or turning breaks.

    Args:
        qpos: ``[T, 7 + J]``.
        limits: how large a second difference is a break.

    >>> qpos = torch.from_numpy(G1.default_qpos)[None].repeat(60, 1)
    >>> qpos[30:, 0] += 0.4
    >>> root_jumps(qpos, ValidationLimits())
    [29, 30]
    """
    turn = quat_to_rotvec(quat_multiply(qpos[1:, 3:7], quat_conjugate(qpos[:-1, 3:7])))
    breaks = (qpos[:, :3].diff(n=2, dim=0).norm(dim=-1) > limits.root_jump) | (
        turn.diff(dim=0).norm(dim=-1) > limits.turn_jump
    )
    return [int(frame) + 1 for frame in breaks.nonzero()[:, 0]]


def cut_motion(clip: MotionClip, robot: Robot = G1, limits: ValidationLimits | None = None) -> list[MotionClip]:
    """Return the pieces of a clip between its jumps, called ``<name>_c0``, ``<name>_c1``, ...

    It is cut where the root jumps, where a joint is faster than any motor, and where several joints step at once.
    Pieces that are too short to use are left out, and a clip without jumps is returned as it is.

    Args:
        clip: a motion.
        robot: names the joints.
        limits: what is a jump, and how short is too short.

    >>> qpos = G1.default_qpos[None].repeat(60, 0)
    >>> qpos[30:, 0] += 0.4
    >>> [(piece.name, len(piece.qpos)) for piece in cut_motion(MotionClip("two", qpos, 30.0))]
    [('two_c0', 30), ('two_c1', 30)]
    """
    limits = limits or ValidationLimits()
    qpos = torch.from_numpy(clip.qpos).double()
    fast = (qpos[:, 7:].diff(dim=0).abs().amax(1) * clip.fps > limits.joint_speed).nonzero()[:, 0].tolist()
    steps = Counter(step.frame for step in joint_steps(clip, limits.step_speed, robot))
    between = {*fast, *(frame for frame, count in steps.items() if count >= _TOGETHER)}
    # between two frames means that a piece ends with the first and the next begins with the second
    breaks = sorted({*root_jumps(qpos, limits), *between, *(frame + 1 for frame in between)})
    if not breaks:
        return [clip]
    ends = np.unique([0, *breaks, len(qpos) - 1]).tolist()
    pieces = [
        clip.qpos[first : last + 1] for first, last in pairwise(ends) if (last - first) / clip.fps >= limits.min_seconds
    ]
    return [replace(clip, name=f"{clip.name}_c{number}", qpos=piece) for number, piece in enumerate(pieces)]
