import math
from itertools import pairwise

import pytest
import torch

from plat.errors import RecordsError
from plat.evaluation import CommandRecords, Estimate, Score
from plat.evaluation.disturbance import STRENGTHS
from plat.evaluation.groups import score_groups
from plat.evaluation.study import CurvePoint
from plat.figures import difference_plot, group_plot, horizon_plot, radar_plot, robustness_plot
from plat.figures.radar import spread_out
from tests.figures.scores import made_up, records

pytest.importorskip("matplotlib")


def test_success_against_the_commands_time():
    success, error = horizon_plot(made_up("DAgger", "PLAT")).axes
    (line, _) = success.lines
    assert list(line.get_xdata()) == pytest.approx([0.3])  # all commands have 20 steps
    failed = [score.records[0].failed.double().mean() for score in made_up("DAgger")]
    assert list(line.get_ydata()) == pytest.approx([100 * (1 - float(sum(failed)) / 3)])
    assert "mm" in error.get_ylabel()
    assert error.get_yscale() == "linear"


def test_commands_of_no_body_have_no_position_error():
    joints = records(0.0, 0.1, math.nan)
    both = CommandRecords.joined([records(0.0, 0.1, 0.2), joints])
    _, error = horizon_plot([Score.of("PLAT", "long", [both])]).axes
    assert list(error.lines[0].get_ydata()) == pytest.approx([200.0])


def test_errors_that_differ_much_are_on_a_logarithmic_scale():
    scores = [
        Score.of(name, "long", [records(0.0, 0.1, position)]) for name, position in (("PLAT", 0.02), ("wbc", 0.6))
    ]
    _, error = horizon_plot(scores).axes
    assert error.get_yscale() == "log"
    low, high = error.get_ylim()
    assert low < 20 < 600 < high


def test_a_point_a_group_and_policy():
    scores = [
        score
        for name in ("PLAT", "wbc")
        for score in score_groups(name, "mixed", [records(0.25, 0.1, 0.2)], ["a"] * 10 + ["b"] * 30, resamples=10)
    ]
    (panel,) = group_plot(scores).axes
    assert [text.get_text() for text in panel.get_xticklabels()] == ["a\n(10)", "b\n(30)"]
    values = [list(container.lines[0].get_ydata()) for container in panel.containers]
    assert values == [pytest.approx([0.0, 100.0])] * 2


@pytest.mark.parametrize(("count", "turned"), [(3, False), (16, True)])
def test_names_of_many_groups_do_not_run_into_each_other(count, turned):
    names = [f"family of motions {number}" for number in range(count)]
    scores = score_groups("PLAT", "mixed", [records(0.0, 0.1, 0.2, commands=count)], names, resamples=10)
    figure = group_plot(scores)
    figure.canvas.draw()
    labels = figure.axes[0].get_xticklabels()
    assert all((label.get_rotation() > 0) == turned for label in labels)
    ends = [(label.get_window_extent().x0, label.get_window_extent().x1) for label in labels]
    assert turned or all(before[1] < after[0] for before, after in pairwise(ends))


def test_curves_grow_harder_to_the_right():
    points = [
        CurvePoint("PLAT", name, value, Estimate(90.0 - number, 80.0, 95.0))
        for name in ("push", "friction")
        for number, value in enumerate(STRENGTHS[name].values)
    ]
    push, friction = robustness_plot(points).axes[:2]
    assert push.get_xlim()[0] < push.get_xlim()[1]
    assert friction.get_xlim()[0] > friction.get_xlim()[1]
    assert list(push.lines[0].get_ydata()) == [90.0 - number for number in range(len(STRENGTHS["push"].values))]
    assert "m/s" in push.get_xlabel()


def test_differences_in_favor_are_to_the_right():
    scores = made_up("DAgger", "PLAT")
    panels = difference_plot(scores, "PLAT").axes
    assert [text.get_text() for text in panels[0].get_yticklabels()] == ["DAgger, long", "DAgger, mixed"]
    tks, mpjpe, _ = panels
    assert tks.get_xlim()[0] < tks.get_xlim()[1]
    assert mpjpe.get_xlim()[0] > mpjpe.get_xlim()[1]
    with pytest.raises(RecordsError, match="no policy beside 'nobody'"):
        difference_plot(scores, "nobody")
    markers = [line.get_markerfacecolor() for line in mpjpe.lines if line.get_marker() == "o"]
    assert "white" not in markers
    for score in scores:  # of one motion nothing is known of others
        score.records[0].source = torch.zeros_like(score.records[0].clip)
    for panel in difference_plot(scores, "PLAT").axes:
        assert {line.get_markerfacecolor() for line in panel.lines if line.get_marker() == "o"} == {"white"}


def test_the_radar_keeps_good_rows_apart_beside_a_bad_one():
    scores = [
        Score.of(name, horizon, [records(failures, 0.1, 0.2)])
        for name, failures in (("PLAT", 0.0), ("DAgger", 0.05), ("wbc", 0.9))
        for horizon in ("short", "long", "mixed")
    ]
    figure = radar_plot(scores)
    panel = figure.axes[0]
    figure.canvas.draw()
    heights = {line.get_label(): panel.transData.transform((0.0, line.get_ydata()[0]))[1] for line in panel.lines}
    center = panel.transData.transform((0.0, panel.get_ylim()[0]))[1]
    rim = max(heights.values())
    # of 95 % and 10 %, a linear scale would leave a twentieth of the radius between the two good rows
    assert heights["PLAT"] - heights["DAgger"] > 0.4 * (rim - center)
    assert heights["DAgger"] - heights["wbc"] > 0.1 * (rim - center)
    rings = [float(text.get_text()) for text in panel.texts]
    assert rings == sorted(rings, reverse=rings[0] > rings[-1])


def test_values_that_are_alike_have_a_linear_scale():
    assert not spread_out([0.04, 0.05], "mpjpe")
    assert spread_out([0.04, 0.5], "mpjpe")


@pytest.mark.parametrize("failures", [0.0, 1.0])
def test_shares_are_from_0_to_100(failures):
    success, _ = horizon_plot([Score.of("PLAT", "long", [records(failures, 0.1, 0.2)])]).axes
    low, high = success.get_ylim()
    assert -1 <= low < 100 * (1 - failures) < high <= 101
    assert high - low > 3
