import pytest

from benchmarks.by_minutes import ByMinutesConfig, Point, by_minutes, main, read
from plat.errors import RecordsError

HEADER = "test,horizon,road,metric,minutes,seeds,mean,low,high\n"
ROWS = (
    "hard,mixed,ppo,tks,30,3,80,78,83\n"
    "hard,mixed,ppo,tks,8.5,3,60,57,61\n"
    "hard,mixed,imagine,tks,30,3,88,85,90\n"
    "hard,mixed,imagine,mpkpe,30,3,0.1,0.08,0.13\n"
    "clips,dense,imagine,failed,30,1,8,8,8\n"
)


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "roads.csv"
    path.write_text(HEADER + ROWS)
    return path


def test_points_are_in_the_units_of_tables(table):
    points = read([table])
    assert points[0] == Point(("hard, mixed", "TKS@3 (%)"), "ppo", 30.0, 80.0, 78.0, 83.0)
    assert points[3] == Point(("hard, mixed", "MPKPE@3 (mm)"), "imagine", 30.0, 100.0, 80.0, 130.0)
    assert points[4].panel == ("clips, dense", "failed")
    assert len(read([table, table], ["tks"])) == 6


def test_a_line_for_each_road_in_the_order_of_time(table):
    pytest.importorskip("matplotlib")
    figure = by_minutes(read([table]), across=2)
    first, second, third = figure.axes
    assert [axis.get_ylabel() for axis in figure.axes] == ["TKS@3 (%)", "MPKPE@3 (mm)", "failed"]
    ppo, imagine = (container[0] for container in first.containers)
    assert ppo.get_xydata().tolist() == [[8.5, 60.0], [30.0, 80.0]]
    assert imagine.get_xydata().tolist() == [[30.0, 88.0]]
    assert len(second.containers) == len(third.containers) == 1
    assert second.containers[0][0].get_color() == imagine.get_color() != ppo.get_color()
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["ppo", "imagine"]


def test_the_legend_has_roads_that_are_in_no_other_panel():
    pytest.importorskip("matplotlib")
    points = [Point((panel, "failed"), road, 30.0, 8.0, 7.0, 9.0) for panel, road in (("a", "ppo"), ("b", "imagine"))]
    (legend,) = by_minutes(points).legends
    assert [text.get_text() for text in legend.get_texts()] == ["ppo", "imagine"]


def test_figures_are_written(table, tmp_path):
    pytest.importorskip("matplotlib")
    written = main(ByMinutesConfig(tables=(table,), out=tmp_path / "images" / "roads", metrics=("tks",)))
    assert [path.name for path in written] == ["roads.pdf", "roads.png"]
    assert all(path.stat().st_size > 1000 for path in written)


@pytest.mark.parametrize(("text", "told"), [("a,b\n1,2\n", "not a table"), (HEADER, "no rows of tks")])
def test_another_table_is_named(tmp_path, text, told):
    path = tmp_path / "other.csv"
    path.write_text(text)
    with pytest.raises(RecordsError, match=rf"other\.csv.*{told}"):
        read([path], ["tks"])
