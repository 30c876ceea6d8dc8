"""Privileged critic observations."""

import torch
from tensordict import NestedKey, TensorDictBase
from torch import Tensor

from plat.envs.transforms.base import ObservationTransform
from plat.motions.library import MotionLibrary
from plat.rotations import quat_to_matrix, rows_times_matrices
from plat.spec.observation import as_observed, entry_shapes

__all__ = ["PrivilegedState"]


class PrivilegedState(ObservationTransform):
    """Transform that adds the group ``"privileged"`` for an asymmetric (privileged) critic, free of noise.

    ``keypoint_pos_b`` ``[3 K]`` (m) and ``keypoint_lin_vel_b`` ``[3 K]`` (m/s): the robot's keypoints relative to its
    root, in the root frame; ``root_height`` ``[1]`` (m); ``root_velocity_error_b`` ``[6]``: the next reference frame's
    linear and angular root velocity minus the robot's, in the root frame; ``joint_vel_error`` ``[J]`` (rad/s): the
    same for the joints. The critic does not see the end of the clip. Truncation there bootstraps
    with the value of a state that is never trained on; a critic that recognizes such states diverges on them.
    """

    def __init__(self, library: MotionLibrary):
        state = ("root_pos_w", "root_quat_w", "joint_vel", "keypoint_pos_w", "keypoint_lin_vel_w", "keypoint_ang_vel_w")
        super().__init__(
            in_keys=[("motion", "frame"), *(("state", key) for key in state)],
            out_shapes={("privileged", key): shape for key, shape in entry_shapes("privileged", library.robot).items()},
        )
        self._library = library

    def compute(self, tensordict: TensorDictBase) -> dict[NestedKey, Tensor]:
        state, frame = tensordict["state"], tensordict["motion", "frame"]
        reference = self._library.states((frame + 1).minimum(self._library.last_of(frame)))
        root_to_world = quat_to_matrix(state["root_quat_w"])
        lin_vel, ang_vel = state["keypoint_lin_vel_w"], state["keypoint_ang_vel_w"]
        vectors_w = (
            state["keypoint_pos_w"] - state["root_pos_w"][:, None],
            lin_vel,
            reference["keypoint_lin_vel"][:, :1] - lin_vel[:, :1],
            reference["keypoint_ang_vel"][:, :1] - ang_vel[:, :1],
        )
        vectors_b = rows_times_matrices(torch.cat(vectors_w, 1), root_to_world).flatten(1)
        points = lin_vel.shape[1] * 3
        keypoint_pos_b, keypoint_lin_vel_b, root_velocity_error_b = vectors_b.split((points, points, 6), -1)
        quantities = {
            "keypoint_pos_b": keypoint_pos_b,
            "keypoint_lin_vel_b": keypoint_lin_vel_b,
            "root_height": state["root_pos_w"][:, 2:],
            "root_velocity_error_b": root_velocity_error_b,
            "joint_vel_error": reference["joint_vel"] - state["joint_vel"],
        }
        return {("privileged", name): value for name, value in as_observed("privileged", quantities).items()}
