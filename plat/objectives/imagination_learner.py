"""Iteration of learning by imagination: updates of the dynamics model, then of the policy in it."""

import copy
from collections.abc import Callable
from contextlib import nullcontext
from functools import partial
from typing import Any, Protocol

import torch
from tensordict import NestedKey, TensorDictBase
from tensordict.nn import TensorDictModule, TensorDictModuleBase, TensorDictSequential
from torch import Tensor, nn
from torchrl.envs.utils import ExplorationType, exploration_type

from plat.bounds import Natural, NonNegative, check_value
from plat.envs.state import GeneralizedState
from plat.errors import ConfigError, StateError
from plat.modules.dynamics import DynamicsModel
from plat.modules.networks import mlp
from plat.modules.normalizer import ObservationNormalizer
from plat.objectives.exploitation import ExploitationWatch
from plat.objectives.finite import FiniteUpdates
from plat.objectives.graphed import GraphedLoss
from plat.objectives.helper import half_the_threads
from plat.objectives.imagination import ImaginationLoss
from plat.objectives.model_updates import ModelUpdates, ModelUpdatesBeside
from plat.objectives.muon import muon_and_adam
from plat.objectives.reference import ReferenceLoss
from plat.objectives.settings import ImaginationConfig
from plat.tasks.disturbed import shown, told_to_model
from plat.tasks.task import Task

__all__ = ["ImaginationConfig", "ImaginationLearner", "exploring"]


class Windows(Protocol):
    """Protocol of the replay buffer that the learner samples; :class:`plat.collectors.RolloutReplay` is one."""

    def __len__(self) -> int:
        """Return the number of control steps that are kept."""

    def windows(self, batch: int, length: int) -> TensorDictBase:
        """Sample successive steps of an episode ``[batch, length]``."""

    def states(self, batch: int, recent: int | None = None) -> TensorDictBase:
        """Sample single steps ``[batch]``."""


