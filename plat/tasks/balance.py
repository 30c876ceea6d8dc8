"""How far out of balance a standing robot is."""

import numpy as np
import torch
from torch import Tensor, nn

from plat.envs.state import GeneralizedState
from plat.gpu import constant
from plat.robots.center_of_mass import link_names
from plat.robots.kinematics import ForwardKinematics
from plat.robots.robot import Robot
from plat.rotations import quat_rotate

__all__ = ["Balance"]

_GRAVITY = 9.81  # m/s^2
# What the point may be off the line between the soles (m): about half of a sole's width.
_MARGIN = 0.04


class Balance(nn.Module):
    """Distance of the extrapolated center of mass from where the feet can hold it.

    The extrapolated center of mass is where a robot without an ankle's torque would have to step to come to rest:
    the center of mass, moved by its velocity over ``sqrt(g / h)`` (Hof et al. 2005, "The condition for dynamic
    stability"). The feet hold it within 4 cm of the line between the centers of their soles. The joints' part in the
    velocity is left out.

    Args:
        robot: the robot.

    >>> from plat.robots import G1
    >>> qpos = torch.as_tensor(G1.default_qpos, dtype=torch.float32)[None]
    >>> state = GeneralizedState.unpack(torch.cat((qpos, torch.zeros(1, 6 + G1.num_joints)), -1))
    >>> float(Balance(G1)(state))
    0.0
    >>> round(float(Balance(G1)(state._replace(root_lin_vel_w=torch.tensor([[0.0, 0.5, 0.0]])))), 2)
    0.0
    >>> round(float(Balance(G1)(state._replace(root_lin_vel_w=torch.tensor([[0.5, 0.0, 0.0]])))), 2)
    0.09
    """

    def __init__(self, robot: Robot):
        super().__init__()
        model = robot.model()
        links = link_names(model, robot)
        soles = model.geom_pos[robot.sole_geoms(model)].mean(1)
        self._kinematics = ForwardKinematics(robot, (*links, *robot.feet))
        # centers of mass of all links, and of the soles
        self._points = torch.from_numpy(np.concatenate((model.body_ipos[1:], soles))).float()
        self._mass = torch.from_numpy(model.body_mass[1:] / model.body_mass[1:].sum()).float()

    def forward(self, state: GeneralizedState) -> Tensor:
        """Compute the horizontal distance ``[N]`` (m); 0 in balance."""
        points = self._kinematics.positions(state.root_pos_w, state.root_quat_w, state.joint_pos, self._points)
        com = (constant(self._mass, points)[:, None] * points[:, :-2]).sum(-2)
        left, right = points[:, -2], points[:, -1]
        spin = quat_rotate(state.root_quat_w, state.root_ang_vel_b)
        velocity = state.root_lin_vel_w + torch.linalg.cross(spin, com - state.root_pos_w)
        height = (com[:, 2] - torch.minimum(left[:, 2], right[:, 2])).clamp_min(0.1)
        extrapolated = com[:, :2] + velocity[:, :2] * (height / _GRAVITY).sqrt()[:, None]
        line, way = right[:, :2] - left[:, :2], extrapolated - left[:, :2]
        share = ((line * way).sum(-1) / line.square().sum(-1).clamp_min(1e-4)).clamp(0, 1)
        off = way - share[:, None] * line
        return ((off.square().sum(-1) + 1e-6).sqrt() - _MARGIN).relu()
