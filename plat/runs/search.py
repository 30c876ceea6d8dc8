"""Searches over the settings of a recipe, such as Ray Tune's: what they call for each sample."""

import contextlib
import csv
import dataclasses
import hashlib
import json
import math
import os
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from plat.errors import ConfigError
from plat.runs.locate import is_run
from plat.runs.recipe import RecipeConfig

__all__ = ["trainable", "with_settings"]

T = TypeVar("T")
R = TypeVar("R", bound=RecipeConfig)


def with_settings(settings: T, values: Mapping[str, Any]) -> T:
    """Return settings with other values of some fields, which are called as on the command line.

    Args:
        settings: dataclass, which may hold others.
        values: by name, such as ``"ppo.lr"``.

    Raises:
        ConfigError: for a field that there is not, or a value that makes no sense.

    >>> from plat.objectives import PPOConfig
    >>> with_settings(PPOConfig(), {"lr": 1e-4, "epochs": 3}).epochs
    3
    """
    own: dict[str, Any] = {}
    inner: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        first, _, rest = name.partition(".")
        if first not in (names := [field.name for field in dataclasses.fields(settings) if field.init]):  # type: ignore
            raise ConfigError(f"{type(settings).__name__}: no setting {first!r}, expected one of {', '.join(names)}")
        if not rest:
            own[first] = _of_python(value)
        elif dataclasses.is_dataclass(getattr(settings, first)):
            inner.setdefault(first, {})[rest] = value
        else:
            raise ConfigError(f"{type(settings).__name__}: {first} has no settings of its own, {name!r} names one")
    own |= {name: with_settings(getattr(settings, name), of_it) for name, of_it in inner.items()}
    return dataclasses.replace(settings, **own)  # type: ignore[type-var]


def _of_python(value: Any) -> Any:
    """Return a value with the numbers of Python in place of NumPy's and torch's, which searches draw."""
    if type(value) in (tuple, list):
        return type(value)(map(_of_python, value))
    return value.tolist() if hasattr(value, "tolist") else value


def trainable(
    train: Callable[[R], object], recipe: R, *, share: float = 0.1, cpus: int | None = None
) -> Callable[[Mapping[str, Any]], dict[str, float]]:
    """Return a function that trains with a sample of settings, for ``ray.tune.Tuner`` and other searches.

    It returns the means of all that the run logged over its end, by name as in ``metrics.csv``. Each sample has a run
    of its own in the recipe's folder. A sample whose run is there is not trained again, and one whose training was
    interrupted goes on from its last checkpoint.

    Args:
        train: main function of the recipe, such as ``plat.recipes.expert.main``.
        recipe: settings that the samples change. Its budget is each run's.
        share: of the rows of ``metrics.csv`` that the means are over, the last ones.
        cpus: that each training has; None for all of its machine. A search that runs several there sets it.

    Returns:
        The function. It takes values by the names of :func:`with_settings`, such as ``{"ppo.lr": 1e-4}``.
    """
    home = Path.cwd()  # Ray Tune changes into folders of its own

    def run(sample: Mapping[str, Any]) -> dict[str, float]:
        if cpus is not None:
            os.environ["PLAT_CPUS"] = str(cpus)
        with contextlib.chdir(home):
            changed = with_settings(recipe, dict(sample))
            out = recipe.out / _name({name: _of_python(value) for name, value in sample.items()})
            train(dataclasses.replace(changed, out=out, resume=is_run(out)))
            return _last_means(out / "metrics.csv", share)

    return run


def _name(sample: Mapping[str, Any]) -> str:
    """Return the name of a sample's folder: its settings as far as they are short, and a digest."""
    text = json.dumps(dict(sample), sort_keys=True, default=str)
    words = "-".join(f"{name.rpartition('.')[2]}={value}" for name, value in sorted(sample.items()))
    short = re.sub(r"[^\w.=-]+", "_", words)[:60]
    return f"{short}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"


def _last_means(path: Path, share: float) -> dict[str, float]:
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    last = rows[len(rows) - max(1, math.ceil(share * len(rows))) :]
    columns = {name: [float(row[name]) for row in last if row[name]] for name in (rows[0] if rows else ())}
    return {name: sum(values) / len(values) for name, values in columns.items() if values}
