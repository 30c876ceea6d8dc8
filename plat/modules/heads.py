"""Action heads: residual on a reference, and Gaussian exploration."""

import math
from collections.abc import Sequence

from tensordict import NestedKey
from tensordict.nn import (
    AddStateIndependentNormalScale,
    InteractionType,
    ProbabilisticTensorDictModule,
    TensorDictModule,
)
from torch import Tensor, nn
from torchrl.modules import IndependentNormal

from plat.bounds import Count, NonNegative, Positive, check_robot, check_value
from plat.entries import expects
from plat.gpu import constant
from plat.robots.robot import Robot
from plat.spec.observation import Entry, entries_of, quantities

__all__ = ["GaussianNoise", "ReferenceOffset", "gaussian_action"]


class ReferenceOffset(TensorDictModule):
    """Residual action on the goal's joint angles: the parametrization ``reference_residual``.

    The environment's actions are offsets from the default pose, ``q_target = q_default + scale * a``. With
    ``a = r + (q_goal - q_default) / scale`` that is ``q_target = q_goal + scale * r``: the network's output ``r`` is
    a residual on the reference. The shift does not depend on the network, so probabilities of ``a`` and of ``r``
    agree, and labels of the expert need no conversion.

    Given a later goal as well, it commands ``q_target = q_goal + kd/kp * (q_later - q_goal) / interval + scale * r``:
    the motor's damping, which pulls its velocity to zero, then pulls it to the reference's (``reference_velocity``).
    Two goals that are the same keyframe have no velocity.

    The residual is bounded. Out-of-distribution states during falls produce residuals in the hundreds. They saturate
    the motors anyway, but would dominate action-rate penalties, PPO's KL divergence and the imitation loss.

    Args:
        robot: gives default pose, action scale and gains.
        in_keys: residual ``[*B, J]``, goal joint angles ``[*B, J]`` (rad), and joint angles of the later goal.
        out_key: action ``[*B, J]``.
        interval: time from the goal to the later goal (s).
        limit: bound on the residual; on the G1 a motor at its goal gives its full torque at 4.

    >>> import torch
    >>> from plat.robots import G1
    >>> offset = ReferenceOffset(G1, ("residual", ("goal", "joint_pos")), "loc")
    >>> bool((offset(torch.zeros(29), G1.default_joint_pos) == 0).all())
    True
    """

    def __init__(
        self,
        robot: Robot,
        in_keys: Sequence[NestedKey],
        out_key: NestedKey,
        interval: float = 1.0,
        limit: float = 5.0,
    ):
        check_robot(robot)
        check_value("action on the reference: interval", interval, Positive)
        check_value("action on the reference: limit", limit, Positive)
        offset = _Offset(robot, interval, limit, entries_of(in_keys))
        super().__init__(offset, in_keys=list(in_keys), out_keys=[out_key])
        expects(self, dict.fromkeys(in_keys, (robot.num_joints,)), "action on the reference", double=True)


class _Offset(nn.Module):
    default_joint_pos: Tensor
    action_scale: Tensor
    lead: Tensor

    def __init__(self, robot: Robot, interval: float, limit: float, entries: Sequence[Entry]):
        super().__init__()
        self._entries = tuple(entries)
        self.limit = limit
        self.register_buffer("default_joint_pos", robot.default_joint_pos.clone())
        self.register_buffer("action_scale", robot.action_scale.clone())
        self.register_buffer("lead", robot.damping / robot.stiffness / interval)

    def forward(self, *observed: Tensor) -> Tensor:
        residual, target, *later = quantities(self._entries, observed)
        if later:
            target = target + constant(self.lead, residual) * (later[0] - target)
        offset = (target - constant(self.default_joint_pos, residual)) / constant(self.action_scale, residual)
        return residual.clamp(-self.limit, self.limit) + offset


class GaussianNoise(TensorDictModule):
    """Exploration noise with a learned standard deviation that does not depend on the state.

    Args:
        num_actions: size of the action.
        init_std: standard deviation at the start.
        min_std: lower bound.
        in_key: mean ``[*B, num_actions]``.
        out_keys: mean and standard deviation.
    """

    def __init__(
        self,
        num_actions: int,
        init_std: float,
        min_std: float = 0.02,
        in_key: NestedKey = "loc",
        out_keys: tuple[NestedKey, NestedKey] = ("loc", "scale"),
    ):
        check_value("exploration noise: num_actions", num_actions, Count)
        check_value("exploration noise: init_std", init_std, Positive)
        check_value("exploration noise: min_std", min_std, NonNegative)
        scale = AddStateIndependentNormalScale(num_actions, init_value=math.log(init_std), scale_lb=min_std)
        super().__init__(scale, in_keys=[in_key], out_keys=list(out_keys))
        expects(self, {in_key: (num_actions,)}, "exploration noise")


def gaussian_action(out_key: NestedKey = "action") -> ProbabilisticTensorDictModule:
    """Return the module that draws the action from ``loc`` and ``scale`` and writes it with its log-probability.

    Under ``ExplorationType.DETERMINISTIC`` it writes the mean.
    """
    return ProbabilisticTensorDictModule(
        in_keys=["loc", "scale"],
        out_keys=[out_key],
        distribution_class=IndependentNormal,
        default_interaction_type=InteractionType.RANDOM,
        return_log_prob=True,
    )
