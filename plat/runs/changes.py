"""Settings of a resumed run: what may differ from those that it was started with, and what may not."""

import dataclasses
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import TypeAdapter

from plat.errors import CheckpointError
from plat.runs.inputs import changed_inputs, saved_inputs
from plat.runs.json_object import entry, plain
from plat.runs.locate import CONFIG_FILE
from plat.runs.outputs import INPUTS_FILE
from plat.runs.recipe import RecipeConfig

__all__ = ["Changes", "changes", "compared", "differing", "name_of", "settings_of", "with_defaults"]

# Where a run is, how long it goes on, and what is watched of it. Others are free too, see _is_free.
_FREE = {
    "device",
    "imports",
    "minutes",
    "out",
    "overlap",
    "ray",
    "save_every",
    "steps",
    "trackio",
    "unseen",
    "video_every",
    "wandb",
}
# Compared by what the paths hold, see plat.runs.inputs.
_BY_CONTENT = {"expert", "init", "init_model", "motions", "robot", "student"}


@dataclasses.dataclass
class _Recipe:
    """Entry ``recipe`` of a ``config.json``."""

    name: str | None = None
    settings: dict[str, Any] | None = None


class Changes(NamedTuple):
    """Settings that differ, by name: what they were and what they are."""

    free: dict[str, tuple[Any, Any]]
    refused: dict[str, tuple[Any, Any]]


def changes(before: Mapping[str, Any], now: Mapping[str, Any], content: Mapping[str, Any]) -> Changes:
    """Compare settings.

    Args:
        before: those that the run was started with.
        now: those that it is resumed with. Fields that only one of them has do not count, see :func:`with_defaults`.
        content: fingerprints of inputs; paths of these may change, for their content is compared.

    >>> found = changes({"steps": 10, "num_envs": 8, "ppo": {"lr": 0.1}}, {"steps": 20, "num_envs": 4, "ppo": {}}, {})
    >>> found.free, found.refused
    ({'steps': (10, 20)}, {'num_envs': (8, 4)})
    """
    found = dict(differing(before, now))
    found.pop("resume", None)  # says how the run is started, and nothing of it
    # there or not there is a difference that no fingerprint shows
    free = {
        name: pair
        for name, pair in found.items()
        if _is_free(name, pair) or (name in _BY_CONTENT and name in content and None not in pair)
    }
    return Changes(free, {name: pair for name, pair in found.items() if name not in free})


def compared(
    folder: Path, config: Mapping[str, Any], recipe: Any, inputs: Mapping[str, Any]
) -> tuple[dict[str, tuple[Any, Any]], str]:
    """Compare a run with the recipe and the inputs that it is to go on with.

    Args:
        folder: of the run.
        config: its ``config.json``.
        recipe: a dataclass with the settings.
        inputs: fingerprints, see :func:`plat.runs.run_inputs`.

    Returns:
        Settings that differ and may, by name, as they were and are; and in words what differs and may not, if anything.

    Raises:
        CheckpointError: when the run's settings are of odd types.
    """
    before = entry(config, "recipe", _Recipe, folder / CONFIG_FILE) or _Recipe()
    saved = before.settings or {}
    if isinstance(recipe, RecipeConfig):
        saved = recipe.as_written_now(saved)
    found = changes({} if before.settings is None else with_defaults(saved, recipe), settings_of(recipe), inputs)
    wrong = [f"{name} is {new}, was {old}" for name, (old, new) in found.refused.items()]
    name, was = name_of(recipe), before.name
    # where the recipe has no name, that of the program says less
    if was != name and hasattr(type(recipe), "name") and was is not None:
        wrong.insert(0, f"the recipe is {name}, was {was}")
    wrong += changed_inputs(_inputs_of(folder), inputs)
    more = f" and {len(wrong) - 5} more" if len(wrong) > 5 else ""
    return found.free, "; ".join(wrong[:5]) + more


def _inputs_of(folder: Path) -> dict[str, Any]:
    path = folder / INPUTS_FILE
    if not path.exists():  # a run of an older plat
        return {}
    try:
        inputs = saved_inputs(folder)
        entry(inputs, "motions", list[tuple[str, int, float, float]], path)
        return inputs
    except CheckpointError as error:
        print(f"{error}; going on without a comparison of the inputs", flush=True)
        return {}


def name_of(recipe: Any) -> str:
    """Return the name of a recipe, or of the program where it has none."""
    return getattr(type(recipe), "name", Path(sys.argv[0]).stem)


def settings_of(recipe: Any) -> dict[str, Any]:
    """Return the settings of a recipe, a dataclass, as ``config.json`` has them."""
    # as any: a task or config of the user's own class is written with the fields that it adds
    return plain(TypeAdapter(type(recipe)).dump_python(recipe, mode="json", serialize_as_any=True))


def with_defaults(settings: Mapping[str, Any], recipe: Any) -> dict[str, Any]:
    """Return saved settings with the defaults of those that they lack: an older plat did not have them.

    Args:
        settings: those of a run.
        recipe: a dataclass, which knows the defaults.

    >>> from plat.objectives import PPOConfig
    >>> with_defaults({"lr": 0.1}, PPOConfig())["epochs"] == PPOConfig().epochs
    True
    """
    full = dict(settings)
    for field in dataclasses.fields(recipe):
        value, saved = getattr(recipe, field.name), full.get(field.name)
        if dataclasses.is_dataclass(value) and isinstance(saved, Mapping):
            full[field.name] = with_defaults(saved, value)
        elif field.name not in full and field.default is not dataclasses.MISSING:
            full[field.name] = _as_saved(field.default)
        elif field.name not in full and field.default_factory is not dataclasses.MISSING:
            full[field.name] = _as_saved(field.default_factory())
    return full


def _as_saved(value: Any) -> Any:
    return plain({"value": TypeAdapter(Any).dump_python(value, mode="json")})["value"]


def _is_free(name: str, pair: tuple[Any, Any]) -> bool:
    if name == "workers":  # one goes on from the state of none
        return all(number in (0, 1) for number in pair)
    last = name.rpartition(".")[2]
    return name in _FREE or last in ("lr", "policy_muon") or last.endswith("_lr")


def differing(before: Mapping[str, Any], now: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the dotted names of settings that differ, with both values."""
    for name in (name for name in before if name in now):
        old, new = before[name], now[name]
        if isinstance(old, Mapping) and isinstance(new, Mapping):
            yield from differing(old, new, f"{prefix}{name}.")
        elif old != new:
            yield f"{prefix}{name}", (old, new)
