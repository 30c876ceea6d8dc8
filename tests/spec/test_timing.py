import math
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from plat.errors import PlatError
from plat.spec.timing import Timing, timing_of


def test_defaults_are_those_of_the_paper() -> None:
    assert Timing() == Timing(control_dt=0.02, max_steps=50, window=3)
    assert Timing().longest == 1.0


def test_steps_are_rounded_to_the_nearest() -> None:
    assert Timing().steps(0.5) == 25
    assert Timing(control_dt=0.05).steps(0.5) == 10


def test_times_of_other_libraries_have_steps() -> None:
    for time in (np.array(0.5), np.float32(0.5), torch.tensor(0.5)):
        steps = Timing().steps(time)
        assert (steps, type(steps)) == (25, int)


@pytest.mark.parametrize(
    ("field", "value"),
    [("control_dt", 0.0), ("control_dt", math.nan), ("max_steps", 0), ("max_steps", 1.5), ("window", -1)],
)
def test_nonsense_is_refused_by_name(field: str, value: float) -> None:
    with pytest.raises(PlatError, match=field):
        Timing(**{field: value})  # type: ignore[arg-type]


def test_timings_of_policies():
    assert timing_of(SimpleNamespace(timing=Timing(max_steps=7))) == Timing(max_steps=7)
    assert timing_of(SimpleNamespace(timing=3)) is timing_of(SimpleNamespace()) is None


def test_what_does_not_fit_is_refused():
    timing = Timing(control_dt=0.01, max_steps=10)
    timing.check_control_dt(0.01, "motions")
    timing.check_steps(10, "command")
    with pytest.raises(PlatError, match=r"motions: control step of 0.02 s, expected the policy's 0.01 s"):
        timing.check_control_dt(0.02, "motions")
    with pytest.raises(PlatError, match="command: 11 control steps, expected at most the policy's 10"):
        timing.check_steps(11, "command")
