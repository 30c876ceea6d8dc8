"""Run directory: what training writes, and how a run resumes after it was killed.

====================  ====================================================================================
``config.json``       all settings of the recipe, the policy's description, and settings of earlier parts of the run
``inputs.json``       fingerprints of motions, robot and other weights that the run depends on
``model.safetensors`` the policy's weights at the last checkpoint
``metrics.csv``       one row an iteration
``checkpoints/``      everything that a resumed run needs, with hashes; the last two are kept
``.lock``             held by the process that trains
``wandb/``            with ``--wandb``, and ``videos/``
====================  ====================================================================================
"""

import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from types import TracebackType
from typing import Annotated, Any, NoReturn

import torch
from pydantic import Field, FiniteFloat, NonNegativeInt
from torch import nn
from torchrl.checkpoint import GlobalRNGState

from plat.errors import CheckpointError, ConfigError
from plat.files import clear_parts
from plat.progress import percent
from plat.runs.budget import Budget
from plat.runs.changes import compared, name_of, settings_of
from plat.runs.checkpoints import Checkpoints, UnfitCheckpointError
from plat.runs.interrupts import StopSignal
from plat.runs.json_object import entry, plain, read_json, write_json
from plat.runs.locate import FORMAT, VERSION, read_config
from plat.runs.lock import LOCK_FILE, RunLock
from plat.runs.loggers import ID_FILE, LoggerName, check_logger, keep_id, log_video, logging_id, start_logging
from plat.runs.metrics import MetricsFile
from plat.runs.outputs import CHECKPOINTS, INPUTS_FILE, check_out
from plat.runs.policies import check_rebuilt, complete_spec, policy_spec
from plat.runs.recipe import RecipeConfig
from plat.runs.saved_run import CONFIG_FILE, WEIGHTS_FILE, SavedRun, save_weights
from plat.version import __version__
from plat.words import counted

__all__ = ["Run"]

_METRICS_FILE = "metrics.csv"


@dataclass
class _Finished:
    """Entry ``finished`` of a ``config.json``."""

    steps: NonNegativeInt
    seconds: Annotated[FiniteFloat, Field(ge=0)]


