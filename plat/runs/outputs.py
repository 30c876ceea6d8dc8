"""Folders that runs are written to: may one begin there, or be resumed?"""

import os
from pathlib import Path

from plat.errors import CheckpointError
from plat.files import readable
from plat.runs.locate import CONFIG_FILE, FORMAT, read_config

__all__ = ["CHECKPOINTS", "INPUTS_FILE", "WEIGHTS_FILE", "check_out", "is_kept"]

CHECKPOINTS, INPUTS_FILE, WEIGHTS_FILE = "checkpoints", "inputs.json", "model.safetensors"


def check_out(folder: Path, *, resume: bool) -> None:
    """Check that a run can begin in a directory, or be resumed from it.

    A start that did not get to a checkpoint leaves nothing that is worth keeping, and blocks nothing.

    Raises:
        CheckpointError: when it holds a run already, or none that can be resumed; then nothing is touched.

    >>> check_out(Path("/nowhere/run"), resume=True)
    Traceback (most recent call last):
    ...
    plat.errors.CheckpointError: '/nowhere/run' holds no run to go on with: leave out --resume to start one
    """
    config = folder / CONFIG_FILE
    if readable(str(folder)) != str(folder):
        raise CheckpointError(
            f"{str(folder)!r}: its name is no UTF-8, weights cannot be read from there; choose another"
        )
    if not os.path.exists(config) and is_kept(folder):
        raise CheckpointError(
            f"{str(folder)!r} holds weights or checkpoints of a run whose {CONFIG_FILE} is lost: put it back, or "
            "choose another --out"
        )
    if resume:
        if not os.path.exists(config):
            raise CheckpointError(f"{str(folder)!r} holds no run to go on with: leave out --resume to start one")
        if read_config(folder).get("format") != FORMAT:
            raise CheckpointError(f"{str(config)!r} is of no run of plat: choose another --out")
    elif os.path.exists(config) and not _is_abandoned(folder):
        raise CheckpointError(f"{str(folder)!r} already holds a run: go on with --resume or choose another --out")


def _is_abandoned(folder: Path) -> bool:
    """Return whether a directory holds a run without weights and checkpoints."""
    try:
        config = read_config(folder)
    except CheckpointError:
        return False
    # a mean has the progress of its last run, and is written without weights first
    begun = "finished" not in config or "average" in config
    return config.get("format") == FORMAT and begun and not is_kept(folder)


def is_kept(folder: Path) -> bool:
    """Return whether a directory holds weights or checkpoints, which are worth keeping."""
    checkpoints = folder / CHECKPOINTS
    # not Path's own: those raise for a name that is too long
    return os.path.exists(folder / WEIGHTS_FILE) or (
        os.path.isdir(checkpoints) and any(checkpoints.glob("*checkpoint-*"))
    )
