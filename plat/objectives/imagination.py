"""Imagination loss: a policy's cost over rollouts in a learned dynamics model."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from tensordict import NestedKey, TensorDict, TensorDictBase
from tensordict.nn import TensorDictModuleBase, dispatch
from torch import Tensor, nn
from torch.compiler import is_dynamo_compiling
from torchrl.envs.utils import ExplorationType
from torchrl.objectives.common import LossModule

from plat.bounds import Count, Fraction, NonNegative, as_names, check_value
from plat.entries import Shape, check_entries
from plat.envs.state import GeneralizedState
from plat.errors import ConfigError, ObservationError, TaskError
from plat.modules.dynamics import DynamicsModel
from plat.objectives.divergence import gaussian_kl
from plat.precision import autocast
from plat.spec.timing import timing_of
from plat.tasks.disturbed import advanced, estimated, motor_target, renewed, shown
from plat.tasks.task import Task, of_each

__all__ = ["ImaginationLoss", "LatentImaginationLoss", "starts_of"]


class ImaginationLoss(LossModule):
    r"""Discounted cost of a task along imagined rollouts, by backpropagation through the learned dynamics model.

    .. math::
        L = \frac{1}{\sum_k \gamma^k} \left[ \sum_{k=0}^{H-1} \gamma^k \left( m_k \, c(s_{k+1})
            + \lambda_a \|a_k\|^2 + \lambda_r [k > 0] \|a_k - a_{k-1}\|^2 \right) + \gamma^H m_H V(s_H) \right]

    The gradient flows through observation, policy, joint targets, model and cost, and reaches the policy alone. The
    mask :math:`m_k` leaves out lost robots and steps after an episode's end. Norms are means over joints. The first
    imagined step pays for no rate: the action before it was an exploring robot's.

    The critic V speaks for what follows the imagined steps, such as a fall that begins in them. It learns the cost
    :math:`c` to go, in which a lost robot costs ``lost_cost`` a step for good.

    Args:
        policy: writes ``action`` deterministically from what the task shows.
        model: the learned robot.
        task: observation, clock and cost.

    Keyword Args:
        steps: imagined control steps H.
        discount: :math:`\gamma`.
        effort_weight: :math:`\lambda_a`.
        rate_weight: :math:`\lambda_r`.
        critic: reads the observation and writes ``cost_to_go`` ``[B, 1]``, the mean cost of a step from now on:
            :math:`(1 - \gamma) V`. None for no such term.
        lost_cost: of a step of a lost robot, for the critic. More than the others cost, or losing them would pay.

    The keys ``state`` and ``memory`` say where rollouts start. ``effort`` is the entry of the policy that is kept
    small: ``action``, or what the network adds to a reference (``residual`` of an expert).

    Returns ``loss_policy``, with a critic ``loss_critic``, and for the log ``imagined_cost`` (mean of a step's
    :math:`c`) and ``imagined_alive`` (fraction of the steps that counted).

    Source: SuperTrack (Fussell et al. 2021), section 5.

    >>> from plat.modules import DynamicsModel, Expert, ExpertConfig
    >>> from plat.motions import MotionLibrary, generate_motions
    >>> from plat.tasks import DenseTracking
    >>> library = MotionLibrary.from_clips(generate_motions("train", seconds=8))
    >>> task, expert = DenseTracking(library), Expert(library.robot, ExpertConfig(hidden=(32,)))
    >>> loss = ImaginationLoss(expert.deployed(), DynamicsModel(library.robot), task, steps=3)
    >>> state, memory = task.start(4)
    >>> losses = loss(TensorDict({"robot_state": state.pack(), "memory": memory}, [4]))
    >>> sorted(losses.keys())
    ['imagined_alive', 'imagined_cost', 'loss_policy']
    """

    @dataclass
    class _AcceptedKeys:
        state: NestedKey = "robot_state"
        memory: NestedKey = "memory"
        action: NestedKey = "action"
        effort: NestedKey = "action"
        cost_to_go: NestedKey = "cost_to_go"

    tensor_keys: _AcceptedKeys
    default_keys = _AcceptedKeys
    static: ClassVar[bool] = True
    """Whether it runs the same kernels whatever the states are, as :class:`plat.objectives.GraphedLoss` needs."""

    def __init__(
        self,
        policy: TensorDictModuleBase,
        model: DynamicsModel,
        task: Task,
        *,
        steps: int = 24,
        discount: float = 0.98,
        effort_weight: float = 0.01,
        rate_weight: float = 0.02,
        critic: TensorDictModuleBase | None = None,
        lost_cost: float = 3.0,
    ):
        super().__init__()
        check_value("imagination loss: task", task, Task)
        check_value("imagination loss: steps", steps, Count)
        check_value("imagination loss: discount", discount, Fraction)
        weights = {"effort_weight": effort_weight, "rate_weight": rate_weight, "lost_cost": lost_cost}
        for name, value in weights.items():
            check_value(f"imagination loss: {name}", value, NonNegative)
        timing = timing_of(policy)
        known = {"model": model.dt, **({} if timing is None else {"policy": timing.control_dt})}
        for name, dt in known.items():
            if abs(dt - task.dt) > 1e-9:
                raise ConfigError(
                    f"imagination loss: {name} at {dt:g} s a control step, expected the task's {task.dt:g} s"
                )
        wanted = timing_of(task)
        if timing is not None and wanted is not None and timing != wanted:
            raise ConfigError(f"imagination loss: {timing} of the policy, expected the task's {wanted}")
        if critic is not None and not discount < 1:
            raise ConfigError(f"imagination loss: discount is {discount:g}, expected less than 1 with a critic")
        self.lost_cost = lost_cost
        self.policy = policy
        self.model = model
        self.task = task
        self.critic = critic
        self.steps = steps
        self.discount = discount
        self.effort_weight = effort_weight
        self.rate_weight = rate_weight
        critic_keys: list[NestedKey] = [] if critic is None else ["loss_critic"]
        self.out_keys = ["loss_policy", *critic_keys, "imagined_cost", "imagined_alive"]

    @property
    def in_keys(self) -> list[NestedKey]:
        """Return the keys of packed states and the task's memory."""
        return [self.tensor_keys.state, self.tensor_keys.memory]

    def _forward_value_estimator_keys(self, **_: object) -> None:
        pass

    @dispatch
    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Compute the losses of rollouts from the states ``[B]``.

        Raises:
            TaskError: when a method of the task returns what it should not, or the cost has no gradient.
            ObservationError: for an entry that is missing or of another shape, of the states or of the policy.
        """
        keys, task = self.tensor_keys, self.task
        joints = task.robot.num_joints
        state, memory = starts_of(tensordict, keys.state, keys.memory, joints, "imagination loss")
        if len(batch := tensordict.get(keys.state).shape[:-1]) != 1:
            raise ObservationError(f"imagination loss: states {tuple(batch)}, expected [B], as of reshape(-1)")
        device = state.root_pos_w.device
        to_go = penalty = torch.zeros(tensordict.shape, device=device)
        lost = ended = torch.zeros_like(to_go, dtype=torch.bool)
        regularization = divergence = cost_sum = alive_sum = to_go.new_zeros(())
        effort_before: Tensor | None = None
        first = observed = self._observe(state, memory)
        weight, weights = 1.0, 0.0
        for _ in range(self.steps):
            acted = self.policy(observed.copy())
            check_entries(acted, {keys.effort: ("n",), keys.action: (joints,)}, "imagination loss: policy")
            action, effort = acted.get(keys.action), acted.get(keys.effort)
            effort = effort.to(torch.promote_types(effort.dtype, torch.float32))
            with _HeldOut(self.model):
                target = motor_target(task.robot, memory, action)
                state = self.model(state, target, memory.get("physics", None))
            with autocast(device, "float32"):  # what a task computes is to be what it computes in simulation
                memory = advanced(task, memory, action, state)
                here = estimated(state, memory)
                cost = of_each(task, "cost", task.cost(here, memory), memory)
                with torch.no_grad():
                    lost = lost | (~ended & of_each(task, "lost", task.lost(here, memory), memory))
                    alive = (~(lost | ended)).to(cost)
                    penalty = penalty + weight * self.lost_cost * lost
                    cost_sum, alive_sum = cost_sum + (alive * cost).sum(), alive_sum + alive.sum()
                to_go = to_go + weight * alive * cost
                regularization = regularization + weight * self._moderation(effort, effort_before)
                divergence = divergence + weight * self._divergence(acted)
                weights += weight
                weight *= self.discount
                effort_before = effort
                with torch.no_grad():
                    ended = ended | (~lost & of_each(task, "finished", task.finished(memory), memory))
                memory = renewed(task, memory, here)
                observed = self._observe(state, memory)
        # without a word the policy would learn to do nothing; a critic has a gradient of its own
        if self.critic is None and state.root_pos_w.requires_grad and not to_go.requires_grad:
            raise TaskError(
                f"{type(task).__name__}.cost() has no gradient, expected a differentiable cost of the state"
            )
        out = {}
        if self.critic is not None:
            left = weight / (1 - self.discount)
            with _HeldOut(self.critic):
                to_go = to_go + left * ~(lost | ended) * self._mean_cost(observed)
            known = (to_go + penalty + left * self.lost_cost * lost).detach()
            error = self._mean_cost(first) - (1 - self.discount) * known
            # what would follow an episode's end is not known
            out["loss_critic"] = torch.where(ended, 0.0, error).square().mean()
        out["loss_policy"] = (to_go.mean() + regularization) / weights
        self._add_divergence(out, divergence / weights)
        out["imagined_cost"] = cost_sum / alive_sum.clamp_min(1.0)
        out["imagined_alive"] = alive_sum / (self.steps * ended.numel())
        return TensorDict(out)

    def _observe(self, state: GeneralizedState, memory: TensorDictBase) -> TensorDictBase:
        # half precision is for networks: positions of a few meters would be off by millimeters
        with autocast(state.root_pos_w.device, "float32"):
            return shown(self.task, state, memory)

    def _moderation(self, effort: Tensor, before: Tensor | None) -> Tensor:
        total = self.effort_weight * effort.square().mean()
        return total if before is None else total + self.rate_weight * (effort - before).square().mean()

    def _divergence(self, acted: TensorDictBase) -> Tensor:
        """Divergence of the posterior from the prior; 0 for a policy that has none."""
        return acted.get(self.tensor_keys.action).new_zeros(())

    def _add_divergence(self, out: dict[str, Tensor], divergence: Tensor) -> None:
        """Add the loss of a mean divergence to the losses."""

    def _mean_cost(self, observed: TensorDictBase) -> Tensor:
        assert self.critic is not None
        key, estimate = self.tensor_keys.cost_to_go, self.critic(observed.copy())
        check_entries(estimate, {key: (1,)}, "imagination loss: critic")
        return estimate.get(key)[:, 0]


class LatentImaginationLoss(ImaginationLoss):
    r"""Imagination loss through a privileged posterior that teaches a deployable prior.

    .. math::
        L = L_{imagination} + \beta \, KL(q \| p)

    A part of the imagined robots act through the posterior, which sees the motion to come, the others through the
    prior. Both learn from the cost of what follows. The divergence draws the prior to the posterior, and keeps the
    posterior where the prior can follow.

    Args:
        policy: writes ``action`` and both distributions, as :meth:`plat.modules.LatentPolicy.imagined` does.
        model: the learned robot.
        task: observation, clock, cost, and the privileged goal sequence (:meth:`plat.tasks.Task.privileged`).

    Keyword Args:
        beta: :math:`\beta`.
        divergence, parameters: as of :class:`LatentImitationLoss`, for another latent.
        settings: as of :class:`ImaginationLoss`.

    Returns ``loss_kl`` and, for the log, ``kl`` (nats a step) beside what :class:`ImaginationLoss` returns.

    Source: ControlVAE (Yao et al. 2022), with the posterior of PLAT's stage 2.

    >>> from plat.modules import DynamicsModel, LatentPolicy
    >>> from plat.motions import MotionLibrary, generate_motions
    >>> from plat.tasks import TimedKeyframes, TimedKeyframesConfig
    >>> library = MotionLibrary.from_clips(generate_motions("train", seconds=8))
    >>> task, policy = TimedKeyframes(library, TimedKeyframesConfig(chains=6)), LatentPolicy(library.robot)
    >>> loss = LatentImaginationLoss(policy.imagined(), DynamicsModel(library.robot), task, steps=2, beta=0.01)
    >>> state, memory = task.start(4)
    >>> losses = loss(TensorDict({"robot_state": state.pack(), "memory": memory}, [4]))
    >>> bool(losses["loss_kl"] == 0.01 * losses["kl"])
    True
    """

    static = False  # goal sequences are as long as the longest in the batch
    # TorchRL's losses make policies deterministic by default; this loss needs samples.
    deterministic_sampling_mode = ExplorationType.RANDOM

    def __init__(
        self,
        policy: TensorDictModuleBase,
        model: DynamicsModel,
        task: Task,
        *,
        beta: float = 0.002,
        divergence: Callable[..., Tensor] = gaussian_kl,
        parameters: Sequence[str] = ("loc", "scale"),
        **settings: Any,
    ):
        super().__init__(policy, model, task, **settings)
        check_value("latent imagination loss: beta", beta, NonNegative)
        self.beta = beta
        self.divergence = divergence
        self.parameter_names = as_names(parameters)
        self.out_keys = [*self.out_keys, "loss_kl", "kl"]

    def _observe(self, state: GeneralizedState, memory: TensorDictBase) -> TensorDictBase:
        observed = super()._observe(state, memory)
        with autocast(state.root_pos_w.device, "float32"):
            observed["privileged_goal"] = self.task.privileged(estimated(state, memory), memory)
        return observed

    def _divergence(self, acted: TensorDictBase) -> Tensor:
        names: list[NestedKey] = [(group, name) for group in ("posterior", "prior") for name in self.parameter_names]
        check_entries(acted, dict.fromkeys(names, ("n",)), "imagination loss: policy")
        kl = self.divergence(*(acted.get(name).float() for name in names))
        batch = acted.get(self.tensor_keys.action).shape[:-1]
        if kl.ndim != len(batch) + 1 or kl.shape[:-1] != batch:
            raise ObservationError(
                f"imagination loss: divergence has shape {tuple(kl.shape)}, expected [{batch.numel()}, m]"
            )
        return kl.sum(-1).mean()

    def _add_divergence(self, out: dict[str, Tensor], divergence: Tensor) -> None:
        out["loss_kl"], out["kl"] = self.beta * divergence, divergence.detach()


def starts_of(
    tensordict: TensorDictBase, state: NestedKey, memory: NestedKey, joints: int, what: str
) -> tuple[GeneralizedState, TensorDictBase]:
    """Return the states and memories ``[*B]`` from which robots start.

    Args:
        tensordict: holds them.
        state: key of the packed states.
        memory: key of the memories.
        joints: of the robot.
        what: begins the message.

    Raises:
        ObservationError: for an entry that is missing or of another shape.
    """
    entries: dict[NestedKey, Shape] = {state: (13 + 2 * joints,), (memory, "last_action"): (joints,)}
    check_entries(tensordict, entries, what)
    return GeneralizedState.unpack(tensordict.get(state)), tensordict.get(memory)


class _HeldOut:
    """Context in which no gradient reaches the parameters of a network; those that were frozen remain so after it."""

    def __init__(self, network: nn.Module):
        self._network = network

    def __enter__(self) -> None:
        if is_dynamo_compiling():  # which cannot switch parameters off: detached ones take their places
            self._parameters = TensorDict.from_module(self._network)
            self._parameters.data.to_module(self._network, preserve_module_state=False)
            return
        self._learning = [parameter for parameter in self._network.parameters() if parameter.requires_grad]
        for parameter in self._learning:
            parameter.requires_grad_(False)

    def __exit__(self, *_: object) -> None:
        if is_dynamo_compiling():
            self._parameters.to_module(self._network, preserve_module_state=False)
            return
        for parameter in self._learning:
            parameter.requires_grad_(True)
