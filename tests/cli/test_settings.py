import io
import re
import shlex
import sys
from pathlib import Path

import pytest

from plat.cli import COMMANDS
from plat.cli.settings import parse
from plat.modules import ExpertConfig
from plat.recipes.expert import ExpertRecipe
from plat.recipes.refine import RefineRecipe

ROOT = Path(__file__).parents[2]
DOCS = [ROOT / "README.md", ROOT / "plat" / "weights" / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
SHELL = re.compile(r"^ *```(?:sh|bash|shell|console)\b[^\n]*\n(.*?)^ *```", re.MULTILINE | re.DOTALL)
REQUIRED = ["--motions", "x.npz", "--out", "x"]


def commands(text: str) -> list[list[str]]:
    """Return the calls of plat in the shell blocks of a page, their variables filled in."""
    found, variables = [], {}
    for block in SHELL.findall(text):
        for line in block.replace("\\\n", " ").splitlines():
            line = line.strip().removeprefix("$ ")
            for name in sorted(variables, key=len, reverse=True):
                line = line.replace("$" + name, variables[name])
            words = shlex.split(line, comments=True)
            if len(words) == 1 and "=" in words[0] and words[0].split("=")[0].isupper():
                name, variables[name] = words[0].split("=", 1)[0], words[0].split("=", 1)[1]
            elif words and words[0] == "plat":
                found.append(words[1:])
    return found


PAGES = [(page, words) for page in DOCS for words in commands(page.read_text(encoding="utf-8"))]
NAMES = [f"{page.stem}: {shlex.join(words)[:60]}" for page, words in PAGES]


@pytest.mark.parametrize(("page", "words"), PAGES, ids=NAMES)
def test_commands_in_the_docs_are_understood(page, words):
    name, *rest = words
    assert parse(COMMANDS[name].kind(), rest) is not None


def test_every_block_for_a_shell_is_read():
    text = "```sh\nplat a\n```\n```bash\nplat b \\\n  --c\n```\n- x\n  ```console\n  $ plat d\n  ```\n"
    text += "```python\nplat e\n```\n"
    assert commands(text) == [["a"], ["b", "--c"], ["d"]]
    marked = {mark for page in DOCS for mark in re.findall(r"```(\w+)", page.read_text(encoding="utf-8"))}
    assert marked <= {"bash", "json", "mermaid", "python", "sh", "yaml"}  # a new kind of shell block is to be read, too


def test_the_weights_say_how_they_are_made():
    stages = [words[0] for words in commands((ROOT / "plat" / "weights" / "README.md").read_text(encoding="utf-8"))]
    assert {"expert", "distill", "refine"} <= set(stages)


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
    ],
)
def test_misuse_is_one_line_with_the_flag(words, message, monkeypatch):
    for out in (sys.stdout, io.StringIO()):  # with lines to draw frames with, and without
        monkeypatch.setattr(sys, "stdout", out)
        with pytest.raises(SystemExit) as error:
            parse(ExpertRecipe, [*REQUIRED, *words], prog="plat expert")
        assert str(error.value).startswith(f"error: {message}")
        assert "\n" not in str(error.value)


def test_what_is_missing_is_named():
    with pytest.raises(SystemExit, match=r"^error: missing: --motions .*, --out PATH; see plat expert --help$"):
        parse(ExpertRecipe, [], prog="plat expert")
