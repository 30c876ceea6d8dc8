import math

import pytest

from plat.errors import PlatError
from plat.spec.timing import Timing


def test_defaults_are_those_of_the_paper() -> None:
    assert Timing() == Timing(control_dt=0.02, max_steps=50, window=3)
    assert Timing().longest == 1.0


def test_steps_are_rounded_to_the_nearest() -> None:
    assert Timing().steps(0.5) == 25
    assert Timing(control_dt=0.05).steps(0.5) == 10


@pytest.mark.parametrize(
    ("field", "value"),
    [("control_dt", 0.0), ("control_dt", math.nan), ("max_steps", 0), ("max_steps", 1.5), ("window", -1)],
)
def test_nonsense_is_refused_by_name(field: str, value: float) -> None:
    with pytest.raises(PlatError, match=field):
        Timing(**{field: value})  # type: ignore[arg-type]
