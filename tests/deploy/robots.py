"""The G1 as plat.deploy sees it, and states and poses of it."""

import numpy as np
import torch

from plat.deploy import RobotDescription, RobotState
from plat.robots import G1, describe_robot
from plat.rotations import quat_from_rotvec, quat_rotate_inverse


class SomePose:
    """Root pose and joint angles out of a position vector ``[7 + J]``."""

    def __init__(self, qpos: np.ndarray):
        self.root_pos, self.root_quat, self.joint_pos = qpos[:3].copy(), qpos[3:7].copy(), qpos[7:].copy()


def describe_g1() -> RobotDescription:
    return describe_robot(G1, control_dt=0.02)


def random_qpos(count: int) -> np.ndarray:
    """Poses ``[count, 36]`` anywhere in the joints' range, in any orientation."""
    limits = G1.joint_range.double()
    joint_pos = limits[:, 0] + (limits[:, 1] - limits[:, 0]) * torch.rand(count, G1.num_joints, dtype=torch.float64)
    quat = quat_from_rotvec(3 * torch.randn(count, 3, dtype=torch.float64))
    return torch.cat((torch.randn(count, 3, dtype=torch.float64), quat, joint_pos), -1).numpy()


def state_at(qpos: np.ndarray, qvel: np.ndarray | None = None) -> RobotState:
    """A state in MuJoCo's position and velocity ``[6 + J]``; at rest without one."""
    qvel = np.zeros(len(qpos) - 1) if qvel is None else qvel
    lin_vel_b = quat_rotate_inverse(torch.from_numpy(qpos[3:7]), torch.from_numpy(qvel[:3])).numpy()
    return RobotState(qpos[7:], qvel[6:], qpos[:3], qpos[3:7], lin_vel_b, qvel[3:6])
