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


def test_a_folder_without_metrics_and_an_unknown_column_are_named(tmp_path):
    with pytest.raises(PlatError, match="nowhere/metrics.csv"):
        curves.read(tmp_path / "nowhere", "loss")
    with pytest.raises(PlatError, match="'gain'"):
        curves.read(write_metrics(tmp_path / "run"), "gain")


def test_no_runs_are_one_line():
    with pytest.raises(PlatError, match="no runs: give run directories"):
        curves.main(curves.CurvesRecipe(runs=()))


@pytest.mark.parametrize("text", ["step,loss\n10,2.0\n", "seconds,loss\n1,many\n", "seconds,loss\n1," + "1" * 200_000])
def test_a_broken_table_is_named(tmp_path, text):
    (tmp_path / "metrics.csv").write_text(text)
    with pytest.raises(PlatError, match=r"metrics.csv': not the metrics of a run \(.*\)$"):
        curves.read(tmp_path, "loss")
