"""Tiny runs and motions for the recipes that score."""

from pathlib import Path

import torch
from torch import nn

from plat.motions import save_motions
from plat.runs import policy_spec, save_weights, write_json
from tests.conftest import standing_clip


def save_run(folder: Path, policy: nn.Module, steps: int = 0) -> Path:
    """A run directory of a policy, finished after some steps unless they are 0."""
    finished = {"finished": {"steps": steps, "seconds": 1.0}} if steps else {}
    write_json(folder / "config.json", {"policy": policy_spec(policy), **finished})
    with torch.no_grad():
        for parameter in policy.parameters():  # so that it does next to nothing
            parameter.mul_(0.1)
    save_weights(folder / "model.safetensors", policy)
    return folder


def write_motions(folder: Path, frames: int = 61) -> str:
    """A motion file of two clips at 30 frames a second: ``run_a`` and ``walk_b``."""
    path = folder / "motions.npz"
    save_motions(path, [standing_clip(name, frames) for name in ("run_a", "walk_b")])
    return str(path)
