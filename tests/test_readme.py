"""The Python examples of README and of pages that promise it run as they stand, from the root of a clone."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
OPTIONAL = {"plat.envs.sb3": "stable_baselines3"}
PAGES = ("README.md", "docs/components.md", "docs/gymnasium.md", "docs/imagination.md", "plat/weights/README.md")
JOINED = ("docs/imagination.md",)
"""Pages on which an example goes on from the one before it."""


def examples_of(page: str) -> list[str]:
    examples = re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(), re.DOTALL)
    return ["\n".join(examples)] if page in JOINED else examples


EXAMPLES = {f"{page}-{number}": example for page in PAGES for number, example in enumerate(examples_of(page))}


@pytest.mark.slow
@pytest.mark.parametrize("example", EXAMPLES.values(), ids=EXAMPLES)
def test_example(example, monkeypatch):
    for module, package in OPTIONAL.items():
        if module in example:
            pytest.importorskip(package)
    monkeypatch.chdir(ROOT)
    exec(example, {})


def test_every_page_has_examples():
    assert {name.rsplit("-", 1)[0] for name in EXAMPLES} == set(PAGES)
