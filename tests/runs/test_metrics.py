import csv

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
