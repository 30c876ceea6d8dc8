"""Reference states and commanded poses in one table, looked up by row."""

import torch
from tensordict import TensorDict
from torch import Tensor, nn

from plat.envs.state import GeneralizedState
from plat.motions.library import MotionLibrary
from plat.robots.kinematics import ForwardKinematics
from plat.robots.robot import Robot

__all__ = ["PoseTable"]


class PoseTable(nn.Module):
    """Rows of states with their keypoints. The rows of a motion library are its frames.

    Args:
        states: packed states ``[R, 13 + 2 J]``.
        keypoint_pos: ``[R, 3 K]`` (m, world).

    >>> from plat.motions import generate_motions
    >>> table = PoseTable.of_library(MotionLibrary.from_clips(generate_motions("train", seconds=8)))
    >>> table.state(torch.tensor([0, 3])).joint_pos.shape
    torch.Size([2, 29])
    """

    states: Tensor
    keypoint_pos: Tensor

    def __init__(self, states: Tensor, keypoint_pos: Tensor):
        super().__init__()
        self.register_buffer("states", states, persistent=False)
        self.register_buffer("keypoint_pos", keypoint_pos, persistent=False)

    @classmethod
    def of_library(cls, library: MotionLibrary) -> "PoseTable":
        """The frames of a library."""
        return cls(GeneralizedState.from_motion(library.frames).pack(), library.frames["keypoint_pos"].flatten(1))

    @classmethod
    def of_poses(cls, qpos: Tensor, robot: Robot) -> "PoseTable":
        """Poses ``[R, 7 + J]``, at rest."""
        root_pos, root_quat, joint_pos = qpos.split((3, 4, robot.num_joints), -1)
        keypoint_pos, _ = ForwardKinematics(robot)(root_pos, root_quat, joint_pos)
        still = qpos.new_zeros(len(qpos), 6 + robot.num_joints)
        return cls(torch.cat((qpos, still), -1), keypoint_pos.flatten(1))

    def then(self, other: "PoseTable") -> "PoseTable":
        """The rows of this table and then those of another."""
        device = self.states.device
        return PoseTable(
            torch.cat((self.states, other.states.to(device))),
            torch.cat((self.keypoint_pos, other.keypoint_pos.to(device))),
        )

    def __len__(self) -> int:
        return len(self.states)

    def state(self, row: Tensor) -> GeneralizedState:
        """States of rows ``[*B]``."""
        rows = self.states.index_select(0, row.flatten())
        return GeneralizedState.unpack(rows.view(*row.shape, -1))

    def pose(self, row: Tensor) -> TensorDict:
        """What :func:`plat.envs.robot_centric_goal` takes, of rows ``[*B]``; of orientations only the root's."""
        state = self.state(row)
        points = self.keypoint_pos.index_select(0, row.flatten()).view(*row.shape, -1, 3)
        entries = {
            "joint_pos": state.joint_pos,
            "keypoint_pos": points,
            "keypoint_quat": state.root_quat_w[..., None, :],
        }
        return TensorDict(entries, row.shape, device=row.device)
