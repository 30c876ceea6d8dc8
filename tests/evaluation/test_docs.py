"""The examples of docs/evaluation.md run as they stand."""

import re
from pathlib import Path

import plat.evaluation
from plat.evaluation import AuthoredScore

PAGE = Path(__file__).parents[2] / "docs" / "evaluation.md"


def test_the_examples_run(capsys):
    names: dict[str, object] = {}
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    for block in blocks:
        exec(block, names)
    assert len(blocks) >= 2
    assert isinstance(score := names["score"], AuthoredScore)
    assert score.chains == 4
    assert str(score.reached) in capsys.readouterr().out


def test_the_parts_of_both_evaluations_are_public():
    for name in ("evaluate_authored", "AuthoredScore", "families_of", "command_difficulty"):
        assert name in plat.evaluation.__all__
        assert getattr(plat.evaluation, name)
