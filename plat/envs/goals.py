"""Robot-centric goals: a target pose in the robot's root frame, the goal ``g`` of the paper."""

from collections.abc import Callable
from dataclasses import dataclass

from tensordict import TensorDictBase
from torch import Tensor

from plat.rotations import matrix_to_sixd, quat_to_matrix, rows_times_matrices
from plat.spec.observation import observed

__all__ = ["GOAL_ENTRIES", "GoalView", "robot_centric_goal"]


@dataclass(frozen=True)
class GoalView:
    """Inputs from which the entries of a goal are computed, for targets ``[*B]`` or ``[*B, L]``.

    Args:
        target: poses as :meth:`plat.motions.MotionLibrary.poses` gives them.
        root_pos_w: position of the robot's root ``[*B, 3]`` (m, world).
        keypoint_pos_b: from the robot's root to the target's keypoints ``[..., K, 3]`` (m, root frame), the root first.
        turned: function that rotates vectors ``[..., n, 3]`` from the world into the robot's root frame.
    """

    target: TensorDictBase
    root_pos_w: Tensor
    keypoint_pos_b: Tensor
    turned: Callable[[Tensor], Tensor]


def _root_rot6d_b(view: GoalView) -> Tensor:
    sixd = matrix_to_sixd(quat_to_matrix(view.target["keypoint_quat"][..., 0, :]))
    return view.turned(sixd.unflatten(-1, (2, 3))).flatten(-2)


GOAL_ENTRIES: dict[str, Callable[[GoalView], Tensor]] = {
    "joint_pos": lambda view: view.target["joint_pos"],
    "root_pos_b": lambda view: view.keypoint_pos_b[..., 0, :],
    "root_rot6d_b": _root_rot6d_b,
    "keypoint_pos_b": lambda view: view.keypoint_pos_b.flatten(-2),
}
"""How each entry of a goal is computed, by name, in the unit and frame that :mod:`plat.spec.observation` says."""


def robot_centric_goal(target: TensorDictBase, root_pos_w: Tensor, root_quat_w: Tensor) -> dict[str, Tensor]:
    """Express target poses in the frame of the robot's root.

    The result is invariant to moving and turning target and robot together.

    Args:
        target: poses ``[*B]`` or ``[*B, L]`` as :meth:`plat.motions.MotionLibrary.poses` gives them.
        root_pos_w: position of the robot's root ``[*B, 3]`` (m, world).
        root_quat_w: its orientation ``[*B, 4]``, root to world.

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
    root_pos = root_pos.view(*root_pos.shape[:-1], *[1] * (target.ndim - batch), -1)
    keypoint_pos_b = turned((points - root_pos).unflatten(-1, (-1, 3)))
    return observed("goal", GOAL_ENTRIES, GoalView(target, root_pos_w, keypoint_pos_b, turned))
