"""Saved run: its settings, policy, weights and scores."""

import csv
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor, nn
from torch.nn.parameter import is_lazy

from plat.errors import CheckpointError
from plat.files import readable, replace_file
from plat.gpu import check_device
from plat.json_file import short
from plat.runs.hub import repository_name
from plat.runs.locate import CONFIG_FILE, is_run, read_config, run_folder
from plat.runs.outputs import WEIGHTS_FILE
from plat.runs.policies import Policy, build_policy

__all__ = ["CONFIG_FILE", "SCORES_FILE", "WEIGHTS_FILE", "RunScore", "SavedRun", "load_policy", "save_weights"]

SCORES_FILE = "evaluation.csv"
P = TypeVar("P")
# a table of hundreds of policies
_MOST_BYTES = 16 << 20
_FIGURES = ("value", "low", "high")


class RunScore(NamedTuple):
    """Metric of an evaluation, with its 95 % interval over motions."""

    horizon: str
    metric: str
    value: float
    low: float
    high: float


class SavedRun:
    """Run directory whose files are read once each.

    Args:
        folder: the directory, or a name of weights that come with plat, such as ``"plat-g1"``.

    Raises:
        CheckpointError: at construction when ``config.json`` cannot be read or is of a newer version, and later, naming
            file and field, when what is asked for is missing or broken.

    >>> run = SavedRun("plat-g1")
    >>> run.name, run.kind, run.steps
    ('plat', 'residual_latent', 1138688)
    """

    def __init__(self, folder: str | Path):
        self.folder = run_folder(folder)
        self.config = read_config(self.folder)

    @property
    def name(self) -> str:
        """Return the name of the directory; of a run from the Hugging Face Hub that of its repository."""
        folder = self.folder.resolve()
        return readable(repository_name(folder) or folder.name)

    @property
    def kind(self) -> str | None:
        """Return the kind of the policy, see :func:`plat.runs.register_policy`; None where there is no policy."""
        return self._object("policy").get("kind")

    @property
    def robot(self) -> str | None:
        """Return the name of the robot that the policy drives."""
        return self._object("policy").get("robot")

    @property
    def recipe(self) -> str | None:
        """Return the name of the recipe that made the run."""
        name = self._object("recipe").get("name")
        return name if isinstance(name, str) else None

    @property
    def settings(self) -> dict[str, Any]:
        """Return the settings of the recipe."""
        settings = self._object("recipe").get("settings")
        return settings if isinstance(settings, dict) else {}

    @property
    def averaged(self) -> list[dict[str, Any]]:
        """Return what is known of each run that this one is the mean of or was made of; none for a trained one."""
        average = self.config.get("average")
        return [part for part in average if isinstance(part, dict)] if isinstance(average, list) else []

    @property
    def motions(self) -> list[str]:
        """Return the motions that the run was trained on; of a mean of runs, those of all of them that are known.

        Raises:
            CheckpointError: naming file and field, for motions that are no list of names.
        """
        found: dict[str, None] = {}
        for name, one in [("recipe.settings", self.settings), *(("average", part) for part in self.averaged)]:
            motions = one.get("motions")
            if not isinstance(motions, list | None) or not all(isinstance(motion, str) for motion in motions or ()):
                raise CheckpointError(
                    f"{str(self.folder / CONFIG_FILE)!r}: {name}.motions is {short(motions)}, expected a list of names"
                )
            found |= dict.fromkeys(motions or ())
        return list(found)

    @property
    def made_with(self) -> dict[str, Any]:
        """Return the versions of plat and torch, and the commit of plat's sources."""
        return self._object("made_with")

    @property
    def steps(self) -> int:
        """Return the environment steps of a finished run; 0 for one that is not finished."""
        steps = self._object("finished").get("steps", 0)
        return steps if isinstance(steps, int) else 0

    @property
    def seconds(self) -> float:
        """Return the seconds of training of a finished run; 0 for one that is not finished."""
        seconds = self._object("finished").get("seconds", 0.0)
        return float(seconds) if isinstance(seconds, int | float) else 0.0

    @property
    def unfinished(self) -> bool:
        """Return whether a recipe wrote the run and did not come to its end: its weights are of the way there."""
        return self.recipe is not None and "finished" not in self.config

    def _object(self, name: str) -> dict[str, Any]:
        value = self.config.get(name)
        return value if isinstance(value, dict) else {}

    def policy(self, device: torch.device | str = "cpu") -> Policy:
        """Return the policy with its weights, in evaluation mode.

        Raises:
            CheckpointError: when it cannot be read.
            ConfigError: for a device that this machine does not have.
        """
        device = check_device(device)
        config_path, path = self.folder / CONFIG_FILE, self.folder / WEIGHTS_FILE
        policy = build_policy(self.config.get("policy", {}), config_path)
        assert isinstance(policy, nn.Module)
        policy.load_state_dict(self._weights(path, policy.state_dict()))
        return policy.to(device).eval()

    def policy_as(self, policy_class: type[P], expected: str, device: torch.device | str = "cpu") -> P:
        """Return the policy if it is an instance of a class or satisfies a protocol.

        Args:
            policy_class: the class or protocol.
            expected: description for the message, such as ``"an expert, of plat expert"``.
            device: device of the weights.

        Raises:
            CheckpointError: when the run holds another policy, or cannot be read.
        """
        policy = self.policy(device)
        if not isinstance(policy, policy_class):
            raise CheckpointError(f"{str(self.folder)!r} holds a policy of kind {self.kind!r}, expected {expected}")
        return policy

    def _weights(self, path: Path, expected: dict[str, Tensor]) -> dict[str, Tensor]:
        if not path.is_file():
            raise CheckpointError(f"{str(path)!r}: no such file; has the run saved a checkpoint yet?")
        try:
            weights = load_file(path)
        except (OSError, RuntimeError, SafetensorError, ValueError, KeyError) as error:
            told = str(error).strip().partition("\n")[0]
            raise CheckpointError(f"{str(path)!r}: not a readable safetensors file ({told})") from error
        missing, unknown = sorted(set(expected) - set(weights)), sorted(set(weights) - set(expected))
        if missing or unknown:
            raise CheckpointError(
                f"{str(path)!r}: lacks {short(missing[:3])} and has the unknown {short(unknown[:3])} "
                f"({len(missing)} missing, {len(unknown)} unknown), expected the weights of a {self.kind!r} policy"
            )
        for name, tensor in expected.items():
            # a lazy layer of a user's policy takes the size of the weights that it is given
            if not is_lazy(tensor) and weights[name].shape != tensor.shape:
                raise CheckpointError(
                    f"{str(path)!r}: {name!r} has shape {tuple(weights[name].shape)}, "
                    f"expected {tuple(tensor.shape)} by the sizes in config.json"
                )
            if not torch.isfinite(weights[name]).all():
                raise CheckpointError(
                    f"{str(path)!r}: {name!r} holds NaN or infinity: the run diverged, take an earlier one"
                )
        return weights

    @cached_property
    def scores(self) -> tuple[RunScore, ...] | None:
        """Return the policy's scores from ``evaluation.csv`` in the directory or beside it; None where there are none.

        In a table with several policies, rows are matched by the directory's name, or by the run's original name. In a
        table beside the directory, the original name counts only if no other run has it now. A table in the directory
        that holds a single policy belongs to this run, whatever its name. Rows of other than the usual conditions, such
        as partial keyframes, are left out.
        """
        own = _read_scores(self.folder / SCORES_FILE)
        shared = _read_scores(self.folder.resolve().parent / SCORES_FILE)
        # an average has the settings of its last run, and acts otherwise
        made_as = "" if "average" in self.config else Path(str(self.settings.get("out", ""))).name
        # where another run has the original name now, rows beside it are that one's
        taken = is_run(self.folder.resolve().parent / made_as)
        for table, names in ((own, (self.name, made_as)), (shared, (self.name,) if taken else (self.name, made_as))):
            for name in names:
                if name in table:
                    return table[name]
        return next(iter(own.values())) if len(own) == 1 else None


