"""Pretrained weights that come with plat."""

import torch

from plat.errors import CheckpointError
from plat.gpu import check_device
from plat.runs.hub import HUB_PREFIX, download_run
from plat.runs.locate import shipped_runs
from plat.runs.policies import Policy
from plat.runs.saved_run import SavedRun

__all__ = ["load_shipped", "shipped_runs"]


def load_shipped(name: str, device: torch.device | str = "cpu") -> Policy:
    """Return the shipped policy of a name; see :func:`plat.load`."""
    check_device(device)
    name = str(name)  # a path is answered as any other name is
    if name.startswith(HUB_PREFIX):
        return SavedRun(download_run(name)).policy(device)
    runs = shipped_runs()
    if name not in runs:
        known = ", ".join(repr(run) for run in runs) or "none: this installation of plat has no weights"
        told = f"no weights called {name!r} come with plat, only {known}"
        raise CheckpointError(f"{told}; plat.runs.load_policy loads a run by its path")
    return SavedRun(runs[name]).policy(device)
