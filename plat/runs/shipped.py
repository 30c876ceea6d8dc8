"""The weights that come with plat."""

from pathlib import Path
from typing import Any

import torch

from plat.errors import CheckpointError
from plat.runs.saving import load_policy, read_json

__all__ = ["load_shipped", "shipped_runs"]

_FOLDER = Path(__file__).parents[1] / "weights"


def shipped_runs() -> dict[str, Path]:
    """The run directories that come with plat, by name: the folder's, and the robot's that the policy is for.

    >>> sorted(shipped_runs())
    [..., 'plat-g1', 'plat-generated-g1']
    """
    configs = sorted(_FOLDER.glob("*/config.json"))
    return {f"{path.parent.name}-{read_json(path)['policy']['robot']}": path.parent for path in configs}


def load_shipped(name: str, device: torch.device | str = "cpu") -> Any:
    """The policy of that name; see :func:`plat.load`."""
    runs = shipped_runs()
    if name not in runs:
        known = ", ".join(repr(run) for run in runs) or "none: this installation of plat has no weights"
        raise CheckpointError(f"no weights called {name!r} come with plat, only {known}")
    return load_policy(runs[name], device)