class ImaginationLearner:
    """Learner of model and policy: losses, optimizers and the moving average of the policy's weights.

    Args:
        policy: the policy that learns. Its ``normalizer``, if it has one, learns what observations are usual.
        actor: what imagined robots act by, on the same weights: its deterministic actor, or what ``loss`` asks for.
        model: the robot's model.
        task: observation, clock and cost.
        config: settings. None is that of a new model and policy; for trained ones hand over
            ``replace(config, **config.rates(model=True, policy=True)._asdict())``.
        effort: entry of the actor that is kept small.
        loss: the policy's loss, a subclass of it or a partial of one.
        reference_updates: updates in each iteration of the warm-up in which a new policy learns the task's reference
            (:class:`ReferenceLoss`). A trained one would forget what it knows.
        overlap: the model learns in a process of its own (:class:`ModelUpdatesBeside`), while the policy learns in the
            model of the iteration before. For a CPU; call :meth:`close` at the end.

    Attributes:
        average: copy of ``policy`` with the moving average of its weights.

    Raises:
        ConfigError: for an actor that has none of the policy's learning weights, and for weights without a shape.

    >>> from plat.modules import DynamicsModel, PlainPolicy
    >>> from plat.motions import MotionLibrary, generate_motions
    >>> from plat.tasks import TimedKeyframes, TimedKeyframesConfig
    >>> library = MotionLibrary.from_clips(generate_motions("train", seconds=8))
    >>> task, policy = TimedKeyframes(library, TimedKeyframesConfig(chains=6)), PlainPolicy(library.robot)
    >>> learner = ImaginationLearner(policy, policy.deployed(), DynamicsModel(library.robot), task)
    >>> sum(p.numel() for p in learner.average.parameters()) == sum(p.numel() for p in policy.parameters())
    True
    """

    def __init__(
        self,
        policy: nn.Module,
        actor: TensorDictModuleBase,
        model: DynamicsModel,
        task: Task,
        config: ImaginationConfig | None = None,
        *,
        effort: NestedKey = "action",
        loss: Callable[..., ImaginationLoss] = ImaginationLoss,
        reference_updates: int = 0,
        overlap: bool = False,
    ):
        check_value("imagination: task", task, Task)
        check_value("imagination: config", config, ImaginationConfig | None)
        check_value("imagination: reference_updates", reference_updates, Natural)
        self.config = config = config or ImaginationConfig()
        self.rates = rates = config.rates()
        if lazy := [name for name, value in policy.named_parameters() if nn.parameter.is_lazy(value)]:
            raise ConfigError(
                f"imagination: the policy's {lazy[0]!r} has no shape yet, expected a policy that was called before, or "
                "no LazyLinear"
            )
        self.policy = policy
        self.model = model
        self.average = copy.deepcopy(policy)
        self.critic = (
            _Critic(task, actor, config.critic, config.lost_cost).to(model.mean.device) if config.critic else None
        )
        self.model_updates = ModelUpdates(model, config)
        self.policy_loss = loss(
            actor,
            model,
            task,
            steps=config.steps,
            discount=config.discount,
            effort_weight=config.effort,
            rate_weight=config.rate,
            critic=None if self.critic is None else self.critic.estimate(),
            lost_cost=config.lost_cost,
        )
        self.policy_loss.set_keys(effort=effort)
        self._learning = learning = [parameter for parameter in policy.parameters() if parameter.requires_grad]
        if {*map(id, learning)}.isdisjoint(map(id, actor.parameters())):
            raise ConfigError(
                "imagination: the actor has none of the weights of the policy that learn, expected a view of the same "
                "policy, such as its deployed()"
            )
        self.policy_optimizers = muon_and_adam(policy, rates.policy_muon * rates.lr, rates.lr, learning)
        critic_weights = [] if self.critic is None else list(self.critic.parameters())
        self.critic_optimizers = [torch.optim.Adam(critic_weights, lr=rates.lr, fused=True)] if critic_weights else []
        device, static = model.mean.device, task.static and self.policy_loss.static
        self.reference_updates = reference_updates
        self._imagined = GraphedLoss(
            self.policy_loss, [*learning, *critic_weights], device, config.precision, capture=static
        )
        self._reference = GraphedLoss(ReferenceLoss(actor, task), learning, device, config.precision, capture=False)
        self._beside = ModelUpdatesBeside(self.model_updates) if overlap else None
        self._unlogged: list[dict[str, Tensor]] = []
        self._rates = self._full_rates()
        self.iterations = 0
        """Iterations so far."""
        self.updates = 0
        """Updates of the policy so far."""
        self.watch = ExploitationWatch()
        """Detector of model exploitation, for whoever knows what a step costs in simulation; a part of the state."""
        self._finite = {what: FiniteUpdates(what) for what in ("policy", "critic")}
        self._finite["model"] = self.model_updates.finite

    def observe(self, rollout: TensorDictBase) -> None:
        """Update the normalizers with a rollout ``[N, T]``, until they are frozen."""
        policy: Any = self.policy
        if self.iterations < self.config.settle:
            if hasattr(policy, "update_normalizers"):
                policy.update_normalizers(rollout)
            elif hasattr(policy, "normalizer"):  # that of a refined student stays as it is
                policy.normalizer.update(rollout)
            if self.critic is not None:
                self.critic.normalizer.update(rollout)
        if int(self.model.batches) >= self.config.settle:
            return
        before, after = (GeneralizedState.unpack(part["robot_state"]) for part in (rollout, rollout["next"]))
        going_on = ~rollout["next", "done"][..., 0]
        if ("next", "pushed") in rollout.keys(True):
            going_on &= ~rollout["next", "pushed"]
        target, physics = told_to_model(self.model.robot, rollout, rollout["action"])
        # what follows an episode's end is the next one's start in some collectors
        kept = (state.at(going_on) for state in (before, after))
        parameters = None if physics is None else physics[going_on]
        self.model.update_statistics(next(kept), target[going_on], next(kept), parameters)

    def step(self, replay: Windows, fraction: float = 0.0) -> dict[str, float]:
        """Run the updates of one iteration.

        Args:
            replay: recent rollouts.
            fraction: fraction of the budget that is spent; learning rates depend on it.

        Returns:
            Means of the losses and what they log, the policy's only after the warm-up, and ``loss_reference`` in it.
            ``model/skipped`` and ``policy_skipped`` are the fractions of updates that were skipped, as their gradient
            was not finite.

        Raises:
            ActionError: when 50 gradients in a row were not finite.
        """
        config, log = self.config, _Means()
        for losses in self._finished_beside():  # their rates are those of before
            log.add(losses)
        self._set_rates(fraction)
        if len(replay) > config.window:
            self._learn_robot(partial(replay.windows, config.model_batch, config.window + 1), log)
        with half_the_threads() if self._beside is not None and not self._beside.ended else nullcontext():
            self._learn_policy(partial(replay.states, config.policy_batch, config.recent), log)
        self.iterations += 1
        return log.means()

    def _finished_beside(self) -> list[dict[str, Tensor]]:
        """Return what is logged of the model's updates that an iteration before began, in another process."""
        kept, self._unlogged = self._unlogged, []
        return [*kept, *([] if self._beside is None else self._beside.finish())]

    def _learn_robot(self, sample: Callable[[], TensorDictBase], log: "_Means") -> None:
        updates = range(self.config.model_updates)
        if self._beside is not None:
            self._beside.begin([sample() for _ in updates])
            return
        for _ in updates:
            log.add(self.model_updates.update(sample()))

    def _learn_policy(self, sample: Callable[[], TensorDictBase], log: "_Means") -> None:
        if self.iterations >= self.rates.warmup:
            for _ in range(self.config.policy_updates):
                self._update_policy(self._imagined.backward(sample()), log)
            return
        for _ in range(self.reference_updates):
            log.add(self._reference.backward(sample()))
            self._step_policy()

    def close(self) -> None:
        """End the process of the model."""
        if self._beside is not None:
            self._beside.close()

    def _update_policy(self, losses: dict[str, Tensor], log: "_Means") -> None:
        # the critic's loss is in the sum: it and the policy reach different weights
        for optimizer in self.critic_optimizers:
            if self._finite["critic"].allow(losses["loss_critic"]):
                optimizer.step()
            optimizer.zero_grad()
        norm, learns = self._step_policy()
        log.add({**losses, "policy_gradient": norm, "policy_skipped": torch.tensor(float(not learns))})

    def _step_policy(self) -> tuple[Tensor, bool]:
        """Update the policy and its average by the gradient; return its norm, and whether it was of use."""
        norm = nn.utils.clip_grad_norm_(self.policy.parameters(), self.config.grad_norm)
        learns = self._finite["policy"].allow(norm)  # the gradient of an exploding imagined rollout is useless
        for optimizer in self.policy_optimizers:
            if learns:
                optimizer.step()
            optimizer.zero_grad()
        self._move_average()
        return norm, learns

    @torch.no_grad()
    def _move_average(self) -> None:
        ours: list[Tensor] = list(self.average.parameters())
        theirs: list[Tensor] = list(self.policy.parameters())
        # at first over a part of the updates so far: over 100, that of a short run would lag far behind
        self.updates += 1
        torch._foreach_lerp_(ours, theirs, max(1 - self.config.average, 9 / (9 + self.updates)))
        for ours_buffer, theirs_buffer in zip(self.average.buffers(), self.policy.buffers(), strict=True):
            ours_buffer.copy_(theirs_buffer)

    def _optimizers(self) -> list[torch.optim.Optimizer]:
        return [*self.model_updates.optimizers, *self.policy_optimizers, *self.critic_optimizers]

    def _full_rates(self) -> list[list[float]]:
        return [[group["lr"] for group in optimizer.param_groups] for optimizer in self._optimizers()]

    def _set_rates(self, fraction: float) -> None:
        config = self.config
        fallen = max(0.0, min(fraction, 1.0) - config.constant) / max(1 - config.constant, 1e-9)
        share = 1 - (1 - config.final_lr) * fallen
        for optimizer, rates in zip(self._optimizers(), self._rates, strict=True):
            for group, rate in zip(optimizer.param_groups, rates, strict=True):
                group["lr"] = rate * share

    def state_dict(self) -> dict[str, Any]:
        """Return the state from which a resumed run continues, except the average, which is the run's policy."""
        self._unlogged = self._finished_beside()
        return {
            "policy": self.policy.state_dict(),
            "model": self.model.state_dict(),
            **({} if self.critic is None else {"critic": self.critic.state_dict()}),
            "optimizers": [optimizer.state_dict() for optimizer in self._optimizers()],
            "iterations": self.iterations,
            "updates": self.updates,
            "watch": self.watch.state_dict(),
            "skipped": {what: updates.in_a_row for what, updates in self._finite.items()},
            # the next iteration logs them, and a resumed run as one that was not interrupted
            "unlogged": [{name: float(value) for name, value in losses.items()} for losses in self._unlogged],
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore a state of :meth:`state_dict`.

        The policy's optimizers begin anew where the state is of others: of Adam alone or of Muon as well.

        Raises:
            StateError: when it has a critic and the learner has none, or the other way round.
        """
        if ("critic" in state) != (self.critic is not None):
            had, has = ("with" if there else "without" for there in ("critic" in state, self.critic is not None))
            raise StateError(f"imagination: a state {had} a critic, expected one {has}")
        self._finished_beside()  # updates that are under way would take the place of what is restored
        self.policy.load_state_dict(state["policy"])
        self.model.load_state_dict(state["model"])
        if self.critic is not None:
            self.critic.load_state_dict(state["critic"])
        self._load_optimizers(state["optimizers"])
        self.iterations = int(state["iterations"])
        before = max(0, self.iterations - self.rates.warmup) * self.config.policy_updates
        self.updates = int(state.get("updates", before))  # not in checkpoints of an older plat
        self.watch.load_state_dict(state.get("watch", {"costs": []}))  # nor is this
        for what, in_a_row in state.get("skipped", {}).items():  # not in checkpoints of an older plat
            self._finite[what].in_a_row = int(in_a_row)
        unlogged = state.get("unlogged", ())  # nor is this
        self._unlogged = [{name: torch.tensor(value) for name, value in losses.items()} for losses in unlogged]

    def _load_optimizers(self, states: list[dict[str, Any]]) -> None:
        ours = self._optimizers()
        if len(states) != len(ours):  # those of the policy are others
            models, critics = len(self.model_updates.optimizers), len(self.critic_optimizers)
            ours, states = ([*each[:models], *each[len(each) - critics :]] for each in (ours, states))
        for optimizer, values in zip(ours, states, strict=True):
            optimizer.load_state_dict(values)


class _Critic(nn.Module):
    """Mean cost of the steps to come, from what the policy sees; at most that of a lost robot."""

    def __init__(self, task: Task, actor: TensorDictModuleBase, hidden: tuple[int, ...], most: float):
        super().__init__()
        seen = shown(task, *task.start(1))
        keys = [key for key in actor.in_keys if key in seen.keys(True)]  # a posterior sees more than a task shows
        widths = [seen[key].shape[-1] for key in keys]
        self.normalizer = ObservationNormalizer(keys, sum(widths), widths=widths)
        self.network = mlp(sum(widths), hidden, 1)
        self.most = most

    def forward(self, observation: Tensor) -> Tensor:
        # bounded: it learns from its own estimates, and nothing else would keep them from running away
        return self.most * self.network(observation).sigmoid()

    def estimate(self) -> TensorDictSequential:
        """Return the module that writes ``cost_to_go``."""
        head = TensorDictModule(self, ["critic_observation"], ["cost_to_go"])
        return TensorDictSequential(self.normalizer.using(out_key="critic_observation"), head)


class _Means:
    """Running means of tensors over the updates of an iteration."""

    def __init__(self) -> None:
        self._values: dict[str, list[Tensor]] = {}

    def add(self, values: dict[str, Tensor]) -> None:
        for name, value in values.items():
            self._values.setdefault(name, []).append(value.detach())

    def means(self) -> dict[str, float]:
        return {name: float(torch.stack(values).mean()) for name, values in self._values.items()}


def exploring(actor: TensorDictModuleBase, std: float) -> TensorDictSequential:
    """Add Gaussian noise to an actor's action; deterministic exploration removes the noise.

    Args:
        actor: writes ``action``.
        std: standard deviation, in units of action.

    >>> from plat.modules import PlainPolicy
    >>> from plat.robots import G1
    >>> exploring(PlainPolicy(G1).deployed(), 0.25).out_keys
    ['action']
    """
    check_value("exploring: std", std, NonNegative)
    noise = TensorDictModule(_Noise(std), in_keys=["action"], out_keys=["action"])
    return TensorDictSequential(actor, noise, selected_out_keys=["action"])


class _Noise(nn.Module):
    def __init__(self, std: float):
        super().__init__()
        self.std = std

    def forward(self, action: Tensor) -> Tensor:
        if exploration_type() in (ExplorationType.DETERMINISTIC, ExplorationType.MEAN, ExplorationType.MODE):
            return action
        return action + self.std * torch.randn_like(action)
