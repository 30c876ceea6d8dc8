from functools import partial

import pytest

from plat.errors import RecordsError
from plat.evaluation import METRICS, Score
from plat.figures import ablation_bars, radar_plot
from tests.figures.scores import made_up, records

pytest.importorskip("matplotlib")


def test_a_bar_a_policy_with_value_and_interval():
    scores = made_up("DAgger", "mine", "PLAT")
    figure = ablation_bars(scores, "long")
    assert [text.get_text() for text in figure.axes[0].get_yticklabels()] == ["DAgger", "mine", "PLAT"]
    for panel, metric in zip(figure.axes, ("tks", "mpjpe", "mpkpe"), strict=True):
        figures = [score.figures[metric] for score in scores if score.horizon == "long"]
        assert [bar.get_width() for bar in panel.patches] == [
            METRICS[metric].factor * figure.value for figure in figures
        ]
        assert [bar.get_x() for bar in panel.patches] == [0, 0, 0]
        (intervals,) = panel.collections
        factor = METRICS[metric].factor
        for interval, wanted in zip(intervals.get_segments(), figures, strict=True):
            assert interval[0][0] == pytest.approx(factor * min(wanted.low, wanted.value))
            assert interval[1][0] == pytest.approx(factor * max(wanted.high, wanted.value))
        assert [text.get_text() for text in panel.texts] == [METRICS[metric].text(figure.value) for figure in figures]


def test_the_best_is_told_from_the_worst():
    titles = [panel.get_title() for panel in ablation_bars(made_up("PLAT"), "long").axes]
    assert titles == ["TKS@3 (%) ↑", "MPJPE@3 (rad) ↓", "MPKPE@3 (mm) ↓"]


def test_a_horizon_that_was_not_scored_is_named():
    with pytest.raises(ValueError, match=r"'single', expected one of \['long', 'mixed', 'short'\]"):
        ablation_bars(made_up("PLAT"), "single")


def test_where_all_failed_there_are_no_errors_to_draw():
    score = Score.of("bad", "long", [records(1.0, 0.1, 0.2)])
    panels = ablation_bars([score], "long").axes
    assert [[text.get_text() for text in panel.texts] for panel in panels] == [["0.0"], ["-"], ["-"]]
    for panel in panels:
        low, high = panel.get_xlim()
        assert low == 0 < high


@pytest.mark.parametrize(("metrics", "message"), [(["tsk"], "metric 'tsk': expected one of tks"), ([], "no metrics")])
def test_metrics_that_there_are_none_of_are_named(metrics, message):
    for plot in (partial(ablation_bars, horizon="long"), radar_plot):
        with pytest.raises(RecordsError, match=message):
            plot(made_up("PLAT"), metrics=metrics)
