"""Robot-centric goals: a target pose in the robot's root frame, the goal ``g`` of the paper, whole or in parts."""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from tensordict import TensorDictBase
from torch import Tensor

from plat.bounds import Count, check_value
from plat.robots.robot import Robot
from plat.rotations import matrix_to_sixd, quat_to_matrix, rows_times_matrices
from plat.spec.observation import as_observed, observed
from plat.spec.timing import SOON, Timing

__all__ = ["GOAL_ENTRIES", "GoalView", "clock_entries", "parts_entries", "robot_centric_goal", "strided_offsets"]


@dataclass(frozen=True)
class GoalView:
    """Inputs from which the entries of a goal are computed, for targets ``[*B]`` or ``[*B, L]``.

    Args:
        target: poses as :meth:`plat.motions.MotionLibrary.poses` gives them.
        root_pos_w: position of the robot's root ``[*B, 3]`` (m, world).
        keypoint_pos_b: from the robot's root to the target's keypoints ``[..., K, 3]`` (m, root frame), the root first.
        turned: function that rotates vectors ``[..., n, 3]`` from the world into the robot's root frame.
        parts: mask ``[..., J + K + 3]`` of what is commanded (:class:`plat.spec.parts.Parts`); None for whole poses.
    """

    target: TensorDictBase
    root_pos_w: Tensor
    keypoint_pos_b: Tensor
    turned: Callable[[Tensor], Tensor]
    parts: Tensor | None = None


def _joint_pos(view: GoalView) -> Tensor:
    joint_pos = view.target["joint_pos"]
    return joint_pos if view.parts is None else joint_pos * view.parts[..., : joint_pos.shape[-1]]


def _root_pos_b(view: GoalView) -> Tensor:
    if view.parts is None:
        return view.keypoint_pos_b[..., 0, :]
    # height and horizontal position are apart in the world, not in a tilted root frame
    to_root = view.target["keypoint_pos"][..., 0, :] - view.root_pos_w
    horizontal, height = view.parts[..., -3:-2], view.parts[..., -2:-1]
    return view.turned((to_root * torch.cat((horizontal, horizontal, height), -1))[..., None, :])[..., 0, :]


def _root_rot6d_b(view: GoalView) -> Tensor:
    sixd = matrix_to_sixd(quat_to_matrix(view.target["keypoint_quat"][..., 0, :]))
    turned = view.turned(sixd.unflatten(-1, (2, 3))).flatten(-2)
    return turned if view.parts is None else turned * view.parts[..., -1:]


def _keypoint_pos_b(view: GoalView) -> Tensor:
    if view.parts is None:
        return view.keypoint_pos_b.flatten(-2)
    bodies = view.parts[..., view.target["joint_pos"].shape[-1] : -3]
    return (view.keypoint_pos_b * bodies[..., None]).flatten(-2)


GOAL_ENTRIES: dict[str, Callable[[GoalView], Tensor]] = {
    "joint_pos": _joint_pos,
    "root_pos_b": _root_pos_b,
    "root_rot6d_b": _root_rot6d_b,
    "keypoint_pos_b": _keypoint_pos_b,
}
"""How each entry of a goal is computed, by name, in the unit and frame that :mod:`plat.spec.observation` says.

Values that a partial keyframe does not command are 0.
"""