def _read_scores(path: Path) -> dict[str, tuple[RunScore, ...]]:
    """Return the scores in a table by the name of the policy; empty where there is none."""
    if not path.is_file():
        return {}
    if path.stat().st_size > _MOST_BYTES:
        raise CheckpointError(f"{str(path)!r}: {path.stat().st_size / 1e6:.0f} MB, expected a table of scores")
    scores: dict[str, list[RunScore]] = {}
    try:
        with path.open(newline="", encoding="utf-8") as file:
            for row in csv.DictReader(file):
                if row.get("conditions"):
                    continue
                score = RunScore(row["horizon"], row["metric"], *(float(row[figure]) for figure in _FIGURES))
                scores.setdefault(row["policy"], []).append(score)
    except (OSError, ValueError, KeyError, TypeError, csv.Error) as error:
        raise CheckpointError(f"{str(path)!r}: not a table of plat evaluate --csv ({short(error)})") from None
    return {policy: tuple(rows) for policy, rows in scores.items()}


def load_policy(run: str | Path, device: torch.device | str = "cpu") -> Policy:
    """Return the policy of a run directory, in evaluation mode.

    Raises:
        CheckpointError: naming file and field, when something is missing, broken or of another robot.
    """
    return SavedRun(run).policy(device)


def save_weights(path: Path, module: nn.Module) -> None:
    """Write a module's weights; the file at ``path`` is replaced atomically or not at all.

    A parameter that several parts share, such as a codebook, is written once for each of them.

    Raises:
        CheckpointError: when the disk does not take them; what was there before is intact.
    """
    weights: dict[str, Tensor] = {}
    storages: set[int] = set()
    for name, tensor in module.state_dict().items():
        weight = tensor.detach().cpu().contiguous()
        storage = weight.untyped_storage().data_ptr()
        weights[name] = weight.clone() if storage in storages else weight  # the format refuses shared memory
        storages.add(storage)
    try:
        replace_file(path, lambda part: save_file(weights, part))
    except (OSError, SafetensorError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or error
        raise CheckpointError(f"{str(path)!r} could not be written ({reason}); the file before it is intact") from error