class Run:
    """Writer of a training run into a directory, from which it can be resumed.

    A resumed run ends as if it had never been interrupted, if the budget is in steps and ``state`` holds all that the
    next iteration depends on. Use it as a context: Ctrl-C then stops after the iteration, with a checkpoint.

    Args:
        folder: the directory.
        recipe: a dataclass with the settings of the run.
        policy: the policy in training; its weights go to ``model.safetensors``. One with parts of its own is a
            subclass that :func:`plat.runs.register_policy` was given.
        budget: counts steps and time.
        state: by name, everything else that a resumed run needs (critic, optimizer, buffer, rollouts ...): objects
            with ``state_dict`` and ``load_state_dict``. The random number generators are included. States are of
            tensors, numbers, texts, lists and dictionaries: reading them runs no code.
        inputs: fingerprints of what the run depends on beside its settings, see :func:`plat.runs.run_inputs`.
        modules: further modules whose weights are written beside the policy's, by file name.
        resume: go on from the last checkpoint in ``folder``.
        save_every: seconds between checkpoints.
        loggers: experiment loggers that metrics and videos are logged to.
        film: makes a video of the policy as it is at a step, when one is due, for the loggers.

    Attributes:
        finished: whether the run was finished before, and has no more to do.

    Raises:
        CheckpointError: when the directory already holds a run and ``resume`` is False, or holds none and it is True;
            when the policy would be loaded with other parts than it has; when another process trains into it; when
            settings, inputs or policy are others than the run was started with, except for budget and learning rates;
            or when no checkpoint can be read.
        ConfigError: for a state that has no ``state_dict``, and one or a file that takes the place of the policy's.
    """

    @classmethod
    def of(cls, recipe: RecipeConfig, **settings: Any) -> "Run":
        """Return the run of a recipe: in its folder, with its checkpoints and loggers.

        Args:
            recipe: the settings.
            settings: what else :class:`Run` takes.
        """
        return cls(
            recipe.out,
            recipe=recipe,
            resume=recipe.resume,
            save_every=recipe.save_every,
            loggers=recipe.loggers,
            **settings,
        )

    def __init__(
        self,
        folder: str | Path,
        *,
        recipe: Any,
        policy: nn.Module,
        budget: Budget,
        state: Mapping[str, Any],
        inputs: Mapping[str, Any] | None = None,
        modules: Mapping[str, nn.Module] | None = None,
        resume: bool = False,
        save_every: float = 120.0,
        loggers: Sequence[LoggerName] = (),
        film: Callable[[int], Path | None] | None = None,
    ):
        for logger in loggers:
            check_logger(logger)  # checked first: a missing logger must not leave half a run behind
        folder = Path(folder)
        self.folder = folder
        self.policy = policy
        self.budget = budget
        self.finished = False
        self._recipe = recipe
        self._save_every = save_every
        self._film = film
        self._modules = _together({WEIGHTS_FILE: policy}, modules or {}, "modules")
        own = {"policy": policy, "budget": budget, "random": GlobalRNGState()}
        self._checkpoints = Checkpoints(folder / CHECKPOINTS, _together(own, state, "state"))
        config = plain(
            {
                "format": FORMAT,
                "version": VERSION,
                "policy": policy_spec(policy),
                "recipe": {"name": name_of(recipe), "settings": settings_of(recipe)},
                "made_with": {"plat": __version__, "torch": torch.__version__, "commit": _commit()},
            }
        )
        check_out(folder, resume=resume)
        made = not folder.exists()
        self._lock = RunLock(folder)
        self._stop = StopSignal()
        try:
            check_out(folder, resume=resume)  # once more: now nobody else can begin one
        except CheckpointError:
            self._lock.release()
            raise
        try:
            self._checkpoints.clear_leftovers()
            clear_parts(folder)
            self._inputs = plain(dict(inputs or {}))
            if resume:
                self._restore(config, self._inputs)
            else:
                self._begin(config, self._inputs)
            self._metrics = MetricsFile(folder / _METRICS_FILE, keep_until=budget.steps)
            # loggers take no row back: what follows on rows that were dropped is a run of its own there
            if self._metrics.dropped:
                (folder / ID_FILE).unlink(missing_ok=True)
            self._logging_id = logging_id(folder, resume) if loggers else None
            self._tracked = [start_logging(logger, folder.name, folder, config, self._logging_id) for logger in loggers]
            for step, metrics in self._metrics.rows() if self._metrics.dropped else ():
                self._track(step, metrics)
        except BaseException:
            if not resume:
                self._clear()
            self._lock.release()  # after that another process may begin here
            if made and not resume and [path.name for path in folder.iterdir()] == [LOCK_FILE]:
                (folder / LOCK_FILE).unlink()
                folder.rmdir()
            raise
        self._last_save = time.monotonic()
        self._last_line = 0.0
        self._unwritten = False
        """Whether the directory is to be begun anew, and the disk did not take it so far."""

    def __enter__(self) -> "Run":
        self._stop.__enter__()
        self.budget.begin()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None and self._stop.asked and self.finished:  # what was said is that it stops
            print(f"{str(self.folder)!r}: the run is finished, with {counted(self.budget.steps, 'step')}", flush=True)
        self._stop.__exit__(kind, error, trace)
        self._lock.release()
        if kind is None and self._stop.asked:  # while the run ended: what would follow is not wanted either
            sys.exit(self._stop.status)

    def _begin(self, config: Mapping[str, Any], inputs: Mapping[str, Any]) -> None:
        with _same_randomness():
            check_rebuilt(self.policy, config["policy"], self.folder / CONFIG_FILE)
        for name in (_METRICS_FILE, ID_FILE):  # of a start that did not get to a checkpoint
            (self.folder / name).unlink(missing_ok=True)
        write_json(self.folder / INPUTS_FILE, inputs)
        write_json(self.folder / CONFIG_FILE, config)
        self._config = config

    def _clear(self) -> None:
        """Remove what a start that failed has written."""
        for name in (CONFIG_FILE, INPUTS_FILE, _METRICS_FILE, ID_FILE):
            (self.folder / name).unlink(missing_ok=True)

    def _restore(self, config: dict[str, Any], inputs: Mapping[str, Any]) -> None:
        path = self.folder / CONFIG_FILE
        before = read_config(self.folder)
        if not self._checkpoints.all() and not (self.folder / WEIGHTS_FILE).exists():
            print(f"{str(self.folder)!r}: the run has no checkpoint yet, it starts over", flush=True)
            self._begin(config, inputs)
            return
        changed = self._check_changes(before, config, inputs)
        earlier = entry(before, "earlier", list[dict[str, Any]], path) or []
        ended = entry(before, "finished", _Finished, path)
        if ended is not None:
            self.budget.load_state_dict(asdict(ended))
            self.finished = self.budget.done
        if self.finished:
            print(
                f"{str(self.folder)!r}: the run is finished, with {counted(self.budget.steps, 'step')}; "
                "it goes on with more --steps or --minutes",
                flush=True,
            )
            if (self.folder / WEIGHTS_FILE).exists():
                self.policy.load_state_dict(SavedRun(self.folder).policy_as(nn.Module, "weights").state_dict())
            return
        try:
            latest = self._checkpoints.load()
        except UnfitCheckpointError as error:
            made, now = _maker(before.get("made_with")), _maker(config["made_with"])
            if made == now:
                raise
            raise CheckpointError(
                f"{error}; {made} wrote it, and this is {now}: go on with that one, or start another run with --init "
                "where the recipe has it"
            ) from error
        if latest is None:
            raise CheckpointError(
                f"{str(self.folder)!r}: the run has weights but no checkpoint to go on from; start another one with "
                "--init where the recipe has it"
            )
        print(f"resumed from {latest} at {counted(self.budget.steps, 'step')}", flush=True)
        for name, (old, new) in changed.items():
            print(f"goes on with {name} {new} in place of {old}", flush=True)
        part = {key: before[key] for key in ("recipe", "made_with") if key in before}
        earlier = [*earlier, {"until_step": self.budget.steps, "changed": changed, **part}]
        self._config = {**config, "earlier": earlier}
        try:
            write_json(path, self._config)
        except CheckpointError as error:  # a full disk: training goes on, the settings are those of before in all else
            print(f"not written down: {error}", flush=True)

    def _check_changes(
        self, before: Mapping[str, Any], config: Mapping[str, Any], inputs: Mapping[str, Any]
    ) -> dict[str, tuple[Any, Any]]:
        """Return the settings that differ and may; raise CheckpointError naming those that may not."""
        free, wrong = compared(self.folder, before, self._recipe, inputs)
        if wrong:
            raise CheckpointError(
                f"{str(self.folder)!r} cannot be resumed: {wrong}. Budget and learning rates may "
                "change; resume with the other settings as they were, or choose another --out"
            )
        path = self.folder / CONFIG_FILE
        if complete_spec(before.get("policy"), path) != config["policy"]:
            raise CheckpointError(
                f"{str(path)!r}: the run was of another policy ({before.get('policy')}), "
                f"which does not fit {config['policy']}; resume with the settings it was started with"
            )
        return free

    def log(self, metrics: Mapping[str, float], headline: Mapping[str, str] | None = None) -> None:
        """Write a row of metrics; from time to time also a line on screen and a checkpoint.

        Call it at the end of an iteration: what a checkpoint holds is the state between two of them. A disk that does
        not take a checkpoint does not end training.

        Args:
            metrics: numbers for the file.
            headline: metrics on the screen line, beside progress, rate and time to go.
        """
        self._stay()
        self._metrics.write(self.budget.steps, {"seconds": self.budget.seconds, **metrics})
        self._track(self.budget.steps, metrics)
        if self._tracked and self._film is not None:
            self._take_film(self._film)
        now = time.monotonic()
        if now - self._last_line >= 5 or self.budget.done:
            self._last_line = now
            shown = "  ".join(f"{name} {value}" for name, value in (headline or {}).items())
            print(
                f"{percent(self.budget.fraction):>5}  {self.budget.steps / 1e6:.2f} M steps  "
                f"{self.budget.rate:,.0f}/s  {shown}  {_clock(self.budget.seconds_left)} to go",
                flush=True,
            )
        if self._stop.asked and not self.budget.done:
            self._stop_here()
        if now - self._last_save >= self._save_every:
            try:
                self.save()
            except CheckpointError as error:
                self._last_save = time.monotonic()
                print(f"training goes on without a checkpoint: {error}", flush=True)

    def _track(self, step: int, metrics: Mapping[str, float]) -> None:
        for run in self._tracked:
            run.log(dict(metrics), step=step)

    def _stay(self) -> None:
        """Begin the directory anew where it was moved or removed: half a run would be written otherwise.

        A disk that does not take it is asked again the next time.

        Raises:
            CheckpointError: when another process has begun a run there, or a folder that holds another run took its
                place.
        """
        if self._lock.is_there() and not self._unwritten:
            return
        try:
            if not self._lock.is_there():
                self._lock.release()
                self._lock = RunLock(self.folder)
                self._check_replaced()
                told = f"{str(self.folder)!r} was moved or removed: the run goes on in a new folder of that name"
                print(told, flush=True)
            write_json(self.folder / INPUTS_FILE, self._inputs)
            write_json(self.folder / CONFIG_FILE, self._config)
            if self._logging_id is not None:
                keep_id(self.folder, self._logging_id)
        except CheckpointError as error:
            if not isinstance(error.__cause__, OSError):
                raise
            if not self._unwritten:
                print(f"training goes on without its folder: {error}", flush=True)
            self._unwritten = True
            return
        self._unwritten = False
        self._metrics.rewrite()
        self._last_save = float("-inf")  # nothing else could be resumed there

    def _check_replaced(self) -> None:
        """Check that no other run with a checkpoint took the directory's place; a copy of this one may.

        Raises:
            CheckpointError: when one did; nothing of it is touched.
        """
        try:
            check_out(self.folder, resume=False)
        except CheckpointError as error:
            with suppress(CheckpointError):
                if read_json(self.folder / CONFIG_FILE) == plain(self._config):
                    return
            raise CheckpointError(
                f"the folder was replaced while it was trained into: {error}; this run ends, and goes on with --resume "
                "from where its own folder is now"
            ) from None

    def _take_film(self, film: Callable[[int], Path | None]) -> None:
        with self.budget.paused():
            with _same_randomness():  # whether a video is due depends on the clock
                video = film(self.budget.steps)
            if video is not None:
                for run in self._tracked:
                    log_video(run, video, self.budget.steps)

    def _stop_here(self) -> NoReturn:
        """Save and end the program."""
        try:
            self.save()
            print(f"stopped with a checkpoint at {counted(self.budget.steps, 'step')}", flush=True)
        except CheckpointError as error:
            print(f"stopped: {error}", flush=True)
        self._metrics.close()
        # plat demo and plat ablations have no --resume: they go on when they are started again
        print(f"go on with the same command, and --resume where it has that (--out {self.folder})", flush=True)
        self._end_logs()
        sys.exit(self._stop.status)

    def save(self) -> None:
        """Write a checkpoint and the weights.

        Raises:
            CheckpointError: when the disk does not take them; the checkpoint before is intact.
        """
        self._stay()
        with self.budget.paused():
            try:
                self._checkpoints.save(self.budget.steps)
            except CheckpointError:
                # a disk that is full for a checkpoint may take weights, which are small
                with suppress(CheckpointError):
                    self._save_weights()
                raise
            self._save_weights()
        self._last_save = time.monotonic()

    def _save_weights(self) -> None:
        for name, module in self._modules.items():
            save_weights(self.folder / name, module)

    def finish(self) -> None:
        """Write the last checkpoint, record the progress of training in ``config.json`` and close the logs.

        Nothing is written for a run that was finished before.
        """
        if not self.finished:
            self.save()
            path = self.folder / CONFIG_FILE
            write_json(path, {**read_json(path), "finished": self.budget.state_dict()})
        self.finished = True
        self._metrics.close()
        self._end_logs()
        self._lock.release()

    def _end_logs(self) -> None:
        for run in self._tracked:
            run.finish()


