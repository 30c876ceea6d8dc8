"""Adapter of TWIST2: observation, action and motors."""

from pathlib import Path

import torch
from tensordict import TensorDictBase
from torch import Tensor

from plat.baselines.onnx import OnnxPolicy
from plat.baselines.tracker import Tracker, tuned_robot
from plat.robots import G1, Robot
from plat.rotations import quat_conjugate, quat_multiply, quat_rotate_inverse, quat_to_matrix, quat_yaw

__all__ = ["Twist2", "twist2_robot"]

_HISTORY = 10


def _per_joint(leg: list[float], waist: list[float], arm: list[float]) -> Tensor:
    return torch.tensor([*leg, *leg, *waist, *arm, *arm])


def twist2_robot(robot: Robot = G1) -> Robot:
    """Return the robot with the motor settings that TWIST2 was trained for."""
    leg = [100.0, 100.0, 100.0, 150.0, 40.0, 40.0]
    stiffness = _per_joint(leg, [150.0] * 3, [40.0] * 4 + [4.0] * 3)
    damping = _per_joint([2.0, 2.0, 2.0, 4.0, 2.0, 2.0], [4.0] * 3, [5.0] * 4 + [0.2] * 3)
    return tuned_robot(robot, f"{robot.name}-twist2", stiffness, damping, stiffness)  # torque limits equal kp in value


class Twist2(Tracker):
    """Released TWIST2 policy (``twist2_1017_20k.onnx``).

    Its observation holds a command, the robot's measurements, the last ten such pairs (oldest first, zeros before the
    start), and the command again. The command is the reference's horizontal velocity in its heading frame, height,
    roll, pitch, yaw rate and joint angles.

    Args:
        path: the ``.onnx`` file.
        robot: the robot, as :func:`twist2_robot` makes it.

    Source: Ze et al., "TWIST2: Scalable, Portable, and Holistic Humanoid Data Collection System", arXiv 2511.02832.
    """

    def __init__(self, path: str | Path, robot: Robot | None = None):
        super().__init__(robot or twist2_robot())
        joints = self.robot.num_joints
        self._width = 6 + joints + 5 + 3 * joints
        self._network = OnnxPolicy(path, (_HISTORY + 1) * self._width + 6 + joints, joints)
        self._rest = _per_joint([-0.2, 0, 0, 0.4, -0.2, 0], [0.0] * 3, [0, 0.4, 0, 1.2, 0, 0, 0])
        names = self.robot.joint_names
        self._rest[names.index("right_shoulder_roll")] *= -1
        self._ankles = [index for index, name in enumerate(names) if "ankle" in name]

    def targets(self, tensordict: TensorDictBase, joint_pos: Tensor, starting: Tensor) -> Tensor:
        measured = tensordict["robot"]
        last = self.remembered("action", joint_pos, starting)
        command = self._command(tensordict["tracker_reference"])
        joint_vel = measured["joint_vel"].clone()
        joint_vel[:, self._ankles] = 0.0
        down_x, down_y, down_z = measured["gravity_b"].unbind(-1)
        roll_pitch = torch.stack((torch.atan2(-down_y, -down_z), down_x.clamp(-1, 1).asin()), -1)
        rest = self._rest.to(joint_pos)
        current = torch.cat(
            (command, 0.25 * measured["root_ang_vel_b"], roll_pitch, joint_pos - rest, 0.05 * joint_vel, last), -1
        )
        history = self.remembered("history", current.new_zeros(len(current), _HISTORY, self._width), starting)
        action = self._network(torch.cat((current, history.flatten(1), command), -1))
        self.remember("history", torch.cat((history[:, 1:], current[:, None]), 1))
        self.remember("action", action)
        return rest + 0.5 * action.clamp(-10, 10)

    def _command(self, reference: TensorDictBase) -> Tensor:
        quat = reference["root_quat_w"]
        heading = quat_yaw(quat)
        matrix = quat_to_matrix(quat_multiply(quat_conjugate(heading), quat))  # without heading: pitch, then roll
        roll, pitch = torch.atan2(matrix[:, 2, 1], matrix[:, 2, 2]), -matrix[:, 2, 0].clamp(-1, 1).asin()
        return torch.cat(
            (
                quat_rotate_inverse(heading, reference["root_lin_vel_w"])[:, :2],
                reference["root_pos_w"][:, 2:],
                torch.stack((roll, pitch), -1),
                quat_rotate_inverse(quat, reference["root_ang_vel_w"])[:, 2:],
                reference["joint_pos"],
            ),
            -1,
        )
