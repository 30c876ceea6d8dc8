"""Reference states and commanded poses in one table, looked up by row."""

from collections.abc import Callable

import torch
from tensordict import TensorDict
from torch import Tensor, nn

from plat.envs.state import GeneralizedState
from plat.motions.library import MotionLibrary
from plat.robots.kinematics import ForwardKinematics
from plat.robots.robot import Robot

__all__ = ["PoseTable"]


# Libraries of more frames than this (a day at 50 Hz) are looked up where they are. A copy of states and keypoints is
# faster, and takes half a kilobyte a frame.
_COPIED = 1 << 22


class PoseTable(nn.Module):
    """Rows of states with their keypoints. The rows of a motion library are its frames.

    Args:
        states: packed states ``[R, 13 + 2 J]``.
        keypoint_pos: ``[R, 3 K]`` (m, world).
        library: whose frames come before these rows.

    >>> from plat.motions import generate_motions
    >>> table = PoseTable.of_library(MotionLibrary.from_clips(generate_motions("train", seconds=8)))
    >>> table.state(torch.tensor([0, 3])).joint_pos.shape
    torch.Size([2, 29])
    """

    states: Tensor
    keypoint_pos: Tensor

    def __init__(self, states: Tensor, keypoint_pos: Tensor, library: MotionLibrary | None = None):
        super().__init__()
        self.register_buffer("states", states, persistent=False)
        self.register_buffer("keypoint_pos", keypoint_pos, persistent=False)
        self._library = library

    @classmethod
    def of_library(cls, library: MotionLibrary) -> "PoseTable":
        """Return the frames of a library. A large one is not copied, and stays on its device."""
        large = len(library) > _COPIED
        frames = library.frames[:0] if large else library.frames
        states, points = GeneralizedState.from_motion(frames).pack(), frames["keypoint_pos"].flatten(1)
        return cls(states, points, library if large else None)

    @classmethod
    def of_poses(cls, qpos: Tensor, robot: Robot) -> "PoseTable":
        """Return poses ``[R, 7 + J]``, at rest."""
        root_pos, root_quat, joint_pos = qpos.split((3, 4, robot.num_joints), -1)
        keypoint_pos, _ = ForwardKinematics(robot)(root_pos, root_quat, joint_pos)
        still = qpos.new_zeros(len(qpos), 6 + robot.num_joints)
        return cls(torch.cat((qpos, still), -1), keypoint_pos.flatten(1))

    def then(self, other: "PoseTable") -> "PoseTable":
        """Return the rows of this table and then those of another, which is of no large library."""
        device = self.states.device
        return PoseTable(
            torch.cat((self.states, other.states.to(device))),
            torch.cat((self.keypoint_pos, other.keypoint_pos.to(device))),
            self._library,
        )

    def __len__(self) -> int:
        return len(self.states) + (0 if self._library is None else len(self._library))

    def state(self, row: Tensor) -> GeneralizedState:
        """Return states of rows ``[*B]``."""
        rows = self._rows(self.states, row.flatten(), _packed)
        return GeneralizedState.unpack(rows.view(*row.shape, rows.shape[-1]))

    def points(self, row: Tensor) -> Tensor:
        """Return the positions of the keypoints ``[*B, K, 3]`` (m, world) of rows ``[*B]``."""
        points = self._rows(self.keypoint_pos, row.flatten(), _keypoints)
        return points.view(*row.shape, points.shape[1:].numel() // 3, 3)

    def pose(self, row: Tensor) -> TensorDict:
        """Return what :func:`plat.envs.robot_centric_goal` takes, of rows ``[*B]``; of orientations only the root's."""
        state = self.state(row)
        entries = {
            "joint_pos": state.joint_pos,
            "keypoint_pos": self.points(row),
            "keypoint_quat": state.root_quat_w[..., None, :],
        }
        return TensorDict(entries, row.shape, device=row.device)

    def _rows(self, own: Tensor, row: Tensor, of: Callable[[MotionLibrary, Tensor], Tensor]) -> Tensor:
        """Rows ``[n]``: of the library, and behind its frames of the tensor ``own``."""
        if self._library is None:
            return own.index_select(0, row)
        frames = len(self._library)
        found = of(self._library, row.clamp_max(frames - 1))
        if len(own) == 0:
            return found
        behind = own.index_select(0, (row - frames).clamp_min(0))
        return torch.where((row < frames)[:, None], found, behind)


def _packed(library: MotionLibrary, frame: Tensor) -> Tensor:
    return GeneralizedState.from_motion(library.states(frame)).pack()


def _keypoints(library: MotionLibrary, frame: Tensor) -> Tensor:
    return library.poses(frame)["keypoint_pos"].flatten(1)
