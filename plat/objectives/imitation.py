"""Imitation losses of stage 2: behavior cloning with a privileged latent, or without."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import torch
from tensordict import NestedKey, TensorDict, TensorDictBase
from tensordict.nn import TensorDictModuleBase, dispatch
from torch import Tensor
from torchrl.envs.utils import ExplorationType
from torchrl.objectives.common import LossModule

from plat.bounds import NonNegative, as_names, check_value
from plat.entries import check_entries
from plat.errors import ObservationError
from plat.objectives.divergence import gaussian_kl
from plat.objectives.finite import check_loss

__all__ = ["ImitationLoss", "LatentImitationLoss"]


class LatentImitationLoss(LossModule):
    r"""Imitation loss through a privileged posterior that teaches a deployable prior.

    .. math::
        L = \|\pi(h, z^q) - a^E\|^2 + \lambda_p \|\pi(h, z^p) - a^E\|^2 + \beta \, KL(q \| p)

    with :math:`z^q \sim q` and :math:`z^p \sim p` both sampled, squared norms summed over the action, the divergence
    summed over the latent, and everything averaged over the batch. The training signal of the prior is twofold: it
    is drawn toward the posterior, and its own samples must decode to the expert's action.

    Args:
        policy: writes distributions, samples and actions of both latents, as
            :meth:`plat.modules.LatentPolicy.training_graph` does.

    Keyword Args:
        prior_weight: :math:`\lambda_p`.
        beta: :math:`\beta`, a buffer: anneal it by ``loss.beta.fill_(value)``.
        free_bits: divergence of each latent dimension, averaged over the batch, that is not penalized (nats; Kingma et
            al., arXiv 1606.04934).
        divergence: from the posterior's ``parameters`` ``[B, n]``, then the prior's, to ``[B, m]``; summed over ``m``.
        parameters: names of a distribution's parameters in its group: ``("loc", "scale")`` of a Gaussian,
            ``("logits",)`` of a categorical, ``("loc",)`` of a quantized latent.

    Returns ``loss_posterior``, ``loss_prior`` and ``loss_kl``, whose sum is the loss, and for the log ``kl``,
    ``posterior_error`` and ``prior_error`` (root mean square over the action).

    Source: the stage-2 objective of PLAT.

    >>> from plat.robots import G1
    >>> from plat.modules import LatentPolicy
    >>> policy = LatentPolicy(G1)
    >>> loss = LatentImitationLoss(policy.training_graph(), beta=0.01)
    >>> loss.out_keys[:3]
    ['loss_posterior', 'loss_prior', 'loss_kl']

    With the squared distance of the means in place of the divergence:

    >>> def distance(posterior, prior):
    ...     return (posterior - prior).square()
    >>> loss = LatentImitationLoss(policy.training_graph(), divergence=distance, parameters=("loc",))
    """

    @dataclass
    class _AcceptedKeys:
        expert_action: NestedKey = "expert_action"
        prior: NestedKey = "prior"
        prior_action: NestedKey = ("prior", "action")
        posterior: NestedKey = "posterior"
        posterior_action: NestedKey = ("posterior", "action")

    tensor_keys: _AcceptedKeys
    default_keys = _AcceptedKeys
    out_keys: ClassVar[list[NestedKey]] = [
        "loss_posterior",
        "loss_prior",
        "loss_kl",
        "kl",
        "posterior_error",
        "prior_error",
    ]
    # TorchRL's losses make policies deterministic by default; this loss needs samples.
    deterministic_sampling_mode = ExplorationType.RANDOM

    def __init__(
        self,
        policy: TensorDictModuleBase,
        *,
        prior_weight: float = 1.0,
        beta: float = 0.01,
        free_bits: float = 0.0,
        divergence: Callable[..., Tensor] = gaussian_kl,
        parameters: Sequence[str] = ("loc", "scale"),
    ):
        super().__init__()
        for name, value in (("prior_weight", prior_weight), ("beta", beta), ("free_bits", free_bits)):
            check_value(f"imitation loss: {name}", value, NonNegative)
        self.policy = policy
        self.divergence = divergence
        self.parameter_names = as_names(parameters)
        self.prior_weight = prior_weight
        self.free_bits = free_bits
        self.register_buffer("beta", torch.tensor(float(beta)))

    @property
    def in_keys(self) -> list[NestedKey]:
        """Return the keys that the policy reads, and the expert's action."""
        return [*self.policy.in_keys, self.tensor_keys.expert_action]

    def _forward_value_estimator_keys(self, **_: object) -> None:
        pass

    @dispatch
    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Compute the losses of a batch ``[B]``.

        Raises:
            ActionError: when one of them is not finite.
            ObservationError: for an entry that is missing or of another shape, of the batch or of the policy.
        """
        keys = self.tensor_keys
        out = self.policy(tensordict.select(*self.policy.in_keys, strict=False))
        groups: tuple[NestedKey, ...] = (keys.posterior, keys.prior)
        parameters: list[NestedKey] = [(group, name) for group in groups for name in self.parameter_names]
        written = (keys.posterior_action, keys.prior_action, *parameters)
        if absent := [key for key in written if out.get(key, None) is None]:
            raise ObservationError(
                f"imitation loss: the policy writes no {absent[0]!r}, expected what LatentPolicy.training_graph() does"
            )
        expert_action = expert_actions(tensordict, keys.expert_action, out.get(keys.posterior_action))
        posterior_error = (out.get(keys.posterior_action) - expert_action).square()
        prior_error = (out.get(keys.prior_action) - expert_action).square()
        kl = self.divergence(*(out.get(key) for key in parameters))
        if kl.ndim != expert_action.ndim or kl.shape[:-1] != expert_action.shape[:-1]:
            expected = ", ".join(map(str, (*expert_action.shape[:-1], "m")))
            raise ObservationError(f"imitation loss: divergence has shape {tuple(kl.shape)}, expected [{expected}]")
        penalized = kl.reshape(-1, kl.shape[-1]).mean(0)
        if self.free_bits:
            penalized = penalized.clamp_min(self.free_bits)
        losses = {
            "loss_posterior": posterior_error.sum(-1).mean(),
            "loss_prior": self.prior_weight * prior_error.sum(-1).mean(),
            "loss_kl": self.beta * penalized.sum(),
        }
        check_loss(torch.stack([*losses.values()]).sum(), "imitation loss")
        return TensorDict(
            {
                **losses,
                "kl": kl.detach().sum(-1).mean(),
                "posterior_error": posterior_error.detach().mean().sqrt(),
                "prior_error": prior_error.detach().mean().sqrt(),
            }
        )


def expert_actions(tensordict: TensorDictBase, key: NestedKey, action: Tensor) -> Tensor:
    """Return the expert's actions, which have to have the shape of the policy's.

    Raises:
        ObservationError: naming the entry, when it is missing or has another shape.
    """
    check_entries(tensordict, {key: tuple(action.shape)}, "imitation loss")
    return tensordict.get(key)


class ImitationLoss(LossModule):
    r"""Behavior cloning loss: squared distance of the policy's action from the expert's.

    .. math::
        L = \|\pi(o) - a^E\|^2

    The squared norm is summed over the action and averaged over the batch. The prediction and the label have keys of
    their own; TorchRL's ``BCLoss`` reads both from one.

    Args:
        policy: writes ``action``.

    Returns ``loss_imitation``, and for the log ``error`` (root mean square over the action).

    >>> from plat.robots import G1
    >>> from plat.modules import PlainPolicy
    >>> ImitationLoss(PlainPolicy(G1).training_graph()).out_keys
    ['loss_imitation', 'error']
    """

    @dataclass
    class _AcceptedKeys:
        action: NestedKey = "action"
        expert_action: NestedKey = "expert_action"

    tensor_keys: _AcceptedKeys
    default_keys = _AcceptedKeys
    out_keys: ClassVar[list[NestedKey]] = ["loss_imitation", "error"]

    def __init__(self, policy: TensorDictModuleBase):
        super().__init__()
        self.policy = policy

    @property
    def in_keys(self) -> list[NestedKey]:
        """Return the keys that the policy reads, and the expert's action."""
        return [*self.policy.in_keys, self.tensor_keys.expert_action]

    def _forward_value_estimator_keys(self, **_: object) -> None:
        pass

    @dispatch
    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Compute the loss of a batch ``[B]``.

        Raises:
            ActionError: when it is not finite.
            ObservationError: for an entry that is missing or of another shape, of the batch or of the policy.
        """
        out = self.policy(tensordict.select(*self.policy.in_keys, strict=False))
        check_entries(out, {self.tensor_keys.action: ("n",)}, "imitation loss: policy")
        action = out.get(self.tensor_keys.action)
        error = (action - expert_actions(tensordict, self.tensor_keys.expert_action, action)).square()
        loss = check_loss(error.sum(-1).mean(), "imitation loss")
        return TensorDict({"loss_imitation": loss, "error": error.detach().mean().sqrt()})
