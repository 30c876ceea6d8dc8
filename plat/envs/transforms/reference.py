"""Reference state at the current frame of each robot's motion."""

import torch
from tensordict import NestedKey, TensorDictBase
from torch import Tensor

from plat.envs.transforms.base import ObservationTransform
from plat.motions.library import MotionLibrary
from plat.rotations import quat_conjugate, quat_multiply, quat_yaw, yaw_multiply, yaw_rotate

__all__ = ["ReferenceMotion", "align_to_anchor"]


class ReferenceMotion(ObservationTransform):
    """Transform that adds the reference state at the current frame, for rewards, terminations and metrics.

    Reads ``("motion", "frame")`` and the robot's keypoints. Writes the group ``"reference"``: ``joint_pos``,
    ``joint_vel``, ``keypoint_pos_w``, ``keypoint_quat_w``, ``keypoint_lin_vel_w``, ``keypoint_ang_vel_w`` (world),
    and ``keypoint_pos_aligned_w``, ``keypoint_quat_aligned_w``: the reference after :func:`align_to_anchor`.

    Args:
        library: motions.
        at_resets: False leaves the group out after a reset, where only what judges a step reads it.
    """

    def __init__(self, library: MotionLibrary, at_resets: bool = True):
        keypoints, joints = len(library.robot.keypoints), library.robot.num_joints
        super().__init__(
            in_keys=[("motion", "frame"), ("state", "keypoint_pos_w"), ("state", "keypoint_quat_w")],
            out_shapes={
                ("reference", "joint_pos"): (joints,),
                ("reference", "joint_vel"): (joints,),
                ("reference", "keypoint_pos_w"): (keypoints, 3),
                ("reference", "keypoint_quat_w"): (keypoints, 4),
                ("reference", "keypoint_lin_vel_w"): (keypoints, 3),
                ("reference", "keypoint_ang_vel_w"): (keypoints, 3),
                ("reference", "keypoint_pos_aligned_w"): (keypoints, 3),
                ("reference", "keypoint_quat_aligned_w"): (keypoints, 4),
            },
        )
        self._library = library
        self._anchor = library.robot.anchor_index
        self._at_resets = at_resets

    def compute(self, tensordict: TensorDictBase) -> dict[NestedKey, Tensor]:
        reference = self._library.states(tensordict["motion", "frame"])
        aligned_pos, aligned_quat = align_to_anchor(
            reference["keypoint_pos"],
            reference["keypoint_quat"],
            tensordict["state", "keypoint_pos_w"][:, self._anchor],
            tensordict["state", "keypoint_quat_w"][:, self._anchor],
            self._anchor,
        )
        return {
            ("reference", "joint_pos"): reference["joint_pos"],
            ("reference", "joint_vel"): reference["joint_vel"],
            ("reference", "keypoint_pos_w"): reference["keypoint_pos"],
            ("reference", "keypoint_quat_w"): reference["keypoint_quat"],
            ("reference", "keypoint_lin_vel_w"): reference["keypoint_lin_vel"],
            ("reference", "keypoint_ang_vel_w"): reference["keypoint_ang_vel"],
            ("reference", "keypoint_pos_aligned_w"): aligned_pos,
            ("reference", "keypoint_quat_aligned_w"): aligned_quat,
        }

    def _reset(self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase) -> TensorDictBase:
        return super()._reset(tensordict, tensordict_reset) if self._at_resets else tensordict_reset


def align_to_anchor(
    keypoint_pos_w: Tensor, keypoint_quat_w: Tensor, anchor_pos_w: Tensor, anchor_quat_w: Tensor, anchor: int
) -> tuple[Tensor, Tensor]:
    """Move reference keypoints over the robot: to the horizontal position and heading of its anchor body.

    Heights are those of the reference.

    Args:
        keypoint_pos_w: reference positions ``[*B, K, 3]`` (m, world).
        keypoint_quat_w: reference orientations ``[*B, K, 4]``.
        anchor_pos_w: position of the robot's anchor body ``[*B, 3]``.
        anchor_quat_w: its orientation ``[*B, 4]``.
        anchor: index of the anchor among the keypoints.

    Source: the relative body pose of BeyondMimic, arXiv 2508.08241.
    """
    reference_pos = keypoint_pos_w[..., anchor, :]
    turn = quat_yaw(quat_multiply(anchor_quat_w, quat_conjugate(keypoint_quat_w[..., anchor, :])))[..., None, :]
    origin = torch.cat((anchor_pos_w[..., :2], reference_pos[..., 2:]), -1)
    pos = origin[..., None, :] + yaw_rotate(turn, keypoint_pos_w - reference_pos[..., None, :])
    return pos, yaw_multiply(turn, keypoint_quat_w)
