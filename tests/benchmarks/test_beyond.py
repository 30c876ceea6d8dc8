import sys
from contextlib import ExitStack
from functools import cache
from pathlib import Path

import pytest

from plat.envs import TrackingTaskConfig
from plat.errors import ConfigError
from plat.motions import MotionLibrary, generate_motions

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import beyond
from beyond import in_workers, large_library, on_warp


@cache
def motions() -> MotionLibrary:
    return MotionLibrary.from_clips(generate_motions("val", seconds=8))


def test_a_large_library_is_opened_and_drawn_from(tmp_path):
    rows = large_library(tmp_path, clips=50, hours=0.01, robots=8)
    assert list(rows) == ["table of 50 clips, 0.01 h: opening", "table of 50 clips, 0.01 h: drawing 8 starts"]
    assert all(cost.unit == "ms" and cost.measure() > 0 for cost in rows.values())


def test_warp_that_is_not_installed_is_left_out(monkeypatch, capsys):
    def missing(*_: object):
        raise ConfigError("physics 'warp' needs: pip install 'plat-rl[warp]'")

    monkeypatch.setattr(beyond, "WarpPhysics", missing)
    assert on_warp(motions(), 2) == {}
    assert "not measured: physics 'warp' needs" in capsys.readouterr().out


class Still:
    """Physics that counts its steps."""

    def __init__(self, model: object, count: int):
        self.count, self.steps = count, 0

    def set_state(self, robots, qpos, qvel) -> None:
        assert len(robots) == len(qpos) == len(qvel) == self.count

    def step(self, ctrl, nstep: int) -> None:
        assert ctrl.shape == (self.count, 29)
        self.steps += nstep


def test_warp_follows_the_motions(monkeypatch):
    monkeypatch.setattr(beyond, "WarpPhysics", Still)
    (cost,) = on_warp(motions(), 3).values()
    assert cost.measure() > 0


@pytest.mark.slow
def test_rollouts_of_one_worker_and_of_two():
    with ExitStack() as stack:
        rows = in_workers(motions(), 4, TrackingTaskConfig(), 3, stack)
        assert list(rows) == ["policy and collector, 1 worker", "policy and collector, 2 workers"]
        assert all(cost.measure() > 0 for cost in rows.values())
