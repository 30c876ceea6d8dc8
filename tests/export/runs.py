"""Runs of small policies with random weights."""

from pathlib import Path
from typing import Any

import torch

from plat.modules import (
    Expert,
    ExpertConfig,
    FinetunedPolicy,
    LatentNoisePolicy,
    LatentPolicy,
    LatentPolicyConfig,
    ObservationNormalizer,
    PlainPolicy,
    PlainPolicyConfig,
    RefinementConfig,
    ResidualActionPolicy,
    ResidualLatentPolicy,
)
from plat.robots import G1
from plat.runs import policy_spec, save_weights, write_json

KINDS = (
    "latent",
    "plain",
    "residual_latent",
    "residual_latent_noise",
    "residual_action",
    "finetuned",
    "residual_latent_with_lead",
)
"""Every kind of policy that chases keyframes."""
_REFINED = {
    "residual_latent": ResidualLatentPolicy,
    "residual_latent_noise": LatentNoisePolicy,
    "residual_action": ResidualActionPolicy,
    "finetuned": FinetunedPolicy,
    "residual_latent_with_lead": ResidualLatentPolicy,
}


def small_policy(kind: str) -> Any:
    """A policy in which every part matters: no weight is 0, and no statistic of the observations is that of noise."""
    sizes = {"backbone": (32,), "hidden_size": 16, "decoder": (16,)}
    if kind == "expert":
        policy = Expert(G1, ExpertConfig(hidden=(32,)))
    elif kind == "expert_of_frames":
        policy = Expert(G1, ExpertConfig(hidden=(32,), action="reference_velocity", ahead=(1, 2, 5)))
    elif kind == "expert_with_lead":
        policy = Expert(G1, ExpertConfig(hidden=(32,), ahead=(1, 2), lead=0.1, catch_up=1.0))
    elif kind == "plain":
        policy = PlainPolicy(G1, PlainPolicyConfig(**sizes))
    else:
        policy = LatentPolicy(G1, LatentPolicyConfig(**sizes, latent_size=8, prior=(16,)))
        if kind in _REFINED:
            lead = 0.1 if kind.endswith("_with_lead") else 0.0
            policy = _REFINED[kind](policy, RefinementConfig(hidden=(16,), alpha=0.7, lead=lead))
    generator = torch.Generator().manual_seed(0)
    with torch.no_grad():
        for weight in policy.parameters():
            weight.add_(0.1 * torch.randn(weight.shape, generator=generator))
        for module in policy.modules():
            if isinstance(module, ObservationNormalizer):
                module.mean.normal_(0, 0.3, generator=generator)
                module.var.uniform_(0.5, 2.0, generator=generator)
    return policy.eval()


def write_run(folder: Path, policy: Any, **settings: Any) -> Path:
    """A run directory of a policy."""
    recipe = {"name": "refine", "settings": {"motions": ["clips.npz"], **settings}}
    made_with = {"plat": "0.1.0", "torch": "2.13.0", "commit": "abc"}
    config = {"format": "plat-run", "version": 1, "policy": policy_spec(policy)}
    write_json(folder / "config.json", {**config, "recipe": recipe, "made_with": made_with})
    save_weights(folder / "model.safetensors", policy)
    return folder
