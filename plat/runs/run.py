"""Run directory: what training writes, and how a run resumes after it was killed.

====================  ====================================================================================
``config.json``       all settings of the recipe, the policy's description, and settings of earlier parts of the run
``model.safetensors`` the policy's weights at the last checkpoint
``metrics.csv``       one row an iteration
``checkpoints/``      everything that a resumed run needs; the last two are kept
``wandb/``            with ``--wandb``, and ``videos/``
====================  ====================================================================================
"""

import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from pydantic import TypeAdapter
from torch import nn
from torchrl.checkpoint import (
    Checkpoint,
    CheckpointRotation,
    GlobalRNGState,
    StateDictCheckpointAdapter,
)
from torchrl.checkpoint import CheckpointError as TorchRLCheckpointError

from plat.errors import CheckpointError
from plat.runs.budget import Budget
from plat.runs.json_object import read_json, write_json
from plat.runs.loggers import LoggerName, check_logger, log_video, start_logging
from plat.runs.metrics import MetricsFile
from plat.runs.policies import complete_spec, policy_spec
from plat.runs.saved_run import CONFIG_FILE, WEIGHTS_FILE, save_weights
from plat.version import __version__

__all__ = ["Run"]


class Run:
    """Writer of a training run into a directory, from which it can be resumed.

    Args:
        folder: the directory.
        recipe: a dataclass with the settings of the run.
        policy: the policy in training; its weights go to ``model.safetensors``.
        budget: counts steps and time.
        state: by name, everything else that a resumed run needs (critic, optimizer, buffer, environment ...): objects
            with ``state_dict`` and ``load_state_dict``. The random number generators are included.
        resume: go on from the last checkpoint in ``folder``.
        save_every: seconds between checkpoints.
        loggers: experiment loggers that metrics and videos are logged to.
        film: makes a video of the policy as it is at a step, when one is due, for the loggers.

    Raises:
        CheckpointError: when the directory already holds a run and ``resume`` is False, or the run in it was of
            another policy, or cannot be read.
    """

    def __init__(
        self,
        folder: Path,
        *,
        recipe: Any,
        policy: nn.Module,
        budget: Budget,
        state: Mapping[str, Any],
        resume: bool = False,
        save_every: float = 120.0,
        loggers: Sequence[LoggerName] = (),
        film: Callable[[int], Path | None] | None = None,
    ):
        for logger in loggers:
            check_logger(logger)  # checked first: a missing logger must not leave half a run behind
        self.folder = folder
        self.policy = policy
        self.budget = budget
        self._save_every = save_every
        config_path = folder / CONFIG_FILE
        self._rotation = CheckpointRotation(folder / "checkpoints", keep_last=2)
        # plain files in torch's own format, read back with weights_only: a full disk is then an error and not a
        # crash, and loading runs no code
        adapter = StateDictCheckpointAdapter(payload_format="torch")
        self._checkpoint = Checkpoint()
        for name, component in {"policy": policy, "budget": budget, "random": GlobalRNGState(), **state}.items():
            self._checkpoint.register(name, component, adapter=adapter)
        config = {
            "format": "plat-run",
            "version": 1,
            "policy": policy_spec(policy),
            "recipe": {
                "name": getattr(type(recipe), "name", Path(sys.argv[0]).stem),
                # as any: a task or config of the user's own class is written with the fields that it adds
                "settings": TypeAdapter(type(recipe)).dump_python(recipe, mode="json", serialize_as_any=True),
            },
            "made_with": {"plat": __version__, "torch": torch.__version__, "commit": _commit()},
        }
        if resume and config_path.exists():
            self._restore(config)
        elif config_path.exists():
            raise CheckpointError(f"{str(folder)!r} already holds a run: go on with --resume or choose another --out")
        else:
            write_json(config_path, config)
        for leftover in (folder / "checkpoints").glob(".*"):  # unfinished checkpoint of a killed run
            shutil.rmtree(leftover, ignore_errors=True)
        self._metrics = MetricsFile(folder / "metrics.csv", keep_until=budget.steps)
        self._tracked = [start_logging(logger, folder.name, folder, config) for logger in loggers]
        self._film = film
        self._last_save = time.monotonic()
        self._last_line = 0.0

    def _restore(self, config: Mapping[str, Any]) -> None:
        path = self.folder / CONFIG_FILE
        before = read_json(path)
        if complete_spec(before.get("policy"), path) != config["policy"]:
            raise CheckpointError(
                f"{str(path)!r}: the run was of another policy ({before.get('policy')}), "
                f"which does not fit {config['policy']}; resume with the settings it was started with"
            )
        latest = self._rotation.latest()
        if latest is None:
            return  # killed before its first checkpoint
        try:
            self._checkpoint.load(latest, map_location="cpu")
        except (TorchRLCheckpointError, OSError, RuntimeError, ValueError, KeyError) as error:
            raise CheckpointError(f"{str(latest)!r}: this checkpoint cannot be resumed from ({error})") from error
        print(f"resumed from {latest} at {self.budget.steps:,} steps", flush=True)
        part = {key: before[key] for key in ("recipe", "made_with") if key in before}
        earlier = [*before.get("earlier", []), {"until_step": self.budget.steps, **part}]
        write_json(path, {**config, "earlier": earlier})

    def log(self, metrics: Mapping[str, float], headline: Mapping[str, str] | None = None) -> None:
        """Write a row of metrics; from time to time also a line on screen and a checkpoint.

        Args:
            metrics: numbers for the file.
            headline: metrics on the screen line, beside progress, rate and time to go.
        """
        self._metrics.write(self.budget.steps, {"seconds": self.budget.seconds, **metrics})
        for run in self._tracked:
            run.log(dict(metrics), step=self.budget.steps)
        if self._tracked and self._film is not None and (video := self._film(self.budget.steps)) is not None:
            for run in self._tracked:
                log_video(run, video, self.budget.steps)
        now = time.monotonic()
        if now - self._last_line >= 5 or self.budget.done:
            self._last_line = now
            shown = "  ".join(f"{name} {value}" for name, value in (headline or {}).items())
            print(
                f"{min(1.0, self.budget.fraction):4.0%}  {self.budget.steps / 1e6:.2f} M steps  "
                f"{self.budget.rate:,.0f}/s  {shown}  {_clock(self.budget.seconds_left)} to go",
                flush=True,
            )
        if now - self._last_save >= self._save_every:
            self.save()

    def save(self) -> None:
        """Write a checkpoint and the policy's weights.

        Raises:
            CheckpointError: when the disk does not take them; the checkpoint before is intact.
        """
        try:
            self._rotation.save(self._checkpoint, step=self.budget.steps)
        except (OSError, RuntimeError) as error:
            raise CheckpointError(
                f"{str(self._rotation.directory)!r}: a checkpoint could not be written ({error}); "
                "the one before it is intact, go on from it with --resume"
            ) from error
        save_weights(self.folder / WEIGHTS_FILE, self.policy)
        self._last_save = time.monotonic()

    def finish(self) -> None:
        """Write the last checkpoint, record the progress of training in ``config.json`` and close the logs."""
        self.save()
        path = self.folder / CONFIG_FILE
        write_json(path, {**read_json(path), "finished": self.budget.state_dict()})
        for run in self._tracked:
            run.finish()


def _clock(seconds: float) -> str:
    if seconds == float("inf"):
        return "?"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02d}"


def _commit() -> str | None:
    """Return the commit of the source tree, where there is one."""
    command = ["git", "-C", str(Path(__file__).parent), "rev-parse", "HEAD"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=5).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return None
