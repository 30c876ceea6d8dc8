import pytest

from plat.errors import RecordsError
from plat.figures import success_plot
from tests.figures.scores import made_up

pytest.importorskip("matplotlib")


def test_curves_and_their_areas():
    scores = made_up("DAgger", "PLAT")
    figure = success_plot(scores, ["long", "mixed"])
    assert [panel.get_title() for panel in figure.axes] == ["Long", "Mixed"]
    line = figure.axes[0].lines[1]
    plat = next(score for score in scores if (score.policy, score.horizon) == ("PLAT", "long"))
    # every command of it that did not fail arrives 0.2 m off
    x, share = line.get_xdata(), line.get_ydata()
    assert (x[0], x[-1]) == (0, 500)
    assert (share[x < 199] == 0).all()
    assert share[x > 201] == pytest.approx(plat.figures["tks"].value)
    assert line.get_label() == f"PLAT ({plat.figures['success_area'].value:.1f})"
    # the area under what is drawn
    area = 100 * (share[:-1] * (x[1:] - x[:-1])).sum() / 50_000
    assert area == pytest.approx(plat.figures["success_area"].value, abs=0.5)


def test_one_horizon_fits_a_column():
    assert success_plot(made_up("PLAT"), ["mixed"]).get_figwidth() < 4


def test_long_names_leave_the_curves_their_room():
    figure = success_plot(
        made_up("PLAT", "run-of-the-evening-with-everything", "another-run-with-half-of-everything"), ["long"]
    )
    figure.canvas.draw()
    panel = figure.axes[0]
    whole = figure.bbox.width
    assert panel.get_window_extent().width > 0.6 * whole
    assert panel.get_legend().get_window_extent().width < whole


@pytest.mark.parametrize("horizons", [[], ["long", "single"]])
def test_horizons_that_were_not_scored_are_named(horizons):
    with pytest.raises(RecordsError, match=r"expected one or more of \['long', 'mixed', 'short'\]"):
        success_plot(made_up("PLAT"), horizons)
