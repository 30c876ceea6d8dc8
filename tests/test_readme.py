"""The Python examples of README and docs/components.md run as they stand."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
EXAMPLES = {
    f"{page.stem}-{number}": example
    for page in (README, ROOT / "docs" / "components.md")
    for number, example in enumerate(re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL))
}


@pytest.mark.parametrize("example", EXAMPLES.values(), ids=EXAMPLES)
def test_example(example):
    exec(example, {})


def test_files_that_are_named_exist():
    named = re.findall(
        r"`((?:plat|recipes|benchmarks|docs)/[\w/.]*)`|\]\(((?:docs|weights)/[^)#]+)", README.read_text()
    )
    missing = [path for pair in named for path in pair if path and not (README.parent / path).exists()]
    assert not missing
