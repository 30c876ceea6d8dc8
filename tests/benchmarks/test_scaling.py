import csv
import sys
from pathlib import Path

import pytest

from plat.motions import MotionLibrary

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from scaling import Row, ScalingConfig, draw, goal_windows, points, without_physics, write_table

ROWS = [
    Row("robots", 64, "PPO", "steps/s", 2000.0),
    Row("robots", 128, "PPO", "steps/s", 3000.0),
    Row("robots", 64, "peak memory", "MB", 450.0),
    Row("motions", 100, "everything but physics, a step", "ms", 4.5),
]


def test_one_thing_is_varied_at_a_time(tmp_path):
    config = ScalingConfig(robots=(8, 16), motions=(10.0,), rollouts=(10,), horizons=(25,), threads=(1,), num_envs=32)
    found = points(config, tmp_path)
    assert [point.axis for point in found] == ["robots", "robots", "motions", "rollout", "horizon", "threads"]
    assert [point.num_envs for point in found] == [8, 16, 32, 32, 32, 32]
    assert [point.rollout for point in found] == [24, 24, 24, 10, 24, 24]
    assert [point.horizon for point in found] == [50, 50, 50, 50, 25, 50]
    assert {point.motions for point in found} == {"generated:train", str(tmp_path / "10")}
    assert found[-1].threads == 1


def test_the_table_holds_every_row(tmp_path):
    write_table(ROWS, tmp_path / "table.csv")
    with (tmp_path / "table.csv").open() as file:
        rows = [
            Row(r["axis"], float(r["value"]), r["quantity"], r["unit"], float(r["figure"]))
            for r in csv.DictReader(file)
        ]
    assert rows == ROWS


def test_a_picture_is_drawn_of_whatever_was_measured(tmp_path):
    pytest.importorskip("matplotlib")
    draw(ROWS, tmp_path / "new" / "scaling.png")
    assert (tmp_path / "new" / "scaling.png").read_bytes().startswith(b"\x89PNG")


def test_steps_without_physics_are_timed_and_leave_the_robots_where_they_are(library: MotionLibrary):
    assert without_physics(library, 2)() > 0
    assert goal_windows(library, 2)() > 0
