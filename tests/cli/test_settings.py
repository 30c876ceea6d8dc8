import io
import shlex
import sys
from pathlib import Path

import pytest

from plat.cli import COMMANDS
from plat.cli.settings import parse
from plat.modules import ExpertConfig
from plat.recipes.expert import ExpertRecipe
from plat.recipes.refine import RefineRecipe
from tests.cli.pages import DOCS, ROOT, calls

REQUIRED = ["--motions", "x.npz", "--out", "x"]
CALLS = [(page.stem, call.words) for page in DOCS for call in calls(page.read_text(encoding="utf-8"))]


@pytest.mark.parametrize(("page", "words"), CALLS, ids=[f"{page}: {shlex.join(words)[:60]}" for page, words in CALLS])
def test_commands_in_the_docs_are_understood(page, words):
    name, *rest = words
    assert parse(COMMANDS[name].kind(), rest) is not None


def test_the_weights_say_how_they_are_made():
    page = ROOT / "plat" / "weights" / "README.md"
    assert {"expert", "distill", "refine"} <= {call.words[0] for call in calls(page.read_text(encoding="utf-8"))}


def test_presets():
    best, paper = (parse(ExpertRecipe, [*REQUIRED, "--preset", name]) for name in ("best", "paper"))
    assert best == parse(ExpertRecipe, REQUIRED)
    assert (paper.policy, paper.motor.weight) == (ExpertConfig(), 0)
    assert paper.task == best.task
    other = parse(RefineRecipe, [*REQUIRED, "--student", "s", "--preset", "paper", "--policy.lead", "0.02"])
    assert (other.policy.lead, other.motor.weight) == (0.02, 0)  # settings override the preset
    with pytest.raises(SystemExit):
        parse(ExpertRecipe, [*REQUIRED, "--preset", "worst"])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--ppo.gamma", "2"], "--ppo.gamma is 2.0, expected a number from 0 to 1; see plat expert --help"),
        (["--num-envs", "0"], "--num-envs is 0, expected a whole number from 1 to 65,536; see plat expert --help"),
        (["--num-envs", "x"], "--num-envs: expected a whole number, not 'x'; see plat expert --help"),
        (
            ["--num-env", "3"],
            "Unrecognized options: --num-env, 3; perhaps you meant --num-envs; see plat expert --help",
        ),
        (["--task.reset-noise", "yaw=-1"], "--task.reset-noise.yaw is -1.0, expected a number of at least 0; see"),
        (
            ["--policy.timing.max-steps", "0"],
            "--policy.timing.max-steps is 0, expected a whole number from 1 to 10,000",
        ),
        (["--out"], "Missing value for argument '--out'. Expected 1 values; see plat expert --help"),
        (["--preset", "worst"], "--preset 'worst': expected one of best, paper"),
        (["--minutes", "30m"], "--minutes: expected a number, not '30m'; see plat expert --help"),
        (["--steps", "1e6"], "--steps: expected a whole number, not '1e6'; see plat expert --help"),
        (["--init", ""], "--init: is empty, expected a path; see plat expert --help"),
        (["--critic", "64", "x"], "--critic: expected whole numbers, not ['64', 'x']; see plat expert --help"),
    ],
)
def test_misuse_is_one_line_with_the_flag(words, message, monkeypatch):
    for out in (sys.stdout, io.StringIO()):  # with lines to draw frames with, and without
        monkeypatch.setattr(sys, "stdout", out)
        with pytest.raises(SystemExit) as error:
            parse(ExpertRecipe, [*REQUIRED, *words], prog="plat expert")
        assert str(error.value).startswith(f"error: {message}")
        assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("command", "words", "field"),
    [
        ("play", ["--keyframes", "", "--policy", "x"], "--keyframes"),
        ("keyframes", ["show", ""], "PATH"),
        ("keyframes", ["around", "a.json", "--out", ""], "--out"),
        ("motions", ["inspect", "a.npz", "--out", ""], "--out"),
        ("evaluate", ["", "--motions", "x"], "PATH"),
        ("refine", ["--motions", "x", "--out", "o", "--student", ""], "--student"),
    ],
)
def test_an_empty_path_is_not_the_working_directory(command, words, field):
    told = r"(is empty, expected a path|expected other values than \[''\])"
    with pytest.raises(SystemExit, match=rf"^error: .*{field}.*: {told}; see plat {command}"):
        parse(COMMANDS[command].kind(), words, prog=f"plat {command}")


def test_two_numbers_are_told_to_be_numbers():
    with pytest.raises(SystemExit, match=r"^error: --trim: expected numbers, not \['1', 'x'\]; see plat motions"):
        parse(COMMANDS["motions"].kind(), ["convert", "a", "--out", "b", "--trim", "1", "x"], prog="plat motions")


def test_a_home_that_the_shell_left_as_it_is(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    assert parse(ExpertRecipe, ["--motions", "x.npz", "--out=~/runs/a"]).out == tmp_path / "runs" / "a"
    runs = ["~/a", "b~", "./~", "plat-g1"]
    recipe = parse(COMMANDS["average"].kind(), [*runs, "--out", "x"])
    assert recipe.runs == (tmp_path / "a", Path("b~"), Path("~"), Path("plat-g1"))


def test_what_is_missing_is_named():
    with pytest.raises(SystemExit, match=r"^error: missing: --motions .*, --out PATH; see plat expert --help$"):
        parse(ExpertRecipe, [], prog="plat expert")
