import csv

import pytest

from plat.runs import MetricsFile


def rows(path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_new_columns_keep_old_rows(tmp_path):
    metrics = MetricsFile(tmp_path / "m.csv")
    metrics.write(1, {"a": 1.0})
    metrics.write(2, {"b": 2.0})
    metrics.write(3, {"a": 3.0, "b": 4.0})
    assert rows(tmp_path / "m.csv") == [
        {"step": "1", "a": "1", "b": ""},
        {"step": "2", "a": "", "b": "2"},
        {"step": "3", "a": "3", "b": "4"},
    ]


def test_a_resumed_run_drops_what_came_after_its_checkpoint(tmp_path):
    first = MetricsFile(tmp_path / "m.csv")
    for step in (10, 20, 30):
        first.write(step, {"a": step})
    second = MetricsFile(tmp_path / "m.csv", keep_until=20)
    second.write(25, {"a": 25})
    assert [row["step"] for row in rows(tmp_path / "m.csv")] == ["10", "20", "25"]


def test_a_row_that_a_kill_cut_short_is_dropped(tmp_path):
    path = tmp_path / "m.csv"
    path.write_text("step,a,b\n10,1,2\n20,3,4\n3")
    MetricsFile(path, keep_until=100).write(30, {"a": 5.0, "b": 6.0})
    assert [row["step"] for row in rows(path)] == ["10", "20", "30"]


def test_a_new_run_starts_an_empty_file(tmp_path):
    path = tmp_path / "m.csv"
    path.write_text("step,a\n10,1\n")
    MetricsFile(path)
    assert rows(path) == []


@pytest.mark.parametrize(
    ("content", "kept"),
    [
        (b"\x00\xff\x13 nothing of a table", []),
        (b"", []),
        (b"loss,step\n1,2\n", []),
        (b"step,loss\n1,0.5\n\x00\x00\x00\n2,0.4\n3,0.3\n", ["1", "2", "3"]),
        (b"step,loss\n1,0.5\nhalf\n2,0.4\n3,\xff\xfe\n", ["1", "2"]),
        (b"step,loss\n" + b"9" * 200_000 + b",1\n1,0.5\n", ["1"]),
        (b"step,loss\n" + b"x" * 200_000 + b"\n1,0.5\n", ["1"]),
    ],
)
def test_a_damaged_file_is_put_aside_and_its_rows_are_kept(tmp_path, capsys, content, kept):
    path = tmp_path / "metrics.csv"
    path.write_bytes(content)
    metrics = MetricsFile(path, keep_until=3)
    metrics.write(4, {"loss": 0.2})
    with path.open(newline="") as file:
        assert [row["step"] for row in csv.DictReader(file)] == [*kept, "4"]
    assert "is damaged" in capsys.readouterr().out
    assert (tmp_path / "damaged-metrics.csv").read_bytes() == content


def test_a_row_cut_short_by_a_kill_is_no_damage(tmp_path, capsys):
    path = tmp_path / "metrics.csv"
    path.write_text("step,loss,kl\n1,0.5,0.1\n2,0.")
    MetricsFile(path, keep_until=3)
    assert path.read_text() == "step,loss,kl\n1,0.5,0.1\n"
    assert capsys.readouterr().out == ""


def test_a_folder_in_the_place_of_the_file_stops_nothing(tmp_path):
    (tmp_path / "metrics.csv").mkdir()
    MetricsFile(tmp_path / "metrics.csv").write(1, {"loss": 0.5})
    assert (tmp_path / "metrics.csv").read_text() == "step,loss\n1,0.5\n"


def test_a_folder_that_comes_in_its_place_later_stops_nothing(tmp_path, capsys):
    metrics = MetricsFile(tmp_path / "metrics.csv")
    metrics.write(1, {"loss": 0.5})
    metrics.path.unlink()
    metrics.path.mkdir()
    for step in (2, 3):
        metrics.write(step, {"loss": 0.5, "kl": 0.1})
    assert "cannot be written" in capsys.readouterr().out
    metrics.path.rmdir()
    metrics.close()
    assert [row["step"] for row in rows(metrics.path)] == ["1", "2", "3"]


def test_rows_that_are_missing_at_the_end_are_told_of(tmp_path, capsys, monkeypatch):
    metrics = MetricsFile(tmp_path / "metrics.csv")
    metrics.write(1, {"loss": 0.5})

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as disk:
        disk.setattr("plat.runs.metrics.replace_file", full)
        metrics.write(2, {"loss": 0.4, "kl": 0.1})
        metrics.close()
        assert "lacks rows of this run" in capsys.readouterr().out
    metrics.close()  # there is space again
    assert rows(metrics.path)[-1]["step"] == "2"
    assert capsys.readouterr().out == ""
