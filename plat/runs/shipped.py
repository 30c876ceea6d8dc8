"""Pretrained weights that come with plat."""

from pathlib import Path

import torch

from plat.errors import CheckpointError
from plat.runs.policies import Policy
from plat.runs.saved_run import SavedRun

__all__ = ["load_shipped", "shipped_runs"]

_FOLDER = Path(__file__).parents[1] / "weights"


def shipped_runs() -> dict[str, Path]:
    """Return the run directories that come with plat, by names such as ``plat-g1``: the run's name and its robot's.

    >>> sorted(shipped_runs())
    [..., 'plat-g1', 'plat-generated-g1']
    """
    runs = (SavedRun(path.parent) for path in sorted(_FOLDER.glob("*/config.json")))
    return {f"{run.name}-{run.robot}": run.folder for run in runs}


def load_shipped(name: str, device: torch.device | str = "cpu") -> Policy:
    """Return the shipped policy of a name; see :func:`plat.load`."""
    runs = shipped_runs()
    if name not in runs:
        known = ", ".join(repr(run) for run in runs) or "none: this installation of plat has no weights"
        raise CheckpointError(f"no weights called {name!r} come with plat, only {known}")
    return SavedRun(runs[name]).policy(device)