def _together(own: Mapping[str, Any], given: Mapping[str, Any], what: str) -> dict[str, Any]:
    """Return what a run keeps of its own and what it is given to keep.

    Raises:
        ConfigError: naming what would replace something of its own, or cannot be kept.
    """
    for name, kept in given.items():
        if own.get(name, kept) is not kept:
            raise ConfigError(f"run: {what} has {name!r}, which the run keeps itself; expected another name")
        if not (hasattr(kept, "state_dict") and hasattr(kept, "load_state_dict")):
            told = f"is a {type(kept).__name__}, expected an object with state_dict() and load_state_dict()"
            raise ConfigError(f"run: {what} {name!r} {told}")
    return {**own, **given}


@contextmanager
def _same_randomness() -> Iterator[None]:
    """Leave the random number generators, as a context, as they were."""
    generators = GlobalRNGState()
    before = generators.state_dict()
    try:
        yield
    finally:
        generators.load_state_dict(before)


def _clock(seconds: float) -> str:
    if seconds == float("inf"):
        return "?"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02d}"


def _maker(made_with: Any) -> str:
    """Return the name of the version that a run was made with."""
    facts = made_with if isinstance(made_with, Mapping) else {}
    commit = facts.get("commit")
    return f"plat {facts.get('plat', 'of an unknown version')}{f' ({commit[:9]})' if isinstance(commit, str) else ''}"


def _commit() -> str | None:
    """Return the commit of the source tree, where there is one."""
    command = ["git", "-C", str(Path(__file__).parent), "rev-parse", "HEAD"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=5).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return None
