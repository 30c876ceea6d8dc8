"""The commands in plat/weights/README.md mean what the config.json of the weights records."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pydantic import TypeAdapter

from plat.cli import COMMANDS
from plat.cli.settings import parse
from tests.cli.test_settings import commands

WEIGHTS = Path(__file__).parents[2] / "plat" / "weights"
RUNS = {
    "expert": "expert",
    "dagger": "dagger",
    "plat": "plat",
    "finetuned-hard": "finetuned",
    "expert-last": "expert-model",
    "sides": "imagined",
    "latent-third": "imagined-latent",
    "robot-second": "imagined-robot",
    "free-23": "imagined-free",
    "plat-generated": "plat-generated",
}
# files of the machine that trained, and how it was watched
ABOUT = {
    "motions",
    "out",
    "init",
    "init_model",
    "expert",
    "student",
    "resume",
    "device",
    "save_every",
    "video_every",
    "minutes",
    "unseen",
}


def leaves(values: dict[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield dotted names and values of nested settings, by the names of today."""
    for name, value in values.items():
        name = path + name.replace("regularisation", "regularization")
        if isinstance(value, dict):
            yield from leaves(value, f"{name}.")
        else:
            yield name, value


def written() -> dict[str, list[str]]:
    """Return the command that wrote each run; the first one of a name, for later pages go on from the weights."""
    found: dict[str, list[str]] = {}
    for words in commands((WEIGHTS / "README.md").read_text(encoding="utf-8")):
        if "--out" in words:
            found.setdefault(Path(words[words.index("--out") + 1]).name, words)
    return found


@pytest.mark.parametrize(("run", "folder"), RUNS.items())
def test_the_commands_are_those_that_made_the_weights(run, folder):
    recorded = json.loads((WEIGHTS / folder / "config.json").read_text(encoding="utf-8"))["recipe"]
    name, *rest = written()[run]
    assert name == recorded["name"]
    kind = COMMANDS[name].kind()
    recipe = parse(kind, rest)
    if hasattr(recipe, "imagination"):  # rates that are not told are those of what is trained already
        recipe = replace(recipe, imagination=recipe.with_rates())
    told = dict(leaves(TypeAdapter(kind).dump_python(recipe, mode="json")))
    was = {name: value for name, value in leaves(recorded["settings"]) if name not in ABOUT}
    both = told.keys() & was.keys()
    assert len(both) > 30
    assert {name: told[name] for name in both} == {name: was[name] for name in both}
    task = recorded["settings"].get("task", {})
    # the switch is that of runs of before
    randomized = task.get("domain_randomization", bool(task.get("randomization")))
    assert ("task.randomization.push_interval" in told) == randomized
