"""What checks a change, in continuous integration and before a commit, agrees with the Makefile and the package."""

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[1]
JOB: dict[str, Any] = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text())["jobs"]["test"]
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
SETTING_UP = ("sudo apt-get ", "uv pip install ", "npm install ")
WITH_FURTHER_EXTRAS = {
    "python -m pytest tests/envs/physics/test_mujoco_warp.py",
    "python -m pytest -m slow $(grep -l on_ray -r tests --include='test_*.py')",
}
"""Tests that need an extra which is not among those of development."""


def normal(command: str) -> str:
    """A command without the folder of its program, the number of its processes and how often spaces come."""
    return " ".join(re.sub(r"-n \w+", "", command.replace("$(BIN)/", "")).split())


def recipes(target: str) -> set[str]:
    """Commands of a target of the Makefile and of the targets that it names."""
    text = (ROOT / "Makefile").read_text()
    match = re.search(rf"^{re.escape(target)}:(.*)\n((?:\t.*\n)*)", text, re.MULTILINE)
    assert match, target
    needed = [name for name in match[1].split() if not name.startswith("$")]
    own = {normal(line) for line in match[2].splitlines()}
    return own.union(*(recipes(name) for name in needed))


def commands() -> set[str]:
    """Commands of the workflow's steps, but for those that install."""
    lines = [line for step in JOB["steps"] for line in step.get("run", "").splitlines()]
    parts = [part.strip() for line in lines for part in line.split("&&")]
    return {normal(part) for part in parts if not part.startswith(SETTING_UP)}


def test_it_runs_what_make_test_runs():
    assert commands() - WITH_FURTHER_EXTRAS == recipes("test")


def test_pythons_are_those_that_the_package_allows():
    tried = {case["python"] for case in JOB["strategy"]["matrix"]["include"]}
    named = {match for line in PROJECT["classifiers"] for match in re.findall(r"Python :: (3\.\d+)", line)}
    lowest = PROJECT["requires-python"].removeprefix(">=")
    assert tried <= named
    assert min(named, key=version) == min(tried, key=version) == lowest
    assert max(tried, key=version) == max(named, key=version)


def test_the_lowest_versions_are_tried_on_the_lowest_python():
    lowest = [case["python"] for case in JOB["strategy"]["matrix"]["include"] if case["resolution"] == "lowest-direct"]
    assert lowest == [PROJECT["requires-python"].removeprefix(">=")]


@pytest.mark.parametrize("field", ["target-version", "python_version", "Makefile"])
def test_tools_know_the_lowest_python(field):
    lowest = PROJECT["requires-python"].removeprefix(">=")
    tools = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]
    said = {
        "target-version": tools["ruff"]["target-version"].replace("py3", "3."),
        "python_version": tools["mypy"]["python_version"],
        "Makefile": ".".join(re.findall(r"version_info >= \((\d+), (\d+)\)", (ROOT / "Makefile").read_text())[0]),
    }
    assert said[field] == lowest


def test_before_a_commit_the_lowest_ruff_checks():
    # whoever has a newer one is asked for nothing that this one refuses
    hooks = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())["repos"]
    (rev,) = (one["rev"] for one in hooks if one["repo"].endswith("/ruff-pre-commit"))
    (bound,) = (one for one in PROJECT["optional-dependencies"]["dev"] if one.startswith("ruff"))
    assert version(rev.removeprefix("v"))[:2] == version(bound.removeprefix("ruff>="))
    (lint,) = (step for step in JOB["steps"] if step.get("name") == "Lint")
    assert "if" not in lint  # so that the lowest one is tried, too


def test_text_files_end_with_a_line_break():
    folders = ("benchmarks", "docs", "examples", "plat", "recipes", "tests", ".github")
    kinds = {".cff", ".cpp", ".css", ".csv", ".js", ".json", ".md", ".mjs", ".py", ".svg", ".toml", ".yaml", ".yml"}
    files = [*ROOT.glob("*"), *(path for folder in folders for path in (ROOT / folder).rglob("*"))]
    content = {path: path.read_bytes() for path in files if path.suffix in kinds and path.is_file()}
    assert len(content) > 800
    assert [path for path, text in content.items() if text and (text[-1:] != b"\n" or text.endswith(b"\n\n"))] == []


def version(text: str) -> tuple[int, ...]:
    return tuple(map(int, text.split(".")))
