"""Settings of a resumed run: what may differ from those that it was started with, and what may not."""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

__all__ = ["Changes", "changes"]

# Where a run is, how long it goes on, and what is watched of it. Learning rates are free too, see _is_free.
_FREE = {
    "device",
    "imports",
    "minutes",
    "out",
    "save_every",
    "steps",
    "trackio",
    "unseen",
    "video_every",
    "wandb",
}
# Compared by what the paths hold, see plat.runs.inputs.
_BY_CONTENT = {"expert", "init", "init_model", "motions", "robot", "student"}


class Changes(NamedTuple):
    """Settings that differ, by name: what they were and what they are."""

    free: dict[str, tuple[Any, Any]]
    refused: dict[str, tuple[Any, Any]]


def changes(before: Mapping[str, Any], now: Mapping[str, Any], content: Mapping[str, Any]) -> Changes:
    """Compare settings.

    Args:
        before: those that the run was started with.
        now: those that it is resumed with. Fields that only one of them has do not count: an older plat lacked them.
        content: fingerprints of inputs; paths of these may change, for their content is compared.

    >>> found = changes({"steps": 10, "num_envs": 8, "ppo": {"lr": 0.1}}, {"steps": 20, "num_envs": 4, "ppo": {}}, {})
    >>> found.free, found.refused
    ({'steps': (10, 20)}, {'num_envs': (8, 4)})
    """
    differing = dict(_differing(before, now))
    differing.pop("resume", None)  # says how the run is started, and nothing of it
    # there or not there is a difference that no fingerprint shows
    free = {
        name: pair
        for name, pair in differing.items()
        if _is_free(name) or (name in _BY_CONTENT and name in content and None not in pair)
    }
    return Changes(free, {name: pair for name, pair in differing.items() if name not in free})


def _is_free(name: str) -> bool:
    last = name.rpartition(".")[2]
    return name in _FREE or last == "lr" or last.endswith("_lr")


def _differing(before: Mapping[str, Any], now: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the dotted names of settings that differ, with both values."""
    for name in (name for name in before if name in now):
        old, new = before[name], now[name]
        if isinstance(old, Mapping) and isinstance(new, Mapping):
            yield from _differing(old, new, f"{prefix}{name}.")
        elif old != new:
            yield f"{prefix}{name}", (old, new)