def robot_centric_goal(
    target: TensorDictBase, root_pos_w: Tensor, root_quat_w: Tensor, parts: Tensor | None = None
) -> dict[str, Tensor]:
    """Express target poses in the frame of the robot's root.

    The result is invariant to moving and turning target and robot together.

    Args:
        target: poses ``[*B]`` or ``[*B, L]`` as :meth:`plat.motions.MotionLibrary.poses` gives them.
        root_pos_w: position of the robot's root ``[*B, 3]`` (m, world).
        root_quat_w: its orientation ``[*B, 4]``, root to world.
        parts: mask ``[*B, J + K + 3]`` of what the targets ``[*B]`` command; None for whole poses.

    Returns:
        ``joint_pos`` ``[..., J]``: target angles (rad); ``root_pos_b`` ``[..., 3]``: from the robot's root to the
        target's (m, root frame); ``root_rot6d_b`` ``[..., 6]``: orientation of the target's root in the robot's;
        ``keypoint_pos_b`` ``[..., 3 K]``: from the robot's root to the target's keypoints (m, root frame).

    Source: the paper's observation ``g``; the 6D rotation is that of arXiv 1812.07035.

    >>> import torch
    >>> from plat.motions import MotionLibrary, generate_motions
    >>> library = MotionLibrary.from_clips(generate_motions("train", seconds=8))
    >>> now, soon = library.poses(torch.tensor([0])), library.poses(torch.tensor([25]))
    >>> goal = robot_centric_goal(soon, now["keypoint_pos"][:, 0], now["keypoint_quat"][:, 0])
    >>> {key: tuple(value.shape) for key, value in goal.items()}
    {'joint_pos': (1, 29), 'root_pos_b': (1, 3), 'root_rot6d_b': (1, 6), 'keypoint_pos_b': (1, 42)}
    """
    batch = root_pos_w.ndim - 1
    root_to_world = quat_to_matrix(root_quat_w)

    def turned(rows: Tensor) -> Tensor:
        # a row vector times the matrix is the inverse rotation: from the world into the root frame; the rows of all
        # frames of a sequence in one product
        return rows_times_matrices(rows.flatten(batch, -2), root_to_world).view(rows.shape)

    # as one row for all keypoints: PyTorch is slow where the last dimension is a 3
    points = target["keypoint_pos"].flatten(-2)
    root_pos = root_pos_w.repeat(*[1] * batch, points.shape[-1] // 3)
    root_pos = root_pos.view(*root_pos.shape[:-1], *[1] * (target.ndim - batch), points.shape[-1])
    keypoint_pos_b = turned((points - root_pos).unflatten(-1, (-1, 3)))
    return observed("goal", GOAL_ENTRIES, GoalView(target, root_pos_w, keypoint_pos_b, turned, parts))


def parts_entries(parts: Tensor, robot: Robot) -> dict[str, Tensor]:
    """Return the entries of the group ``"parts"`` of masks ``[*B, J + K + 3]``.

    >>> from plat.robots import G1
    >>> sorted(parts_entries(torch.ones(2, 46), G1))
    ['bodies', 'joints', 'root']
    """
    joints, bodies, root = parts.split((robot.num_joints, len(robot.keypoints), 3), -1)
    return as_observed("parts", {"joints": joints, "bodies": bodies, "root": root})


def clock_entries(steps_left: Tensor, timing: Timing) -> dict[str, Tensor]:
    """Return the entries of the group ``"clock"``, each ``[*B, 1]``.

    Args:
        steps_left: control steps to the keyframe ``[*B, 1]``, at least 1.
        timing: of the policy.

    >>> {name: value.tolist() for name, value in clock_entries(torch.tensor([[3], [5]]), Timing()).items()}
    {'soon': [[0.30000001192092896], [0.5]], 'in_window': [[1.0], [0.0]]}
    """
    soon = (steps_left * (timing.control_dt / SOON)).clamp_max(1.0)
    return as_observed("clock", {"soon": soon, "in_window": (steps_left <= timing.window).float()})


def strided_offsets(steps: Tensor, stride: int) -> tuple[Tensor, Tensor]:
    """Return the frames ``0, stride, 2 stride .. steps`` of each sequence; the last one is always included.

    Args:
        steps: ``Delta`` ``[B]``.

    Returns:
        Offsets ``[B, L]``, padded with ``Delta``, and the number of frames of each sequence ``[B]``.

    >>> offsets, length = strided_offsets(torch.tensor([7, 1]), stride=3)
    >>> offsets.tolist(), length.tolist()
    ([[0, 3, 6, 7], [0, 1, 1, 1]], [4, 2])
    """
    check_value("goals: stride", stride, Count)
    length = torch.div(steps + stride - 1, stride, rounding_mode="floor") + 1
    longest = int(length.max()) if len(length) else 0
    offset = stride * torch.arange(longest, device=steps.device)
    return offset.expand(len(steps), -1).minimum(steps[:, None]), length
