import pytest

from plat.errors import RecordsError
from plat.evaluation import METRICS, Score
from plat.figures import radar_plot
from tests.figures.scores import made_up, records

pytest.importorskip("matplotlib")


def outline(panel, name: str) -> list[float]:
    line = next(line for line in panel.lines if line.get_label() == name)
    return list(line.get_ydata())


def test_outlines_are_the_figures_and_close():
    scores = made_up("DAgger", "PLAT")
    figure = radar_plot(scores)
    assert len(figure.axes) == 3
    for panel, metric in zip(figure.axes, ("tks", "mpjpe", "mpkpe"), strict=True):
        for name in ("DAgger", "PLAT"):
            wanted = [METRICS[metric].factor * score.figures[metric].value for score in scores if score.policy == name]
            assert outline(panel, name) == [*wanted, wanted[0]]
        assert [text.get_text() for text in panel.get_xticklabels()] == ["Short", "Long", "Mixed"]


def test_outward_is_better():
    tks, mpjpe, _ = radar_plot(made_up("DAgger", "PLAT")).axes
    center, rim = tks.get_ylim()
    assert center < min(outline(tks, "DAgger")) <= max(outline(tks, "PLAT")) <= rim
    center, rim = mpjpe.get_ylim()
    assert center > max(outline(mpjpe, "DAgger")) >= min(outline(mpjpe, "PLAT")) >= rim


@pytest.mark.parametrize("policies", [("PLAT",), ("DAgger", "PLAT")])
def test_rings_are_round_numbers_around_the_values(policies):
    scores = made_up(*policies)
    for panel in radar_plot(scores).axes:
        rings = panel.get_yticks()
        assert 1 <= len(rings) <= 6
        labels = [float(text.get_text()) for text in panel.texts]
        assert labels == pytest.approx(list(rings))


def test_nothing_is_drawn_below_zero():
    scores = [Score.of("expert", horizon, [records(1.0, 0.1, 0.2)]) for horizon in ("short", "long")]
    panel = radar_plot([*scores, *made_up("expert", horizons=("mixed",))]).axes[0]
    assert panel.get_ylim()[0] == 0
    assert panel.get_yticks()[0] > 0
    assert outline(panel, "expert")[0] == 0


def test_equal_figures_make_a_plot():
    scores = made_up("PLAT")
    same = [type(score)(score.policy, score.horizon, score.records, scores[0].figures) for score in scores]
    assert len(set(outline(radar_plot(same).axes[0], "PLAT"))) == 1


def test_a_policy_that_lacks_a_horizon_is_left_out():
    figure = radar_plot(made_up("DAgger", "PLAT")[:-1])
    assert [line.get_label() for line in figure.axes[0].lines] == ["DAgger"]


def test_two_horizons_are_no_radar():
    with pytest.raises(ValueError, match="expected three or more"):
        radar_plot(made_up("PLAT", horizons=("long", "mixed")))


def test_policies_that_lack_a_horizon_each_are_no_radar():
    scores = made_up("DAgger", horizons=("short", "long")) + made_up("PLAT", horizons=("mixed",))
    with pytest.raises(RecordsError, match=r"no policy was scored at all of \['short', 'long', 'mixed'\]"):
        radar_plot(scores)


def test_where_all_failed_the_scale_begins_at_zero():
    scores = [Score.of("bad", horizon, [records(1.0, 0.1, 0.2)]) for horizon in ("short", "long", "mixed")]
    center, rim = radar_plot(scores).axes[0].get_ylim()
    assert center == 0 < rim
