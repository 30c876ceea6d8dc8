"""Left-right symmetry of a policy: its action and that in the mirror, averaged."""

from collections.abc import Sequence

import numpy as np
import torch
from tensordict import NestedKey
from tensordict.nn import TensorDictModule
from torch import Tensor, nn

from plat.entries import Shape, expects
from plat.errors import ConfigError, RobotError
from plat.gpu import constant
from plat.robots.robot import Robot
from plat.robots.symmetry import MIRRORED_AXIS, joint_symmetry, keypoint_symmetry
from plat.spec.observation import Entry, observation_widths, table

__all__ = ["BothSides", "MeanOfSides", "mirrored_columns"]

_VECTOR = np.array([1.0, -1.0, 1.0])
_SIDES = -2
"""Dimension of the two sides. It stands behind those of the batch, which a TensorDict checks."""


class BothSides(TensorDictModule):
    """Observation beside its mirror image, for a network that answers both; :class:`MeanOfSides` is the other end.

    A robot that is symmetric moves in the mirror as it moves before it. So the policy is shown both, and acts by the
    mean of its answer and of the other one mirrored back. Then it is exactly as symmetric, and errors of the two sides
    are averaged.

    Args:
        robot: the robot.
        keys: entries of the observation.
        shown: where they are, if a module before this one moved some; None for where they are called.
        out_key: both, side by side ``[*B, 2, F]``, the mirror image second.

    Raises:
        ConfigError: for an entry of which the table does not say what becomes of it in the mirror.
        RobotError: for a robot that is not symmetric.

    Source: the network of a symmetric policy in Abdolhosseini et al. 2019, "On learning symmetric locomotion".

    >>> from tensordict import TensorDict
    >>> from plat.robots import G1
    >>> both = BothSides(G1, [("robot", "root_lin_vel_b")])
    >>> both(TensorDict({"robot": {"root_lin_vel_b": torch.tensor([[1.0, 2.0, 3.0]])}}, [1]))["both_sides"].tolist()
    [[[1.0, 2.0, 3.0], [1.0, -2.0, 3.0]]]
    """

    def __init__(
        self,
        robot: Robot,
        keys: Sequence[NestedKey],
        shown: Sequence[NestedKey] | None = None,
        out_key: NestedKey = "both_sides",
    ):
        in_keys = list(keys if shown is None else shown)
        super().__init__(_Beside(*mirrored_columns(keys, robot)), in_keys=in_keys, out_keys=[out_key])
        shapes: list[Shape] = [(width,) for width in observation_widths(keys, robot)]
        expects(self, dict(zip(in_keys, shapes, strict=True)), "symmetry", double=True)


class MeanOfSides(TensorDictModule):
    """Mean of an action and of the mirror image's, which is mirrored back.

    Args:
        robot: the robot.
        in_key: actions of both ``[*B, 2, J]``, as :class:`BothSides` has them.
        out_key: their mean ``[*B, J]``.

    Raises:
        RobotError: for a robot that is not symmetric, or whose default pose or action scales are not.

    >>> from tensordict import TensorDict
    >>> from plat.robots import G1
    >>> hip = torch.zeros(1, 2, 29)
    >>> hip[:, :, G1.joint_names.index("left_hip_pitch")] = 1.0
    >>> action = MeanOfSides(G1)(TensorDict({"action_of_sides": hip}, [1]))["action"][0]
    >>> action[G1.joint_names.index("left_hip_pitch")], action[G1.joint_names.index("right_hip_pitch")]
    (tensor(0.5000), tensor(0.5000))
    """

    def __init__(self, robot: Robot, in_key: NestedKey = "action_of_sides", out_key: NestedKey = "action"):
        partner, sign = joint_symmetry(robot)
        for what, values, signs in (
            ("default pose", robot.default_joint_pos, sign),
            ("action scale", robot.action_scale, np.ones_like(sign)),
        ):
            if not np.allclose(values.numpy()[partner] * signs, values.numpy(), atol=1e-4):
                raise RobotError(f"robot {robot.name!r}: its {what} is not symmetric about the plane y = 0")
        super().__init__(_Mean(torch.from_numpy(partner), torch.from_numpy(sign)), in_keys=[in_key], out_keys=[out_key])
        expects(self, {in_key: (2, robot.num_joints)}, "symmetry", double=True)


def mirrored_columns(keys: Sequence[NestedKey], robot: Robot) -> tuple[Tensor, Tensor]:
    """Return, for each column ``[F]`` of entries side by side, the column that it takes in the mirror, and the sign.

    Args:
        keys: entries of the observation.
        robot: the robot.

    Raises:
        ConfigError: for an entry of which the table does not say what becomes of it in the mirror.
        RobotError: for a robot that is not symmetric.

    >>> from plat.robots import G1
    >>> column, sign = mirrored_columns([("command", "horizon"), ("robot", "root_ang_vel_b")], G1)
    >>> column.tolist(), sign.tolist()
    ([0, 1, 2, 3], [1.0, -1.0, 1.0, -1.0])
    """
    columns, signs = [], []
    start = 0
    for key, width in zip(keys, observation_widths(keys, robot), strict=True):
        column, sign = _mirrored(table().entry(*key), width, robot)
        columns.append(start + column)
        signs.append(sign)
        start += width
    return torch.from_numpy(np.concatenate(columns)), torch.from_numpy(np.concatenate(signs)).float()


def _mirrored(entry: Entry, width: int, robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Return columns and signs ``[width]`` of one entry."""
    column, sign = np.arange(width), np.ones(width)
    match entry.mirrored:
        case "joints":
            return joint_symmetry(robot)
        case "sides" if entry.per_joint:
            column, _ = joint_symmetry(robot)
        case "sides":
            column = keypoint_symmetry(robot)
        case "vector" if entry.per_body:
            column = (3 * keypoint_symmetry(robot)[:, None] + np.arange(3)).ravel()
            sign = np.tile(_VECTOR, width // 3)
        case "vector":
            sign = _VECTOR
        case "axis":
            sign = MIRRORED_AXIS
        case "rotation":
            # M R M with M = diag(1, -1, 1): its second column changes sign as well
            sign = np.concatenate((_VECTOR, -_VECTOR))
        case None:
            raise ConfigError(f"symmetry: the table does not say how entry {entry.name!r} is mirrored (Entry.mirrored)")
    return column, sign


class _Mirror(nn.Module):
    """Columns that change places, and signs; they follow from the robot and are not saved."""

    column: Tensor
    sign: Tensor

    def __init__(self, column: Tensor, sign: Tensor):
        super().__init__()
        self.register_buffer("column", column, persistent=False)
        self.register_buffer("sign", sign.float(), persistent=False)

    def image(self, values: Tensor) -> Tensor:
        """Return the mirror image of values ``[*B, n]``."""
        # views of a policy are made anew on each call, where its weights may have been moved before
        column, sign = constant(self.column, values.device), constant(self.sign, values.device)
        return values[..., column] * sign


class _Beside(_Mirror):
    def forward(self, *entries: Tensor) -> Tensor:
        observation = torch.cat(entries, -1)
        return torch.stack((observation, self.image(observation)), _SIDES)


class _Mean(_Mirror):
    def forward(self, actions: Tensor) -> Tensor:
        own, mirrored = actions.unbind(_SIDES)
        return 0.5 * (own + self.image(mirrored))
