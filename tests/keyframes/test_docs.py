"""docs/keyframes.md is true."""

import json
import re
from pathlib import Path

from plat.keyframes import KeyframeSequence, standing
from plat.keyframes.partial import only
from plat.robots import G1

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "keyframes.md").read_text()


def fields(content: object) -> set[str]:
    if isinstance(content, list):
        return set().union(*map(fields, content))
    if isinstance(content, dict):
        return set(content).union(*map(fields, content.values()))
    return set()


def test_the_schema_is_that_of_the_files(tmp_path):
    written = fields(json.loads((ROOT / "recipes" / "examples" / "bow.json").read_text())) - set(G1.joint_names)
    partial = only(G1, 1.0, left_hand=(0.35, 0.2, 0.95))
    KeyframeSequence(G1, standing(G1), (partial,)).save(tmp_path / "hand.json")
    written |= set(json.loads((tmp_path / "hand.json").read_text())["keyframes"][0])
    explained = set(re.findall(r"^\| `(\w+)` \| (?:text|integer|number|list|object|\d numbers)", PAGE, re.MULTILINE))
    assert written == explained


def test_the_example_file_is_one_once_its_dots_are_filled_in(tmp_path):
    text, *_ = re.findall(r"```json\n(.*?)```", PAGE, re.DOTALL)
    content = json.loads(text)
    for pose in (content["start"], *content["keyframes"]):
        del pose["joint_pos"]["..."]
        pose["joint_pos"] = dict.fromkeys(G1.joint_names, 0.0) | pose["joint_pos"]
    (tmp_path / "example.json").write_text(json.dumps(content))
    assert KeyframeSequence.load(tmp_path / "example.json", G1).keyframes[0].name == "hand up"


def test_the_python_examples_run_one_after_the_other(tmp_path, monkeypatch, capsys):
    (tmp_path / "plat").symlink_to(ROOT / "plat")
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    for example in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL):
        exec(example, names)
    assert (names["command"].keyframe.name, names["command"].steps_left) == ("wave", 20)
    printed = capsys.readouterr().out.splitlines()
    assert printed[0] == "2.5 m in 1.00 s takes 5.0 m/s"
    assert printed[-1] == "['reached', 'reached', 'reached']"
