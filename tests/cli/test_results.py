"""The results in the docs are those of the benchmark's files, and of the weights that come with plat."""

import json
import re
from pathlib import Path

import pytest

from plat.baselines.catalog import CATALOG, sha256
from plat.cli.benchmark import command_of
from plat.cli.benchmark_page import ABOUT, page
from plat.cli.options import BenchmarkRecipe
from plat.cli.settings import parse
from plat.evaluation.disturbance import STRENGTHS
from plat.evaluation.study_files import read_study
from plat.runs.locate import shipped_runs

DOCS = Path(__file__).parents[2] / "docs"
KEPT = DOCS / "benchmark"


@pytest.fixture
def about() -> dict:
    if not KEPT.exists():
        pytest.skip("no results of plat benchmark in the docs")
    return json.loads((KEPT / ABOUT).read_text(encoding="utf-8"))


def test_the_page_is_made_from_the_files(about):
    assert (DOCS / "results.md").read_text(encoding="utf-8") == page(KEPT, "benchmark/")


def test_the_command_means_what_it_says(about):
    words = about["command"]
    recipe = parse(BenchmarkRecipe, words[2:])
    assert command_of(recipe) == words
    assert (recipe.seed, recipe.longest) == (about["seed"], about["longest"])
    assert list(recipe.rules) == [rule for rule, _ in about["rules"]]
    assert not any("/" in word for word in words)  # no folder of some machine


def test_rows_are_of_the_weights_that_come_with_plat_and_of_released_files(about):
    shipped = {name: sha256(path / "model.safetensors") for name, path in shipped_runs().items()}
    released = {name: known for name, baseline in CATALOG.items() for known in baseline.files.values()}
    stale = [name for name, mark, *_ in about["rows"] if not str((shipped | released).get(name)).startswith(mark)]
    assert stale == []


def test_every_row_went_through_every_test(about):
    rows = {name.partition(" (")[0] for name, *_ in about["rows"]}
    first, *_ = about["sets"]
    for name, *_ in about["sets"]:
        study = read_study(KEPT / name)
        of_test = {
            "scores": {score.policy for score in study.scores if score.horizon == "mixed"},
            "difficulty": {score.policy for score in study.groups["difficulty"]},
        }
        for rule, _ in about["rules"]:
            of_test[rule] = {score.policy for score in study.clips if score.rule == rule}
        if name == first[0]:
            of_test["authored"] = {score.policy for score in study.groups["authored"]}
            assert {point.disturbance for point in study.curves} == set(STRENGTHS)
            of_test["robustness"] = {point.policy for point in study.curves}
        for test, policies in of_test.items():
            assert {policy.partition(" (")[0] for policy in policies} == rows, (name, test)


def test_tables_have_position_errors_in_millimeters():
    root = DOCS.parent
    shown = [root / "README.md", root / "plat" / "weights" / "README.md", *DOCS.rglob("*.md")]
    shown += [path for folder in ("plat", "recipes", "benchmarks") for path in (root / folder).rglob("*.py")]
    meters = re.compile(r"MPKPE@3 (m\b|\(m\)[^.]* \||\(m\)\")")
    assert [str(path) for path in shown if meters.search(path.read_text(encoding="utf-8"))] == []
