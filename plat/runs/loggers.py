"""Experiment logging with Weights & Biases or trackio, which share an interface.

Both are extras, imported only when asked for: ``pip install 'plat-rl[wandb]'`` or ``'plat-rl[trackio]'``.
"""

import importlib
import os
import secrets
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, Literal

from plat.errors import CheckpointError, PlatError
from plat.extras import importing
from plat.files import replace_file

__all__ = [
    "ID_FILE",
    "LoggerName",
    "check_logger",
    "chosen_loggers",
    "keep_id",
    "log_table",
    "log_video",
    "logging_id",
    "start_logging",
]

LoggerName = Literal["wandb", "trackio"]
"""An experiment logger."""

ID_FILE = "logging_id"
"""Name of the file that tells a training from others of its name."""


def check_logger(logger: LoggerName) -> ModuleType:
    """Return an experiment logger's module.

    Raises:
        PlatError: if it isn't installed, with the command that installs it.
    """
    with importing(logger, f"--{logger} needs"):
        return importlib.import_module(logger)


def chosen_loggers(wandb: bool, trackio: bool) -> tuple[LoggerName, ...]:
    """Return the names of the experiment loggers that two flags ask for."""
    asked: dict[LoggerName, bool] = {"wandb": wandb, "trackio": trackio}
    return tuple(name for name, wanted in asked.items() if wanted)


def logging_id(folder: Path, resume: bool) -> str:
    """Return what tells a training from all others of its name, kept in its folder: a new one, unless it is resumed.

    Args:
        folder: of the training.
        resume: return the one that the folder has, if it has one.
    """
    path = folder / ID_FILE
    if not (resume and path.exists()):
        keep_id(folder, secrets.token_hex(4))
    return path.read_text(encoding="utf-8").strip()


def keep_id(folder: Path, run_id: str) -> None:
    """Write what tells a training from all others of its name into its folder.

    Raises:
        CheckpointError: when the disk does not take it.
    """
    try:
        replace_file(folder / ID_FILE, lambda part: part.write_text(run_id, encoding="utf-8"))
    except OSError as error:
        raise CheckpointError(f"{str(folder / ID_FILE)!r} could not be written ({error.strerror})") from error


def start_logging(
    logger: LoggerName, name: str, folder: Path, config: Mapping[str, Any], run_id: str | None = None
) -> Any:
    """Start a run of an experiment logger, or go on with one.

    A run of wandb is online for a user who is logged in, and offline otherwise. ``WANDB_MODE`` overrides this.

    Args:
        logger: which one.
        name: of the run; the project is ``"plat"``.
        folder: wandb keeps its files here.
        config: settings that are shown with the run.
        run_id: a run that has it already is gone on with; None for a new one. trackio, which finds runs by name,
            shows it behind the name.

    Returns:
        An object with ``log(entries, step=)`` and ``finish()``. A run of wandb is a context manager as well.

    Raises:
        PlatError: if the logger isn't installed.
    """
    module = check_logger(logger)
    if logger == "trackio":
        full_name, resume = (name, "never") if run_id is None else (f"{name}-{run_id}", "allow")
        return module.init(project="plat", name=full_name, config=dict(config), resume=resume)
    settings: dict[str, Any] = {
        "project": "plat",
        "name": name,
        "id": run_id,
        "dir": str(folder),
        "config": dict(config),
        "resume": "allow",
    }
    # given to init: wandb reads WANDB_MODE once, when it is imported
    mode = os.environ.get("WANDB_MODE") or _credentials(module)
    try:
        return module.init(**settings, mode=mode)
    except module.errors.Error as error:
        if mode == "offline":
            raise PlatError(f"--wandb: {error}") from error
        print(f"wandb: {error}; logging offline", flush=True)
        return module.init(**settings, mode="offline")


def _credentials(wandb: ModuleType) -> str:
    try:
        return "online" if wandb.login(prompt=False, verify=False) else "offline"
    except wandb.errors.Error:  # credentials that cannot be read
        return "offline"


def log_table(
    run: Any, name: str, columns: Sequence[str], data: Sequence[Sequence[Any]], figures: Sequence[Path] = ()
) -> None:
    """Log a table and pictures.

    Args:
        run: of an experiment logger, see :func:`start_logging`.
        name: of the table.
        columns: headings.
        data: rows, one cell per column.
        figures: files. Those that end in ``.png`` are logged as ``figures/NAME``.
    """
    module = _module(run)
    table = module.Table(columns=list(columns), data=[list(row) for row in data])
    images = {f"figures/{path.stem}": module.Image(str(path)) for path in figures if path.suffix == ".png"}
    run.log({name: table, **images})


def log_video(run: Any, path: Path, step: int) -> None:
    """Log an MP4 file at a step."""
    run.log({"video": _module(run).Video(str(path), format="mp4")}, step=step)


def _module(run: Any) -> ModuleType:
    """Return the logger's module that a run belongs to."""
    return importlib.import_module(type(run).__module__.partition(".")[0])
