"""Adapter of wbc-mjlab's general one-frame tracker: observation and action."""

from pathlib import Path

import torch
from tensordict import TensorDictBase
from torch import Tensor

from plat.baselines.onnx import OnnxPolicy
from plat.baselines.tracker import Tracker
from plat.robots import G1, Robot, without_side
from plat.rotations import quat_rotate_inverse

__all__ = ["Wbc"]

# Default pose (rad) that the network's joint angles are relative to; joints that are not named are 0.
_REST = {"hip_pitch": -0.1, "knee": 0.3, "ankle_pitch": -0.2, "shoulder_pitch": 0.35, "elbow": 0.87}
_REST_OUTWARD = {"left_shoulder_roll": 0.18, "right_shoulder_roll": -0.18}
# Radians per unit of action, by motor.
_SCALE = {
    "hip_pitch": 0.5183025041722635,
    "hip_yaw": 0.5183025041722635,
    "waist_yaw": 0.5183025041722635,
    "hip_roll": 0.33047951147932364,
    "knee": 0.33047951147932364,
    "wrist_pitch": 0.12814149696675228,
    "wrist_yaw": 0.12814149696675228,
}
_SCALE_5020 = 0.5596246525662165


class Wbc(Tracker):
    """Released policy ``policy_066ab15.onnx`` of wbc-mjlab.

    Its observation is one reference frame and the robot's measurements, without a history. The frame has the torso's
    height, velocities and gravity direction in the root's frame, and joint angles. Its action is added to the
    reference's joint angles. The constants are those of the released ``config_066ab15.yaml``.

    Args:
        path: the ``.onnx`` file.
        robot: the robot; the policy was trained for the motor settings of plat's G1.
    """

    def __init__(self, path: str | Path, robot: Robot = G1):
        super().__init__(robot)
        names = self.robot.joint_names
        plain = [without_side(name) for name in names]
        self._rest = torch.tensor(
            [_REST_OUTWARD.get(name, _REST.get(joint, 0.0)) for name, joint in zip(names, plain, strict=True)]
        )
        self._scale = torch.tensor([_SCALE.get(joint, _SCALE_5020) for joint in plain])
        self._network = OnnxPolicy(path, 10 + 6 + 4 * self.robot.num_joints, self.robot.num_joints)

    def targets(self, tensordict: TensorDictBase, joint_pos: Tensor, starting: Tensor) -> Tensor:
        measured, reference = tensordict["robot"], tensordict["tracker_reference"]
        down = joint_pos.new_tensor([0.0, 0.0, -1.0])
        last = self.remembered("action", joint_pos, starting)
        quat = reference["root_quat_w"]
        observation = torch.cat(
            (
                reference["anchor_pos_w"][:, 2:],
                quat_rotate_inverse(quat, reference["root_lin_vel_w"]),
                quat_rotate_inverse(quat, reference["root_ang_vel_w"]),
                quat_rotate_inverse(quat, down),
                reference["joint_pos"],
                measured["root_ang_vel_b"],
                measured["gravity_b"],
                joint_pos - self._rest.to(joint_pos),
                measured["joint_vel"],
                last,
            ),
            -1,
        )
        action = self._network(observation)
        self.remember("action", action)
        return reference["joint_pos"] + self._scale.to(action) * action
