"""Workers on a Ray cluster of two CPUs on this machine."""

import os
import signal
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import torch

from plat.collectors import WorkerRollouts, collect, ray_actors
from plat.collectors.ray_actors import RayActors, local_copy
from plat.envs import make_tracking_env
from plat.errors import MotionError, WorkerError
from tests.collectors.test_workers import assert_same, check_one_worker_is_as_one_process, flailing, motions
from tests.on_ray import local_cluster

ray = pytest.importorskip("ray", reason="Ray is not installed: pip install 'plat-rl[ray]'")
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module", autouse=True)
def cluster() -> Iterator[None]:
    with local_cluster(ray):
        yield


def kill(source: WorkerRollouts, number: int) -> None:
    actor = source._workers[number]._collector._actor
    os.kill(ray.get(actor.__ray_call__.remote(lambda self: os.getpid())), signal.SIGKILL)


def test_one_worker_is_as_one_process_even_if_it_is_killed(capsys):
    check_one_worker_is_as_one_process(kill, ray=True)
    assert "worker 0 ended" in capsys.readouterr().out
    assert ray.is_initialized()  # the cluster was there before


class Elsewhere(RayActors):
    """Actors on a machine that does not see the learner's file."""

    def share(self, *arguments: object) -> Callable:
        content = super().share(*arguments)
        (self._folder / "motions.pt").unlink()
        return content


def test_two_workers_elsewhere_go_on_from_a_state(tmp_path):
    policy = flailing()
    torch.manual_seed(1)
    host = Elsewhere()
    with collect(make_tracking_env, motions(), 5, policy, 20, workers=2, ahead=True, host=host) as source:
        copies = list(Path(tempfile.gettempdir()).glob(f"{host._folder.name}/*.pt"))
        assert len(copies) == 1
        first = next(source)
        assert first.shape == (5, 20)
        assert not torch.equal(first["action"][0], first["action"][3])  # the first robots of two streams
        with torch.no_grad():
            policy.module.scale.fill_(0.0)
        kill(source, 1)  # in the midst of the rollout that is simulated ahead
        second = next(source)
        assert (second["action"].std((1, 2)) > 2).all()  # begun before the weights changed
        torch.save(source.state_dict(), tmp_path / "state")
        third = next(source)
        assert (third["action"] == 0).all()
        source.load_state_dict(torch.load(tmp_path / "state", weights_only=True))
        assert_same(next(source), third)
    assert not copies[0].parent.exists()


def test_errors_of_plat_come_out_of_an_actor():
    def broken(*_: object, **options: object):
        raise MotionError("clip 'a': too short")

    with pytest.raises(MotionError, match=r"^clip 'a': too short$"):
        collect(broken, motions(), 2, flailing(), 1, workers=1, ray=True)
    with pytest.raises(WorkerError, match="3 workers, expected at most 2, the CPUs of the cluster"):
        collect(make_tracking_env, motions(), 3, flailing(), 1, workers=3, ray=True)


def test_a_machine_copies_the_motions_once(tmp_path, monkeypatch):
    monkeypatch.setattr(ray_actors, "_CHUNK", 1000)
    host = RayActors()
    try:
        content = host.share(motions(), make_tracking_env, flailing(), "auto")
        path, size, chunks, _ = content.args
        assert len(chunks) > 2
        assert local_copy(path, size, chunks) == path
        monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
        copy = local_copy(tmp_path / "gone" / "motions.pt", size, chunks)
        assert copy.read_bytes() == path.read_bytes()
        assert local_copy(tmp_path / "away" / "gone" / "motions.pt", size, ()) == copy  # the copy that is there
    finally:
        host.close()
    assert not path.exists()
