"""What conftest.py lists as slow is there."""

from pathlib import Path

import pytest

from tests.conftest import SLOW

TESTS = Path(__file__).parent


@pytest.mark.parametrize("entry", SLOW)
def test_slow_tests_exist(entry: str) -> None:
    file, _, name = entry.partition("::")
    assert (TESTS / file).exists()
    assert not name or f"def {name}(" in (TESTS / file).read_text()
