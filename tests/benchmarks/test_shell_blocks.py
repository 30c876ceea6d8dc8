"""The commands of a page are read out of every kind of shell block."""

import re
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from shell_blocks import Call, calls

from tests.cli.pages import DOCS


def words(text: str) -> list[list[str]]:
    return [list(call.words) for call in calls(text)]


def test_every_block_for_a_shell_is_read():
    text = "```sh\nplat a\n```\n```bash\nplat b \\\n  --c\n```\n- x\n  ```console\n  $ plat d\n  ```\n"
    text += "```python\nplat e\n```\nplat f\n"
    assert words(text) == [["a"], ["b", "--c"], ["d"]]
    marked = {mark for page in DOCS for mark in re.findall(r"```(\w+)", page.read_text(encoding="utf-8"))}
    assert marked <= {"bash", "json", "mermaid", "python", "sh", "yaml"}  # a new kind of shell block is to be read, too


def test_variables_and_loops():
    text = '```sh\nALL="a.npz \'b c.npz\'"\nMORE="$ALL d"\nfor x in 1 2; do plat e $MORE --seed $x; done\n'
    text += "plat f $UNKNOWN\n```"
    assert words(text) == [
        ["e", "a.npz", "b c.npz", "d", "--seed", "1"],
        ["e", "a.npz", "b c.npz", "d", "--seed", "2"],
        ["f", "$UNKNOWN"],
    ]


def test_section_and_comment():
    text = "```sh\nplat a\n```\n## B\n### C\n```sh\nplat d   # stopped\n# plat e\nother\nplat f '#1'\n```\n"
    assert calls(text) == [Call(("a",), "", ""), Call(("d",), "B", "stopped"), Call(("f", "#1"), "B", "")]
