"""Forward kinematics in torch: batched, differentiable, on any device. Its numpy twin is ``plat.deploy.kinematics``."""

import mujoco
import torch
from torch import Tensor

from plat.bounds import check_robot
from plat.errors import RobotError, StateError
from plat.gpu import constant
from plat.robots.frames import BodyFrames
from plat.robots.robot import Robot
from plat.rotations import quat_multiply, quat_rotate

__all__ = ["ForwardKinematics"]


class ForwardKinematics:
    """Forward kinematics: world poses of a robot's bodies from its root pose and joint angles.

    Args:
        robot: the robot.
        bodies: names of the bodies to compute; by default the robot's keypoints.

    Raises:
        RobotError: for a body that there is not, and for a robot whose model cannot be used.

    >>> from plat.robots import G1
    >>> kinematics = ForwardKinematics(G1)
    >>> root_quat_w = torch.tensor([1.0, 0, 0, 0])
    >>> pos_w, quat_w = kinematics(torch.zeros(3), root_quat_w, G1.default_joint_pos)
    >>> pos_w.shape, quat_w.shape
    (torch.Size([14, 3]), torch.Size([14, 4]))
    """

    def __init__(self, robot: Robot, bodies: tuple[str, ...] | None = None):
        check_robot(robot)
        model = robot.shared_model
        names = robot.keypoints if bodies is None else bodies
        if unknown := [name for name in names if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) < 1]:
            raise RobotError(f"robot {robot.name!r} has no body {unknown[0]!r}")
        self._num_joints = robot.num_joints
        self._wanted = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) for name in names]
        needed: set[int] = set()
        for body in self._wanted:
            while body > 1 and body not in needed:
                needed.add(body)
                body = int(model.body_parentid[body])
        # MuJoCo numbers parents before children; body 1 is the root; joint 0 is the free joint
        self.chain = [
            (body, int(model.body_parentid[body]), max(int(model.body_jntadr[body]) - 1, -1)) for body in sorted(needed)
        ]
        """Bodies between the root and the wanted ones: MuJoCo's ids of body and parent, and the joint's index or -1."""
        levels, row_of = _levels(self.chain)
        self._rows = torch.tensor([row_of[body] for body in self._wanted])
        ids, parents, joints = ([entry[part] for level in levels for entry in level] for part in range(3))
        self._frames = BodyFrames(model, ids, parents, joints)
        # a body without a joint finds no turn behind the last joint
        self._joints = torch.tensor([joint if joint >= 0 else robot.num_joints for joint in joints])
        self._parents = [torch.tensor([parent for _, parent, _ in level]) for level in levels]
        self._body_pos = torch.from_numpy(model.body_pos[ids]).float()
        self._body_quat = torch.from_numpy(model.body_quat[ids]).float()
        self._axis = torch.from_numpy(model.jnt_axis[1:]).float()

    def positions(
        self, root_pos_w: Tensor, root_quat_w: Tensor, joint_pos: Tensor, offset: Tensor | None = None
    ) -> Tensor:
        """Compute the positions ``[*B, K, 3]`` (m, world) of points on the selected bodies.

        Args:
            root_pos_w, root_quat_w, joint_pos: as for a call.
            offset: of the points from the bodies' origins ``[K, 3]`` (m, body frames); None for the origins.
        """
        turned, origin = (
            values.index_select(joint_pos.ndim - 1, constant(self._rows, joint_pos.device))
            for values in self._frames(joint_pos)
        )
        if offset is not None:
            origin = origin + (turned * constant(offset, joint_pos)[..., None, :]).sum(-1)
        return root_pos_w[..., None, :] + quat_rotate(root_quat_w[..., None, :], origin)

    def __call__(self, root_pos_w: Tensor, root_quat_w: Tensor, joint_pos: Tensor) -> tuple[Tensor, Tensor]:
        """Compute the poses of the selected bodies.

        Args:
            root_pos_w: ``[*B, 3]`` (m, world).
            root_quat_w: ``[*B, 4]``, root to world.
            joint_pos: ``[*B, J]`` (rad).

        Returns:
            Positions ``[*B, K, 3]`` (m, world) and orientations ``[*B, K, 4]`` (body to world).

        Raises:
            StateError: naming what has another shape.
        """
        for name, value, size in (("root_pos_w", root_pos_w, 3), ("root_quat_w", root_quat_w, 4)):
            if value.shape[-1:] != (size,):
                raise StateError(f"kinematics: {name} has shape {tuple(value.shape)}, expected [*B, {size}]")
        if joint_pos.shape[-1:] != (self._num_joints,):
            raise StateError(
                f"kinematics: joint_pos has shape {tuple(joint_pos.shape)}, expected [*B, {self._num_joints}]"
            )
        constants = (self._body_pos, self._body_quat, self._axis)
        body_pos, body_quat, axis = (constant(values, root_pos_w) for values in constants)
        half = 0.5 * joint_pos[..., None]
        joint_quat = torch.cat((half.cos(), half.sin() * axis), -1)  # (*B, J, 4)
        no_turn = torch.nn.functional.pad(joint_quat.new_ones(*joint_quat.shape[:-2], 1, 1), (0, 3))
        turns = torch.cat((joint_quat, no_turn), -2).index_select(-2, constant(self._joints, joint_pos.device))
        local = quat_multiply(body_quat.expand(*joint_pos.shape[:-1], -1, -1), turns)
        pos_w, quat_w = root_pos_w[..., None, :], root_quat_w[..., None, :]
        begin = 0
        for level in self._parents:  # all bodies at the same number of joints from the root at once
            rows, parents = slice(begin, begin + len(level)), constant(level, joint_pos.device)
            parent_quat = quat_w.index_select(-2, parents)
            new_pos = pos_w.index_select(-2, parents) + quat_rotate(
                parent_quat, body_pos[rows].expand(*parent_quat.shape[:-1], 3)
            )
            new_quat = quat_multiply(parent_quat, local[..., rows, :])
            pos_w, quat_w = torch.cat((pos_w, new_pos), -2), torch.cat((quat_w, new_quat), -2)
            begin = rows.stop
        wanted = constant(self._rows, joint_pos.device)
        return pos_w.index_select(-2, wanted), quat_w.index_select(-2, wanted)


def _levels(chain: list[tuple[int, int, int]]) -> tuple[list[list[tuple[int, int, int]]], dict[int, int]]:
    """Return bodies by their distance from the root, each with the row of its parent and its joint, and their rows."""
    row_of, depth_of = {1: 0}, {1: 0}
    deepest: dict[int, list[tuple[int, int, int]]] = {}
    for body, parent, joint in chain:
        depth_of[body] = depth_of[parent] + 1
        deepest.setdefault(depth_of[body], []).append((body, parent, joint))
    levels = []
    for depth in sorted(deepest):
        levels.append([(body, row_of[parent], joint) for body, parent, joint in deepest[depth]])
        row_of.update({body: len(row_of) + number for number, (body, _, _) in enumerate(deepest[depth])})
    return levels, row_of
