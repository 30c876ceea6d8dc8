from pathlib import Path

import pytest

from plat.cli import curves
from plat.errors import PlatError


def write_metrics(folder: Path) -> Path:
    folder.mkdir()
    (folder / "metrics.csv").write_text("step,seconds,loss,rare\n10,30,2.0,\n20,60,1.0,0.5\n")
    return folder


def test_values_over_minutes_skip_rows_without_one(tmp_path):
    run = write_metrics(tmp_path / "run")
    assert curves.read(run, "loss") == ([0.5, 1.0], [2.0, 1.0])
    assert curves.read(run, "rare") == ([1.0], [0.5])


def test_a_picture_is_written(tmp_path):
    pytest.importorskip("matplotlib")
    run = write_metrics(tmp_path / "run")
    curves.main(curves.CurvesRecipe(runs=(run,), metrics=("loss",), out=tmp_path / "new" / "curves.png"))
    assert (tmp_path / "new" / "curves.png").read_bytes().startswith(b"\x89PNG")


def test_values_below_zero_are_seen_and_runs_of_one_name_told_apart(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    drawn = []
    monkeypatch.setattr(curves, "write_figure", lambda figure, *_, **__: drawn.append(figure))
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        run = write_metrics(tmp_path / folder / "run")
        (run / "metrics.csv").write_text("step,seconds,gain,loss\n10,30,-2.0,2.0\n20,60,-1.0,1.0\n")
    runs = tuple(tmp_path / folder / "run" for folder in ("a", "b"))
    again = tmp_path / "a" / "." / "run"
    curves.main(curves.CurvesRecipe(runs=(*runs, again), metrics=("gain", "loss"), out=tmp_path / "curves.png"))
    gain, loss = drawn[0].axes
    assert gain.get_ylim()[0] < -2
    assert len(gain.lines) == 2  # a run that is named twice is drawn once
    assert loss.get_ylim()[0] == 0
    assert [text.get_text() for text in gain.get_legend().get_texts()] == [str(run) for run in runs]


@pytest.mark.parametrize("name", ["_best", "cost $5^$"])
def test_a_name_of_any_letters_stands_in_the_legend(tmp_path, monkeypatch, name):
    pytest.importorskip("matplotlib")
    drawn = []
    monkeypatch.setattr(curves, "write_figure", lambda figure, *_, **__: drawn.append(figure))
    curves.main(curves.CurvesRecipe(runs=(write_metrics(tmp_path / name),), metrics=("loss",), out=tmp_path / "c.png"))
    (text,) = drawn[0].axes[0].get_legend().get_texts()
    assert (text.get_text().strip(), text.get_parse_math()) == (name, False)


def test_a_folder_without_metrics_and_an_unknown_column_are_named(tmp_path):
    with pytest.raises(PlatError, match="nowhere/metrics.csv"):
        curves.read(tmp_path / "nowhere", "loss")
    with pytest.raises(PlatError, match="'gain', expected some of step, loss, rare$"):
        curves.read(write_metrics(tmp_path / "run"), "gain")


def test_no_runs_are_one_line():
    with pytest.raises(PlatError, match="no runs: give run directories"):
        curves.main(curves.CurvesRecipe(runs=()))


@pytest.mark.parametrize("text", ["step,loss\n10,2.0\n", "seconds,loss\n1,many\n", "seconds,loss\n1," + "1" * 200_000])
def test_a_broken_table_is_named(tmp_path, text):
    (tmp_path / "metrics.csv").write_text(text)
    with pytest.raises(PlatError, match=r"metrics.csv': not the metrics of a run \(.*\)$"):
        curves.read(tmp_path, "loss")


@pytest.mark.parametrize(
    ("columns", "shown"),
    [
        ("terminated,error/keypoint_aligned,terminations_per_second", "terminations_per_second error/keypoint_aligned"),
        ("failures_per_second,simulated_cost,model/loss", "failures_per_second simulated_cost"),
        ("terminated,prior_error,terminations_per_second", "terminations_per_second prior_error"),
        ("loss_imitation,error,terminations_per_second", "terminations_per_second error"),
    ],
    ids=["expert", "imagination", "distill", "distill-plain"],
)
def test_without_names_each_kind_of_run_shows_failures_and_its_error_or_cost(tmp_path, columns, shown):
    count = columns.count(",") + 1
    (tmp_path / "metrics.csv").write_text(f"step,seconds,{columns}\n10,30{',0.5' * count}\n")
    assert list(curves.shown_by_default([tmp_path])) == shown.split()


def test_runs_of_two_kinds_share_panels_where_both_have_the_column(tmp_path):
    pytest.importorskip("matplotlib")
    expert, imagined = tmp_path / "expert", tmp_path / "imagined"
    for run, text in (
        (expert, "step,seconds,terminations_per_second,simulated_cost\n1,3,0.5,2\n"),
        (imagined, "step,seconds,failures_per_second,simulated_cost\n1,3,0.5,2\n"),
    ):
        run.mkdir()
        (run / "metrics.csv").write_text(text)
    shown = curves.shown_by_default([expert, imagined])
    assert shown["simulated_cost"] == [expert, imagined]
    assert shown["failures_per_second"] == [imagined]
    curves.main(curves.CurvesRecipe(runs=(expert, imagined), out=tmp_path / "curves.png"))
    assert (tmp_path / "curves.png").exists()


def test_a_run_with_columns_of_its_own_is_asked_for_their_names(tmp_path):
    with pytest.raises(PlatError, match="which columns.* Expected --metrics with some of step, loss, rare$"):
        curves.shown_by_default([write_metrics(tmp_path / "run")])
