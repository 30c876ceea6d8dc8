"""PPO iteration on a rollout: advantages, then epochs of clipped updates with a KL-adaptive learning rate."""

import copy
from contextlib import AbstractContextManager
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import ProbabilisticTensorDictSequential, TensorDictModuleBase
from torch import Tensor, nn
from torch.distributions import Distribution, Normal
from torchrl.objectives import ClipPPOLoss, KLAdaptiveLR
from torchrl.objectives.value import GAE

from plat.bounds import check_value
from plat.entries import check_rollout
from plat.errors import ActionError, ConfigError, ObservationError
from plat.objectives.divergence import gaussian_kl
from plat.objectives.finite import check_loss
from plat.objectives.settings import PPOConfig
from plat.precision import autocast

__all__ = ["PPO", "PPOConfig"]

_NEXT = tuple(("next", key) for key in ("reward", "done", "terminated", "truncated"))


class _ClipPPOLoss(ClipPPOLoss):
    """TorchRL's PPO loss, which also keeps the action distribution with its gradient.

    Computing it once more for another term would run the actor twice.
    """

    _distribution: Distribution | None = None

    def _get_cur_log_prob(self, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        log_prob, dist, is_composite = super()._get_cur_log_prob(*args, **kwargs)
        self._distribution = dist
        return log_prob, dist, is_composite

    def take_distribution(self) -> Distribution:
        """Return the distribution of the last call, which is not kept: a graph could not be copied."""
        dist, self._distribution = self._distribution, None
        assert dist is not None
        return dist


def _normal(dist: Distribution) -> Normal:
    """Return the Gaussian of a distribution, before a bounded one's transform.

    Raises:
        ConfigError: when it has none.
    """
    inner = dist
    while not isinstance(inner, Normal) and hasattr(inner, "base_dist"):
        inner = inner.base_dist
    if isinstance(inner, Normal):
        return inner
    raise ConfigError(f"PPO: the actor's distribution is a {type(dist).__name__}, expected a Normal or a TanhNormal")


def _without_noise(dist: Distribution) -> Tensor:
    return dist.deterministic_sample if hasattr(dist, "deterministic_sample") else dist.mean


def _explained(value: Tensor, target: Tensor) -> float:
    """Fraction of the targets' variance that the values explain; 0 where there is none, as of one state."""
    variance = target.var(correction=0)
    return float(1 - (target - value).var(correction=0) / variance) if variance > 1e-8 else 0.0


def _adam(module: nn.Module, lr: float) -> torch.optim.Adam:
    return torch.optim.Adam([p for p in module.parameters() if p.requires_grad], lr=lr, fused=True)


class PPO:
    """Proximal policy optimization around TorchRL's ``ClipPPOLoss`` and ``GAE``.

    The rollout must hold what the policy wrote while acting: ``loc``, ``scale``, the sample, its log-probability, and
    the inputs of ``actor``. Features before ``actor`` (a normalizer, a frozen backbone) are thus computed once, and
    cannot change between acting and learning.

    Args:
        actor: the stochastic module to train.
        critic: writes ``state_value``.
        observe: computes the inputs of ``critic`` from a rollout; runs once per rollout.
        config: hyperparameters.
        action_key: the entry that the actor's distribution is over.

    Raises:
        ConfigError: for an actor or a critic of another kind.

    Source: Schulman et al., arXiv 1707.06347; Rudin et al., arXiv 2109.11978, for the learning rate.
    """

    def __init__(
        self,
        actor: ProbabilisticTensorDictSequential,
        critic: TensorDictModuleBase,
        observe: TensorDictModuleBase,
        config: PPOConfig | None = None,
        action_key: str = "action",
    ):
        if not isinstance(actor, ProbabilisticTensorDictSequential):
            raise ConfigError(
                f"PPO: actor is a {type(actor).__name__}, expected a ProbabilisticTensorDictSequential, as a policy's "
                "head() is"
            )
        if not isinstance(critic, TensorDictModuleBase):
            raise ConfigError(f"PPO: critic is a network {type(critic).__name__}, expected a module of a TensorDict")
        check_value("PPO: config", config, PPOConfig | None)
        self.config = config = config or PPOConfig()
        self.actor = actor
        self.critic = critic
        self.observe = observe
        self.loss = _ClipPPOLoss(
            actor,
            critic,
            clip_epsilon=config.clip,
            entropy_coeff=config.entropy,
            critic_coeff=1.0,  # the critic has an optimizer of its own
            loss_critic_type="l2",
            normalize_advantage=True,
        )
        self._sample_keys = [action_key, f"{action_key}_log_prob"]
        self.loss.set_keys(action=action_key, sample_log_prob=self._sample_keys[1])
        self._gae = GAE(gamma=config.gamma, lmbda=config.lmbda, value_network=None)
        self.optimizer = _adam(actor, config.lr)
        self.critic_optimizer = _adam(critic, config.critic_lr)
        self._schedule = KLAdaptiveLR(self.optimizer, config.target_kl, min_lr=config.min_lr, max_lr=config.max_lr)

    def step(
        self, rollout: TensorDictBase, learn_policy: bool = True, gradient: Tensor | None = None
    ) -> dict[str, float]:
        """Update actor and critic on a rollout ``[N, T]``.

        Args:
            rollout: of the policy.
            learn_policy: False trains the critic alone.
            gradient: of something else to be lowered with respect to the action without noise ``[N, T, A]``, such as
                :func:`plat.objectives.motor_gradient`; added to PPO's own.

        Returns:
            ``policy_loss``, ``value_loss``, ``entropy``, ``kl`` and ``clip_fraction``, averaged over the updates;
            ``explained_variance`` and ``std`` of the rollout (of a bounded distribution, that before the bounds), and
            ``lr`` after it.

        Raises:
            ConfigError: for an actor whose distribution is no Gaussian.
            ObservationError: for a rollout that lacks an entry or is not ``[N, T]``, and a gradient of another shape.
            ActionError: for a rollout or a gradient that is not finite; the weights stay what they were before it.
        """
        data = self.prepare(rollout)
        if gradient is not None:
            if gradient.shape != rollout["loc"].shape:
                shapes = f"{tuple(gradient.shape)}, expected {tuple(rollout['loc'].shape)}"
                raise ObservationError(f"PPO: gradient has shape {shapes}, that of 'loc'")
            data["gradient"] = gradient.flatten(0, 1)
        optimizers = (self.optimizer, self.critic_optimizer) if learn_policy else (self.critic_optimizer,)
        batch_size = self.config.batch_size(len(data))
        totals: dict[str, Tensor] = {}
        updates = 0
        # shuffled once: the same minibatches in every epoch, and no copy of any of them
        data = data[torch.randperm(len(data), device=data.device)]
        for _ in range(self.config.epochs):
            for batch in data[: batch_size * self.config.minibatches].split(batch_size):
                # entered for each minibatch: autocast keeps its copies of the weights until it exits
                with self._autocast(data):
                    losses = self.loss(batch)
                dist = self.loss.take_distribution()
                new = _normal(dist)
                loss = losses["loss_critic"]
                if learn_policy:
                    loss = loss + losses["loss_objective"] + losses["loss_entropy"]
                    if gradient is not None:
                        # a scalar whose gradient by each sample's mean is that sample's row, over their number
                        loss = loss + (batch["gradient"] * _without_noise(dist)).sum(-1).mean()
                for optimizer in optimizers:
                    optimizer.zero_grad()
                loss.backward()
                for optimizer in optimizers:
                    norm = nn.utils.clip_grad_norm_(optimizer.param_groups[0]["params"], self.config.grad_norm)
                    check_loss(norm, "PPO: norm of the gradient")
                for optimizer in optimizers:
                    optimizer.step()
                updates += 1
                for name in ("loss_objective", "loss_critic", "entropy", "clip_fraction"):
                    totals[name] = totals.get(name, torch.zeros(())) + losses[name].detach()
            # of the last minibatch, before its update: no further pass through the network
            old = _normal(self.actor.build_dist_from_params(batch))
            kl = gaussian_kl(old.loc, old.scale, new.loc.detach(), new.scale.detach()).sum(-1).mean()
            totals["kl"] = totals.get("kl", torch.zeros(())) + kl * self.config.minibatches
            if learn_policy:
                self._schedule.step(float(kl))
        means = {name: float(total) / updates for name, total in totals.items()}
        value, target = data["state_value"], data["value_target"]
        return {
            "policy_loss": means["loss_objective"],
            "value_loss": means["loss_critic"],
            "entropy": means["entropy"],
            "kl": means["kl"],
            "clip_fraction": means["clip_fraction"],
            "explained_variance": _explained(value, target),
            "lr": self.optimizer.param_groups[0]["lr"],
            "std": float(data["scale"].mean()),
        }

    @torch.no_grad()
    def prepare(self, rollout: TensorDictBase) -> TensorDict:
        """Compute values, advantages and targets of a rollout ``[N, T]``; return it flat, with the entries that the
        loss reads.
        """
        check_rollout(rollout, "PPO", (*self.actor.in_keys, *self._sample_keys, "loc", "scale", *_NEXT))
        seen = self.observe(rollout.select(*self.observe.in_keys, strict=False))
        root = self._values(seen, rollout)
        # the state after a step is the state before the next one, except where an episode ended or the rollout
        # did (truncation bootstrapping): only there the critic runs again. A terminated state has the value 0.
        next_value = torch.cat((root[:, 1:], torch.zeros_like(root[:, :1])), 1)
        truncated = rollout["next", "truncated"].squeeze(-1)
        ask = truncated.clone() if self.config.truncated == "state" else torch.zeros_like(truncated)
        ask[:, -1] = True
        after = self.observe(rollout["next"].select(*self.observe.in_keys, strict=False)[ask])
        next_value[ask] = self._values(after, rollout)
        if self.config.truncated == "mean":
            next_value[truncated] = root.mean()
        signals = TensorDict(
            {
                "state_value": root,
                "next": {
                    "state_value": next_value,
                    **{key: rollout["next", key] for key in ("reward", "done", "terminated")},
                },
            },
            rollout.batch_size,
        )
        signals = self._gae(signals)
        data = rollout.select(*self.actor.in_keys, *self._sample_keys, "loc", "scale")
        data.update(seen.select(*self.critic.in_keys))
        for key in ("advantage", "value_target", "state_value"):
            data[key] = signals[key]
        for key, values in data.items(True, True):
            if not values.isfinite().all():
                raise ActionError(f"PPO: {key!r} of the rollout holds NaN or infinity; nothing was learned from it")
        return data.detach().reshape(-1)

    def __deepcopy__(self, memo: dict[int, Any]) -> "PPO":
        # made anew: a copied loss would have weights of its own, which the copied optimizers would not reach
        parts = copy.deepcopy((self.actor, self.critic, self.observe), memo)
        twin = type(self)(*parts, self.config, self._sample_keys[0])
        twin.load_state_dict(copy.deepcopy(self.state_dict()))
        return twin

    def state_dict(self) -> dict[str, Any]:
        """Return the state of both optimizers, and the learning rates that they were configured with."""
        return {
            "optimizer": self.optimizer.state_dict(),
            "critic_optimizer": self.critic_optimizer.state_dict(),
            "lr": self.config.lr,
            "critic_lr": self.config.critic_lr,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore a state of :meth:`state_dict`; a learning rate that is configured otherwise now is the new one."""
        for name, optimizer in (("", self.optimizer), ("critic_", self.critic_optimizer)):
            optimizer.load_state_dict(state[f"{name}optimizer"])
            rate = getattr(self.config, f"{name}lr")
            if state[f"{name}lr"] != rate:
                for group in optimizer.param_groups:
                    group["lr"] = rate

    def _values(self, seen: TensorDictBase, rollout: TensorDictBase) -> Tensor:
        """Values at the precision of the rewards: the last layer of a critic of one's own may be in half precision."""
        with self._autocast(rollout):
            values: Tensor = self.critic(seen)["state_value"]
        return values.to(rollout["next", "reward"].dtype)

    def _autocast(self, data: TensorDictBase) -> AbstractContextManager:
        return autocast(data.device, self.config.precision)
