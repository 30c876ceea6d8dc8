"""Adapter of SONIC: observation, action and motors. Not yet run with the released weights."""

from pathlib import Path

import torch
from tensordict import TensorDictBase
from torch import Tensor

from plat.baselines.onnx import OnnxPolicy
from plat.baselines.tracker import Tracker, tuned_robot
from plat.robots import G1, Robot
from plat.rotations import quat_conjugate, quat_multiply, quat_to_matrix, quat_yaw

__all__ = ["Sonic", "Sonic11", "sonic_robot"]

_FRAMES = 10  # of the reference, 0.1 s apart, and of the history, a control step apart
_TOKEN = 64


def sonic_robot(robot: Robot = G1) -> Robot:
    """Return the robot with the motor settings that SONIC was trained for: hip pitch has the motor of hip roll."""
    settings = torch.stack((robot.stiffness, robot.damping, robot.effort_limit))
    for side in ("left", "right"):
        pitch, roll = (robot.joint_names.index(f"{side}_hip_{axis}") for axis in ("pitch", "roll"))
        settings[:, pitch] = settings[:, roll]
    return tuned_robot(robot, f"{robot.name}-sonic", *settings)


class Sonic(Tracker):
    """Released SONIC policy: an encoder from ten reference frames to a token, and a decoder to an action.

    **Unverified**: the layout is that of the published deployment code. The adapter is tested only with networks of the
    same shapes, not with the released weights. Compare dense tracking before you quote its metrics.

    The encoder (``model_encoder.onnx``, 1762 to 64) reads a mode (0: a robot's motion, four numbers) and ten reference
    frames, from now to 0.9 s ahead at steps of 0.1 s. Of these it reads joint angles (rad), joint velocities (rad/s)
    and the root's orientation in the robot's root (first two columns of the matrix, row by row). Entries of other
    modes are 0.

    The decoder (``model_decoder.onnx``, 994 to 29) reads the token and the last ten control steps, oldest first,
    quantity by quantity. These are angular velocity, joint angles from the default pose, joint velocities, last raw
    actions and gravity direction. In the first steps the first measurement fills the history. Joints are in order of
    their depth in the kinematic tree.

    Args:
        folder: holds the two files.
        robot: the robot, as :func:`sonic_robot` makes it.

    Source: Luo et al., "SONIC: Supersizing Motion Tracking for Natural Humanoid Whole-Body Control", arXiv 2511.07820;
    ``observation_config.yaml`` of its release and the deployment code beside it, NVlabs/GR00T-WholeBodyControl.
    """

    ahead = tuple(range(0, 5 * _FRAMES, 5))
    # Entries of the encoder's observation for other inputs than a robot's motion (VR trackers, human bodies). For a
    # robot's motion they are 0. They lie between joint velocities and orientations, and after those.
    _unused = 10 + 1 + 6, 240 + 9 + 12 + 720 + 60 + 60

    def __init__(self, folder: str | Path, robot: Robot | None = None):
        super().__init__(robot or sonic_robot())
        self.in_keys = [*self.in_keys, ("state", "root_quat_w")]
        joints = self.robot.num_joints
        encoder_size = 4 + _FRAMES * (2 * joints + 6) + sum(self._unused)
        decoder_size = _TOKEN + _FRAMES * (6 + 3 * joints)
        self._encoder = OnnxPolicy(Path(folder) / "model_encoder.onnx", encoder_size, _TOKEN)
        self._decoder = OnnxPolicy(Path(folder) / "model_decoder.onnx", decoder_size, joints)
        self._order = _by_depth(self.robot)
        self._back = self._order.argsort()

    def targets(self, tensordict: TensorDictBase, joint_pos: Tensor, starting: Tensor) -> Tensor:
        measured, order = tensordict["robot"], self._order.to(joint_pos.device)
        last = self.remembered("action", joint_pos, starting)
        quantities = {
            "root_ang_vel_b": measured["root_ang_vel_b"],
            "joint_pos": measured["joint_pos"][:, order],
            "joint_vel": measured["joint_vel"][:, order],
            "last_action": last,
            "gravity_b": measured["gravity_b"],
        }
        past = [self._with_past(name, now, starting).flatten(1) for name, now in quantities.items()]
        token = self._encoder(self._reference(tensordict["tracker_reference"], tensordict["state", "root_quat_w"]))
        action = self._decoder(torch.cat((token, *past), -1))
        self.remember("action", action)
        scale = self.robot.action_scale.to(action)
        return self.robot.default_joint_pos.to(action) + scale * action[:, self._back.to(action.device)]

    def _reference(self, reference: TensorDictBase, root_quat_w: Tensor) -> Tensor:
        order, (between, after) = self._order.to(root_quat_w.device), self._unused
        root_quat_w = self._seen_from(root_quat_w)
        turn = quat_multiply(quat_conjugate(root_quat_w)[:, None], reference["root_quat_w"])
        parts = (
            root_quat_w.new_zeros(len(root_quat_w), 4),
            reference["joint_pos"][..., order].flatten(1),
            reference["joint_vel"][..., order].flatten(1),
            root_quat_w.new_zeros(len(root_quat_w), between),
            quat_to_matrix(turn)[..., :2].flatten(1),
            root_quat_w.new_zeros(len(root_quat_w), after),
        )
        return torch.cat(parts, -1)

    def _seen_from(self, root_quat_w: Tensor) -> Tensor:
        """Return the frame that the reference's orientation is expressed in: the robot's root."""
        return root_quat_w

    def _with_past(self, name: str, now: Tensor, starting: Tensor) -> Tensor:
        """Return the last ten values ``[N, 10, n]`` of a quantity ``[N, n]``, oldest first, with the one of now."""
        repeated = now[:, None].expand(-1, _FRAMES, -1)
        past = torch.cat((self.remembered(f"past {name}", repeated, starting)[:, 1:], now[:, None]), 1)
        past = torch.where(starting[:, None, None], repeated, past)
        self.remember(f"past {name}", past)
        return past


class Sonic11(Sonic):
    """Released SONIC 1.1 policy. It reads the reference's orientation in the heading frame of the robot's root.

    **Unverified**, as :class:`Sonic`: tested with networks of the same shapes only (encoder 1751 to 64).
    """

    _unused = 0, 6 + 240 + 9 + 12 + 720 + 60 + 60

    def _seen_from(self, root_quat_w: Tensor) -> Tensor:
        return quat_yaw(root_quat_w)


def _by_depth(robot: Robot) -> Tensor:
    """Return joints ``[J]`` in the order of their depth in the kinematic tree."""
    return torch.tensor([robot.depth(joint) for joint in robot.joint_names]).argsort(stable=True)
