"""The README's Python examples run as they stand."""

import re
from pathlib import Path

import pytest

README = Path(__file__).parents[1] / "README.md"
EXAMPLES = re.findall(r"```python\n(.*?)```", README.read_text(), re.DOTALL)


@pytest.mark.parametrize("example", EXAMPLES, ids=[example.splitlines()[0] for example in EXAMPLES])
def test_example(example):
    exec(example, {})


def test_files_that_are_named_exist():
    named = re.findall(
        r"`((?:plat|recipes|benchmarks|docs)/[\w/.]*)`|\]\(((?:docs|weights)/[^)#]+)", README.read_text()
    )
    missing = [path for pair in named for path in pair if path and not (README.parent / path).exists()]
    assert not missing
