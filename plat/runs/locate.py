"""Where runs are: folders of the user, and the weights that come with plat."""

import os
from pathlib import Path
from typing import Any

from plat.errors import CheckpointError
from plat.files import as_path
from plat.json_file import short, version_fault
from plat.runs.hub import download_run, hub_name
from plat.runs.json_object import read_json

__all__ = ["CONFIG_FILE", "FORMAT", "VERSION", "is_run", "read_config", "run_folder", "shipped_runs"]

CONFIG_FILE = "config.json"
FORMAT, VERSION = "plat-run", 1
"""Entries ``format`` and ``version`` of that file."""
_WEIGHTS = Path(__file__).parents[1] / "weights"


def shipped_runs() -> dict[str, Path]:
    """Return the run directories that come with plat by name: the folder's, and that of the policy's robot.

    >>> sorted(shipped_runs())
    [..., 'plat-g1', 'plat-generated-g1']
    """
    configs = {path.parent: read_json(path) for path in sorted(_WEIGHTS.glob(f"*/{CONFIG_FILE}"))}
    return {f"{folder.name}-{config['policy']['robot']}": folder for folder, config in configs.items()}


def is_run(folder: Path) -> bool:
    """Return whether a directory holds a run, finished or not.

    >>> is_run(Path("/nowhere"))
    False
    """
    return os.path.exists(folder / CONFIG_FILE)


def read_config(folder: Path) -> dict[str, Any]:
    """Return the ``config.json`` of a run directory; one that does not say its format or version is of the first.

    Raises:
        CheckpointError: naming the file, when it is missing, broken, or of a format or version that is not read.
    """
    path = folder / CONFIG_FILE
    config = read_json(path)
    if config.get("format", FORMAT) != FORMAT:
        raise CheckpointError(f"{str(path)!r}: format is {short(config['format'])}, expected {FORMAT!r}")
    if fault := version_fault(config.get("version", VERSION), VERSION):
        raise CheckpointError(f"{str(path)!r}: version {fault}")
    return config


def run_folder(run: str | Path) -> Path:
    """Return a run directory by its path, or by the name of weights that come with plat where no such folder is.

    ``"hf:owner/name"`` is downloaded from the Hugging Face Hub, see :func:`plat.runs.download_run`.

    Raises:
        CheckpointError: for what is none of these, with the names.

    >>> run_folder("plat-g1").name
    'plat'
    """
    path = as_path(run, "run", CheckpointError)
    if os.path.exists(path):  # false for a name that is too long, too
        return path
    if name := hub_name(path):
        return download_run(name)
    shipped = shipped_runs()
    if str(run) in shipped:
        return shipped[str(run)]
    known = ", ".join(shipped) or "none, this installation has no weights"
    raise CheckpointError(f"{str(run)!r}: no such run directory; weights that come with plat: {known}")
