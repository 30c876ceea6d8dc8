"""Privileged goal sequences, gathered when a batch is sampled."""

import torch
from tensordict import TensorDictBase
from torchrl.data import Composite
from torchrl.envs import Transform

from plat.bounds import Count, check_value
from plat.envs.goals import robot_centric_goal, strided_offsets
from plat.errors import TaskError
from plat.motions.library import MotionLibrary

__all__ = ["PrivilegedGoals", "strided_offsets"]


class PrivilegedGoals(Transform):
    """Transform that adds the privileged goal sequence ``G = {g_t .. g_{t+Delta}}``.

    Every frame is in the robot's **current** root frame.

    A rollout or buffer holds only the indices of the sequence: ``("motion", "frame")`` ``[*B]``, ``("command",
    "steps_left")`` ``[*B, 1]``, ``("estimate", "root_pos_w")`` and ``("estimate", "root_quat_w")``. Used as the
    transform of a replay buffer, this fills in ``("privileged_goal", "frames")`` ``[*B, L, F]``, padded with the last
    frame, and ``("privileged_goal", "length")`` ``[*B]``. The last frame of each sequence is the commanded keyframe
    itself.

    Args:
        library: motions, on the device of the batches.
        stride: keep every ``stride``-th frame, and the last.

    Raises:
        ConfigError: for a stride below 1.
        TaskError: in an environment: sequences are as long as the longest of a batch.
    """

    def __init__(self, library: MotionLibrary, stride: int = 1):
        super().__init__()
        check_value("privileged goals: stride", stride, Count)
        self._library = library
        self._stride = stride

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Fill in the sequences of a batch ``[*B]``."""
        frame = tensordict["motion", "frame"]
        offset, length = strided_offsets(tensordict["command", "steps_left"].flatten(), self._stride)
        target = self._library.poses(frame.flatten()[:, None] + offset)
        root_pos, root_quat = (tensordict["estimate", name] for name in ("root_pos_w", "root_quat_w"))
        goal = robot_centric_goal(target, root_pos.reshape(-1, 3), root_quat.reshape(-1, 4))
        frames = torch.cat(list(goal.values()), -1)
        tensordict["privileged_goal", "frames"] = frames.view(*frame.shape, *frames.shape[1:])
        tensordict["privileged_goal", "length"] = length.view(frame.shape)
        return tensordict

    def transform_observation_spec(self, observation_spec: Composite) -> Composite:
        """Refuse to be a transform of an environment, where it would write nothing.

        Raises:
            TaskError: always.
        """
        raise TaskError("PrivilegedGoals is a transform of an environment, expected one of a replay buffer")
