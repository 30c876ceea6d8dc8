"""Tasks on a Ray cluster of two CPUs on this machine."""

import os
import signal
from functools import partial
from pathlib import Path

import pytest

from plat.collectors.cluster import Cluster
from plat.errors import MotionError, WorkerError
from plat.runs.ray_tasks import RayTask, run_tasks
from tests.on_ray import local_cluster

ray = pytest.importorskip("ray", reason="Ray is not installed: pip install 'plat-rl[ray]'")
pytestmark = pytest.mark.slow


def note(path: Path, needed: Path | None = None) -> None:
    assert needed is None or needed.exists()
    path.write_text(f"{os.getpid()}")


def fail(message: str) -> None:
    raise MotionError(message)


def die_once(path: Path) -> None:
    if not path.exists():
        path.write_text("")
        os.kill(os.getpid(), signal.SIGKILL)


def test_tasks_wait_fail_and_are_begun_again(tmp_path):
    first, second = tmp_path / "first", tmp_path / "second"
    tasks = [
        RayTask("first", partial(note, first)),
        RayTask("second", partial(note, second, first), ("first",)),
        RayTask("broken", partial(fail, "clip 'a': too short"), cpus=2),
        RayTask("after", partial(note, tmp_path / "after"), ("broken",)),
        RayTask("killed", partial(die_once, tmp_path / "killed")),
    ]
    with local_cluster(ray), Cluster() as cluster:
        outcomes = {task.name: error for task, error in run_tasks(tasks, cluster)}
        for task in (RayTask("large", fail, cpus=3), RayTask("gpu", fail, gpus=1.0)):
            with pytest.raises(WorkerError, match=f"{task.name}: no machine of the cluster has {task.cpus} CPUs"):
                next(run_tasks([task], cluster))
    assert outcomes.keys() == {task.name for task in tasks}
    assert [outcomes[name] for name in ("first", "second", "killed")] == [None] * 3
    assert first.read_text() != second.read_text()  # a process each
    assert isinstance(outcomes["broken"], MotionError)
    assert str(outcomes["broken"]) == "clip 'a': too short"
    assert str(outcomes["after"]) == "needs 'broken', which failed"
    assert not (tmp_path / "after").exists()
