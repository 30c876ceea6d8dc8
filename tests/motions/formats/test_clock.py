import numpy as np
import pytest

from plat.errors import MotionError
from plat.motions.formats.clock import rate_of_times, stated_rates


@pytest.mark.parametrize(("scale", "unit"), [(1, ""), (1, "s"), (1e3, ""), (1e3, "ms"), (1e6, "us"), (1e9, "ns")])
def test_times_in_every_unit(scale, unit):
    assert rate_of_times(100 + np.arange(20) * 0.02 * scale, unit) == 50
    assert rate_of_times(np.round(np.arange(20) / 30, 3) * scale, unit) == pytest.approx(30, rel=2e-3)


def test_times_that_waver_a_little():
    times = np.arange(50) / 60 + np.random.default_rng(0).uniform(-2e-3, 2e-3, 50)
    assert rate_of_times(times) == pytest.approx(60, rel=0.01)


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([0.0, 0.02, 0.04, 0.1, 0.12], "goes on by 0.06 at row 4, by 0.02 elsewhere"),
        ([0.0, 0.02, 0.02, 0.04], "goes on by 0 at row 3"),
        ([0.0, -0.02, -0.04], "expected even steps"),
        ([0.0, 3e9, 6e9], "3e.09 a row, a likely rate in no unit"),
    ],
)
def test_times_that_are_no_clock(times, message):
    with pytest.raises(MotionError, match=message):
        rate_of_times(np.array(times))


def test_where_rates_are_stated(tmp_path):
    path = tmp_path / "take_60hz.csv"
    assert stated_rates(path, ["exported", "fps: 50"]) == [(50.0, "a comment"), (60.0, "the file name")]
    assert stated_rates(path, ["exported 2024"]) == [(60.0, "the file name")]
    assert stated_rates(tmp_path / "clips_120fps" / "a.csv", []) == [(120.0, "the folder's name")]
    assert stated_rates(tmp_path / "a.csv", []) == []
