import sys
from dataclasses import replace
from pathlib import Path

import pytest

from plat.errors import PlatError

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from guard import Figure, Figures, compared, figure, read_figures, write_figures

COMMITTED = Figures(
    threads=2,
    num_envs=1024,
    rows={
        "environment": Figure(9000.0, "steps/s", 0.80),
        "loss step": Figure(50.0, "ms", 500.0),
        "memory": Figure(700.0, "MB", 700.0),
    },
)


def with_ratio(name: str, ratio: float) -> Figures:
    return replace(COMMITTED, rows=COMMITTED.rows | {name: replace(COMMITTED.rows[name], ratio=ratio)})


def test_figures_are_ratios_to_bare_physics_of_the_same_round():
    bare = [10_000.0, 5_000.0, 10_000.0]
    assert figure([8_000.0, 4_000.0, 9_000.0], "steps/s", bare) == Figure(8_000.0, "steps/s", 0.8)
    # the machine was half as fast in the second round: the same work took twice as long
    assert figure([50.0, 100.0, 50.0], "ms", bare) == Figure(50.0, "ms", pytest.approx(500.0))
    assert figure([2.0, 4.0, 2.0], "s", bare) == Figure(2.0, "s", pytest.approx(20_000.0))
    assert figure([700.0, 720.0, 710.0], "MB", bare) == Figure(710.0, "MB", 710.0)


def test_a_rate_says_how_much_of_its_time_was_physics():
    row = figure([8_000.0, 8_000.0, 8_000.0], "steps/s", [10_000.0] * 3, physics=[0.7, 0.6, 0.75])
    assert row.physics == 0.7
    assert str(row) == "8,000 steps/s, 80.0% of bare physics, 70.0% of its time physics"
    assert figure([8_000.0], "steps/s", [10_000.0]).physics is None


@pytest.mark.parametrize(
    ("name", "within", "beyond"),
    [("environment", 0.69, 0.67), ("loss step", 570.0, 580.0), ("memory", 800.0, 810.0)],
)
def test_only_changes_for_the_worse_beyond_the_tolerance_fail(name: str, within: float, beyond: float):
    assert compared(with_ratio(name, within), COMMITTED) == ([], [])
    regressions, remarks = compared(with_ratio(name, beyond), COMMITTED)
    assert [line.split(":")[0] for line in regressions] == [name]
    assert remarks == []


def test_a_regression_names_the_row_and_both_figures():
    (line,), _ = compared(with_ratio("environment", 0.60), COMMITTED)
    assert line == (
        "environment: 9,000 steps/s, 60.0% of bare physics; committed 9,000 steps/s, 80.0% of bare physics (-25%)"
    )
    (line,), _ = compared(with_ratio("loss step", 1000.0), COMMITTED)
    assert "the time of 1,000 bare steps; committed 50 ms, the time of 500 bare steps (+100%)" in line


def test_what_is_much_better_or_missing_is_remarked_on():
    regressions, remarks = compared(with_ratio("loss step", 100.0), COMMITTED)
    assert regressions == []
    assert "better, commit it" in remarks[0]
    rows = {"environment": COMMITTED.rows["environment"], "new": Figure(1.0, "s", 1.0)}
    assert compared(replace(COMMITTED, rows=rows), COMMITTED) == (
        [],
        ["loss step: committed, not measured", "memory: committed, not measured", "new: measured, not committed"],
    )


@pytest.mark.parametrize("name", ["threads", "num_envs"])
def test_runs_of_other_sizes_are_not_compared(name: str):
    with pytest.raises(PlatError, match=f"{name}: 4 in this run, {getattr(COMMITTED, name)} in the committed one"):
        compared(replace(COMMITTED, **{name: 4}), COMMITTED)


def test_files_are_read_back_and_broken_ones_named(tmp_path):
    path = tmp_path / "figures.json"
    with pytest.raises(PlatError, match=r"figures.json': not readable \(No such file"):
        read_figures(path)
    write_figures(path, COMMITTED)
    assert read_figures(path) == COMMITTED
    path.write_text(path.read_text().replace('"unit": "ms"', '"unit": 3'))
    with pytest.raises(PlatError, match="rows.loss step.unit: Input should be a valid string"):
        read_figures(path)
