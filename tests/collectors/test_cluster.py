import sys

import pytest

from plat.collectors import cluster
from plat.collectors.cluster import Cluster, check_ray, most_each
from plat.errors import ConfigError, WorkerError


@pytest.mark.parametrize(
    ("machines", "workers", "cpus"), [([2], 1, 2), ([2], 2, 1), ([16, 8], 3, 8), ([16, 8], 4, 5), ([3, 3], 2, 3)]
)
def test_workers_get_as_many_cpus_as_fit_on_the_machines(machines, workers, cpus):
    assert most_each(machines, workers) == cpus
    assert sum(have // (cpus + 1) for have in machines) < workers


def test_more_workers_than_cpus_are_refused():
    with pytest.raises(WorkerError, match="5 workers, expected at most 4, the CPUs of the cluster"):
        most_each([2, 2], 5)
    with pytest.raises(WorkerError, match="at most 0"):
        most_each([], 1)


def test_ray_that_is_not_installed_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ConfigError, match="pip install 'plat-rl.ray.'"):
        check_ray()
    with pytest.raises(ConfigError, match="pip install 'plat-rl.ray.'"):
        Cluster()


class StandIn:
    """Ray as far as joining a cluster goes: what is at some addresses."""

    def __init__(self, *reached: str):
        self.reached, self.tried, self.ended = reached, [], 0

    def is_initialized(self) -> bool:
        return False if not self.tried else self.tried[-1] in self.reached

    def init(self, address: str, **options: object) -> None:
        self.tried.append(address)
        if address not in self.reached:
            raise ConnectionError(f"nobody at {address}\nmore")

    def shutdown(self) -> None:
        self.ended += 1


@pytest.fixture
def stand_in(monkeypatch):
    def use(*reached: str) -> StandIn:
        ray = StandIn(*reached)
        monkeypatch.setitem(sys.modules, "ray", ray)
        monkeypatch.setattr(cluster, "check_ray", lambda: None)
        return ray

    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    return use


def test_the_cluster_of_this_machine_comes_before_a_new_one(stand_in):
    ray = stand_in("auto", "local")
    with Cluster() as joined:
        assert not joined.alone
    ray = stand_in("local")
    with Cluster() as started:
        assert started.alone
    assert ray.tried == ["auto", "local"]
    assert ray.ended == 1


def test_a_named_cluster_that_is_not_there_is_no_reason_for_another(stand_in, monkeypatch):
    ray = stand_in("local")
    monkeypatch.setenv("RAY_ADDRESS", "10.0.0.1:6379")
    with pytest.raises(WorkerError, match=r"RAY_ADDRESS '10.0.0.1:6379' cannot be reached \(nobody at 10.0.0.1:6379\)"):
        Cluster()
    assert ray.tried == ["10.0.0.1:6379"]
