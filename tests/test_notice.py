"""NOTICE, citation and model card name what the shipped weights learned from, and agree with the package."""

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

from plat.export.data_sets import DataSet, data_set_of

ROOT = Path(__file__).parents[1]
RUNS = {path.parent.name: json.loads(path.read_text()) for path in ROOT.glob("plat/weights/*/config.json")}
NOTICE = " ".join((ROOT / "NOTICE").read_text(encoding="utf-8").split())
CARD = (ROOT / "plat/weights/README.md").read_text(encoding="utf-8")
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
CREDITS = {
    "bandai": ["Bandai-Namco", "2306.08861"],
    "asap": ["ASAP"],
    "pbhc": ["PBHC"],
    "hard_free": ["mocap.cs.cmu.edu", "NSF EIA-0196217", "Jasmine Coro", "Mike Gassaway", "100STYLE", "BSD"],
    "hard_sa": ["HDM05", "CC BY-SA 3.0"],
    "hard_nc": ["Sony SIE", "NVIDIA ASE", "non-commercial"],
}
"""What is owed for a data set, by the stem of its files."""


def learned_from(run: dict[str, Any]) -> set[DataSet | None]:
    """Data sets of a run, of those that it is the mean of, and of those that it began with as far as it tells."""
    parts = [run, *run.get("earlier", [])]
    files = [file for part in parts for file in part["recipe"]["settings"]["motions"]]
    return {data_set_of(file) for file in files + [file for part in run.get("average", []) for file in part["motions"]]}


def named_in_notice(name: str) -> set[str]:
    """Stems of the data sets that NOTICE gives for weights; paragraphs refer to each other by *these* and a name."""
    weights = NOTICE.partition("Weights.")[2].partition("Pictures.")[0]
    expert, others, free = re.split(r"dagger, expert-model,|imagined-free on ", weights)
    text = {"expert": expert, "imagined-free": free}.get(name, expert + others + free)
    assert re.search(rf"\b{name}\b(?!-)", weights)
    return {stem for stem, credits in CREDITS.items() if all(credit in text for credit in credits)}


@pytest.mark.parametrize("name", sorted(RUNS))
def test_all_that_weights_learned_from_is_credited(name):
    data_sets = learned_from(RUNS[name])
    assert None not in data_sets
    stems = {each.stem for each in data_sets if each is not None} - {"generated"}
    assert stems <= CREDITS.keys()
    if name == "plat-generated":
        assert stems == set()
    else:
        assert stems <= named_in_notice(name)
    for stem in stems:
        assert all(credit in " ".join(CARD.split()) for credit in CREDITS[stem])


def test_free_weights_learned_from_nothing_stricter_than_attribution():
    strictest = {name: max(each.strictness for each in learned_from(run) if each) for name, run in RUNS.items()}
    free = {name for name, strictness in strictest.items() if strictness <= 1}
    assert free == set(re.findall(r"^\| `([\w-]+)-g1` .*\| Apache-2\.0 \|$", CARD, re.MULTILINE))
    assert f"Of plat/weights, {' and '.join(sorted(free))} are under the Apache License" in NOTICE
    readme = " ".join((ROOT / "README.md").read_text().split())
    assert all(f"`{name}-g1`" in readme.partition("## License")[2] for name in free)


def test_the_citation_is_of_this_version():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["version"] == PROJECT["version"]
    assert citation["license"] == PROJECT["license"]
    assert set(citation["keywords"]) <= set(PROJECT["keywords"])
    assert citation["authors"] == PROJECT["authors"]
    (paper,) = citation["references"]
    assert PROJECT["urls"]["Homepage"] == paper["url"]
    changes = re.findall(r"^## (.+)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    # what is not released says so: a run, a bundle and a table name the version that made them
    assert changes[0] == ("Unreleased" if ".dev" in PROJECT["version"] else PROJECT["version"])
