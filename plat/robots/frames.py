"""Frames of a robot's bodies in that of its root, with a gradient of few operations."""

from collections.abc import Sequence
from typing import Any

import mujoco
import torch
from torch import Tensor

from plat.gpu import constant, on_gpu
from plat.precision import autocast
from plat.rotations import quat_to_matrix

__all__ = ["BodyFrames"]


class BodyFrames:
    """Rotations and positions of bodies in the root's frame, as a function of the joint angles.

    The gradient is not traced through the products along the chains. A joint turns all that is beyond it about its
    axis, so the moments about that axis of what pulls at those bodies are added up: the transpose of the geometric
    Jacobian, a dozen operations for the whole robot. It can be differentiated again.

    Args:
        model: of the robot, whose first joint is free and whose others are hinges at their bodies' origins.
        bodies: MuJoCo's ids. All at the same number of bodies from the root come after each other, the nearest first.
        parents: row of each body's parent: 0 is the root, then come the bodies in their order.
        joints: joint that turns each body, -1 for none.

    Source: the geometric Jacobian, as in Siciliano et al., "Robotics: Modelling, Planning and Control", 2009, 3.1.

    >>> from plat.robots import G1
    >>> hips = BodyFrames(G1.shared_model, bodies=[2, 8, 3, 9], parents=[0, 0, 1, 2], joints=[0, 6, 1, 7])
    >>> turned, origin = hips(torch.zeros(7, G1.num_joints))
    >>> turned.shape, origin.shape
    (torch.Size([7, 5, 3, 3]), torch.Size([7, 5, 3]))
    """

    def __init__(
        self, model: mujoco.MjModel, bodies: Sequence[int], parents: Sequence[int], joints: Sequence[int]
    ) -> None:
        rows, turned_by = [0, *parents], [-1, *joints]
        self._joint_or_any = torch.tensor(turned_by).clamp_min(0)
        self._turning = _turning(model, bodies, joints)
        self._levels = _levels(rows)
        self._above = _ancestors(rows)
        num_joints = model.njnt - 1
        self.row = torch.zeros(num_joints, dtype=torch.int64)
        """Row of the body that each joint turns; 0 for joints that turn none of these bodies."""
        self.beyond = torch.zeros(num_joints, len(rows))
        """Mask ``[J, L]`` of the bodies that a joint moves."""
        for row, joint in enumerate(turned_by):
            if joint >= 0:
                self.row[joint] = row
            upper = row
            while upper:
                if turned_by[upper] >= 0:
                    self.beyond[turned_by[upper], row] = 1.0
                upper = rows[upper]
        self.axis = torch.from_numpy(model.jnt_axis[1:].T.copy()).float()[:, :, None]
        """Axes of the joints in the frames of their bodies ``[3, J, 1]``."""

    def __call__(self, joint_pos: Tensor) -> tuple[Tensor, Tensor]:
        """Compute rotations ``[*B, L, 3, 3]`` and positions ``[*B, L, 3]`` (m) in the root's frame, the root first.

        Args:
            joint_pos: angles ``[*B, J]`` (rad).
        """
        batch = joint_pos.shape[:-1]
        turned, origin = _Chained.apply(joint_pos.reshape(-1, joint_pos.shape[-1]).T, self)
        rows = origin.shape[1]
        return turned.permute(3, 2, 0, 1).reshape(*batch, rows, 3, 3), origin.permute(2, 1, 0).reshape(*batch, rows, 3)

    def chained(self, joint_pos: Tensor) -> Tensor:
        """Compute the frames ``[3, 4, L, N]`` at angles ``[J, N]``; the batch comes last, where PyTorch is fast."""
        fixed, sine, versine = (constant(values, joint_pos) for values in self._turning)
        angle = joint_pos.index_select(0, constant(self._joint_or_any, joint_pos.device))
        local = fixed + angle.sin() * sine + (1 - angle.cos()) * versine
        if on_gpu(joint_pos):
            # each with its parent's, then with that of the body two above, and so on: few operations on all bodies
            for above in self._above:
                local = _composed(local.index_select(2, constant(above, joint_pos.device)), local)
            return local
        frames = [local[:, :, :1]]
        for rows, parents in self._levels:
            frames.append(_composed(frames[-1].index_select(2, parents), local[:, :, rows]))
        return torch.cat(frames, 2)


