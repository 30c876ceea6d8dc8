"""Ray clusters on this machine, for the tests that need one."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_SLOW_MACHINE = {
    "RAY_worker_niceness": "0",  # beside other tests a worker with Ray's 15 takes minutes to import torch
    "RAY_raylet_start_wait_time_s": "300",
    "RAY_worker_register_timeout_seconds": "300",
    "RAY_AUTH_MODE": "disabled",
}
_MEMORY = 100 * 2**20


@contextmanager
def _settings() -> Iterator[None]:
    before = {name: os.environ.get(name) for name in (*_SLOW_MACHINE, "RAY_ADDRESS")}
    os.environ.update(_SLOW_MACHINE)
    os.environ.pop("RAY_ADDRESS", None)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@contextmanager
def local_cluster(ray: Any) -> Iterator[None]:
    """Connect this process to a new cluster of two CPUs, and end it."""
    with _settings():
        try:
            ray.init(
                address="local",
                num_cpus=2,
                object_store_memory=_MEMORY,
                include_dashboard=False,
                log_to_driver=False,
                logging_level="warning",
            )
            yield
        finally:
            ray.shutdown()


class Machines:
    """Machines of a cluster, one CPU each."""

    def __init__(self) -> None:
        from ray.cluster_utils import Cluster

        self.cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "object_store_memory": _MEMORY})
        self._other = self._add()

    def _add(self) -> Any:
        return self.cluster.add_node(num_cpus=1, object_store_memory=_MEMORY)

    def lose_one(self) -> None:
        """Kill all of a machine, and bring in another."""
        self.cluster.remove_node(self._other, allow_graceful=False)
        self._other = self._add()


@contextmanager
def two_machines(ray: Any) -> Iterator[Machines]:
    """Connect this process to a new cluster of two machines, and end it."""
    with _settings():
        machines = Machines()
        try:
            ray.init(address=machines.cluster.address, log_to_driver=False, logging_level="warning")
            yield machines
        finally:
            ray.shutdown()
            machines.cluster.shutdown()
