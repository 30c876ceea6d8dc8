"""Adapter of YAHMP: observation and action."""

from pathlib import Path

import torch
from tensordict import TensorDictBase
from torch import Tensor

from plat.baselines.onnx import OnnxPolicy
from plat.baselines.tracker import Tracker
from plat.robots import G1, Robot
from plat.rotations import quat_rotate_inverse, quat_to_matrix

__all__ = ["Yahmp"]

_HISTORY = 10
_DEVIATIONS = 5.0
# Of the network's own normalizer: the command is its first part.
_MEAN, _DEVIATION = "obs_normalizer._mean", "onnx::Div_89"


class Yahmp(Tracker):
    """Released policy ``g1_yahmp.onnx`` of YAHMP.

    Its observation is a block of the reference's next frame and the robot's measurements, and the ten blocks before it,
    oldest first. The frame has joint angles and velocities, the root's horizontal velocity and yaw rate in its own
    frame, its height, roll and pitch. After a reset the first block fills the history. The action is added to the
    reference's joint angles.

    Two aids help it with motions that it was not trained on. Its training had the wrists at 0, so their reference is
    hidden from the network, and the targets still follow it. The command is kept within five standard deviations of its
    training data, by the normalizer in the file.

    Args:
        path: the ``.onnx`` file.
        robot: the robot; the policy was trained for the motor settings of plat's G1.

    Raises:
        CheckpointError: when the file is another network, or has no such normalizer.
    """

    def __init__(self, path: str | Path, robot: Robot = G1):
        super().__init__(robot)
        joints = self.robot.num_joints
        self._command_width = 2 * joints + 6
        self._width = self._command_width + 6 + 3 * joints
        self._network = OnnxPolicy(path, (_HISTORY + 1) * self._width, joints)
        mean, deviation = (self._network.constant(name)[: self._command_width] for name in (_MEAN, _DEVIATION))
        self._lowest, self._highest = mean - _DEVIATIONS * deviation, mean + _DEVIATIONS * deviation
        self._wrists = [index for index, name in enumerate(self.robot.joint_names) if "wrist" in name]

    def targets(self, tensordict: TensorDictBase, joint_pos: Tensor, starting: Tensor) -> Tensor:
        measured, reference = tensordict["robot"], tensordict["tracker_reference"]
        last = self.remembered("action", joint_pos, starting)
        wanted_pos, wanted_vel = reference["joint_pos"].clone(), reference["joint_vel"].clone()
        offset, offset_vel = measured["joint_pos"].clone(), measured["joint_vel"].clone()
        # seen from a reference at 0, where the default pose has the wrists as well
        offset[:, self._wrists] -= wanted_pos[:, self._wrists]
        offset_vel[:, self._wrists] -= wanted_vel[:, self._wrists]
        wanted_pos[:, self._wrists] = wanted_vel[:, self._wrists] = 0.0
        block = torch.cat(
            (
                self._command(reference, wanted_pos, wanted_vel),
                measured["root_ang_vel_b"],
                measured["gravity_b"],
                offset,
                offset_vel,
                last,
            ),
            -1,
        )
        repeated = block[:, None].expand(-1, _HISTORY, -1)
        history = torch.where(starting[:, None, None], repeated, self.remembered("history", repeated, starting))
        action = self._network(torch.cat((block, history.flatten(1)), -1))
        self.remember("history", torch.cat((history[:, 1:], block[:, None]), 1))
        self.remember("action", action)
        return reference["joint_pos"] + self.robot.action_scale.to(action) * action

    def _command(self, reference: TensorDictBase, joint_pos: Tensor, joint_vel: Tensor) -> Tensor:
        quat = reference["root_quat_w"]
        matrix = quat_to_matrix(quat)
        roll, pitch = torch.atan2(matrix[:, 2, 1], matrix[:, 2, 2]), -matrix[:, 2, 0].clamp(-1, 1).asin()
        command = torch.cat(
            (
                joint_pos,
                joint_vel,
                quat_rotate_inverse(quat, reference["root_lin_vel_w"])[:, :2],
                quat_rotate_inverse(quat, reference["root_ang_vel_w"])[:, 2:],
                reference["root_pos_w"][:, 2:],
                torch.stack((roll, pitch), -1),
            ),
            -1,
        )
        return command.clamp(self._lowest.to(command), self._highest.to(command))