class _Chained(torch.autograd.Function):
    """Rotations ``[3, 3, L, N]`` and positions ``[3, L, N]`` at angles ``[J, N]``."""

    generate_vmap_rule = True

    @staticmethod
    def forward(joint_pos: Tensor, frames: BodyFrames) -> tuple[Tensor, Tensor]:
        chained = frames.chained(joint_pos)
        return chained[:, :3].clone(), chained[:, 3].clone()

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Tensor, BodyFrames], output: tuple[Tensor, Tensor]) -> None:
        ctx.frames = inputs[1]
        ctx.save_for_backward(*output)
        ctx.set_materialize_grads(False)

    @staticmethod
    def backward(ctx: Any, turning: Tensor | None, pull: Tensor | None) -> tuple[Tensor | None, None]:
        """Return the gradients by rotations ``[3, 3, L, N]`` and positions ``[3, L, N]``."""
        frames: BodyFrames = ctx.frames
        if turning is None and pull is None:
            return None, None
        turned, origin = ctx.saved_tensors
        row = constant(frames.row, origin.device)
        axis = (turned.index_select(2, row) * constant(frames.axis, origin)).sum(1)
        moment = torch.zeros_like(origin)  # of all that pulls at a body, about the root
        if turning is not None:
            moment = torch.linalg.cross(turned, turning, dim=0).sum(1)
        if pull is not None:
            moment = moment + torch.linalg.cross(origin, pull, dim=0)
            moment, pull = _beyond(frames, torch.stack((moment, pull))).unbind()
            about_joint = moment - torch.linalg.cross(origin.index_select(1, row), pull, dim=0)
        else:
            about_joint = _beyond(frames, moment)
        return (axis * about_joint).sum(0), None


def _beyond(frames: BodyFrames, values: Tensor) -> Tensor:
    """Sums ``[*B, J, N]`` of values ``[*B, L, N]`` over the bodies that each joint moves."""
    with autocast(values.device, "float32"):
        return constant(frames.beyond, values) @ values


def _composed(upper: Tensor, lower: Tensor) -> Tensor:
    """Frames ``[3, 4, n, N]`` that are given in upper ones."""
    out = torch.nn.functional.pad(upper[:, 3:], (0, 0, 0, 0, 3, 0))
    for column in range(3):
        out = torch.addcmul(out, upper[:, column, None], lower[column])
    return out


def _turning(model: mujoco.MjModel, bodies: Sequence[int], joints: Sequence[int]) -> tuple[Tensor, Tensor, Tensor]:
    """Matrices ``[3, 4, L, 1]``: a body in its parent's frame at angle 0, and what sine and ``1 - cos`` of it add.

    The first is the root's, the identity.
    """
    out = torch.zeros(3, 1 + len(bodies), 3, 4)
    out[0, 0, :, :3] = torch.eye(3)
    for row, (body, joint) in enumerate(zip(bodies, joints, strict=True), start=1):
        turned = quat_to_matrix(torch.from_numpy(model.body_quat[body]))
        out[0, row, :, :3], out[0, row, :, 3] = turned, torch.from_numpy(model.body_pos[body])
        if joint >= 0:
            x, y, z = model.jnt_axis[joint + 1]
            cross = torch.tensor([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            out[1, row, :, :3], out[2, row, :, :3] = turned @ cross, turned @ cross @ cross
    fixed, sine, versine = out.permute(0, 2, 3, 1)[..., None].contiguous()
    return fixed, sine, versine


def _levels(parents: Sequence[int]) -> list[tuple[slice, Tensor]]:
    """Rows at each number of bodies from the root but 0, and their parents among those one nearer."""
    depth = [0]
    for parent in parents[1:]:
        depth.append(depth[parent] + 1)
    begins = [depth.index(level) for level in range(depth[-1] + 1)] + [len(depth)]
    return [
        (slice(begin, end), torch.tensor(parents[begin:end]) - before)
        for before, begin, end in zip(begins, begins[1:], begins[2:], strict=False)
    ]


def _ancestors(parents: Sequence[int]) -> list[Tensor]:
    """Rows of the bodies 1, 2, 4 .. above each, until all are the root."""
    above = torch.tensor(parents)
    found = []
    while above.any():
        found.append(above)
        above = above[above]
    return [*found, above]
