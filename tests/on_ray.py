"""A Ray cluster of two CPUs on this machine, for the tests that need one."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

SLOW_MACHINE = {
    "RAY_worker_niceness": "0",  # beside other tests a worker with Ray's 15 takes minutes to import torch
    "RAY_raylet_start_wait_time_s": "300",
    "RAY_worker_register_timeout_seconds": "300",
    "RAY_AUTH_MODE": "disabled",
}


@contextmanager
def local_cluster(ray: Any) -> Iterator[None]:
    """Connect this process to a new cluster, and end it."""
    before = {name: os.environ.get(name) for name in (*SLOW_MACHINE, "RAY_ADDRESS")}
    os.environ.update(SLOW_MACHINE)
    os.environ.pop("RAY_ADDRESS", None)
    try:
        ray.init(
            address="local",
            num_cpus=2,
            object_store_memory=100 * 2**20,
            include_dashboard=False,
            log_to_driver=False,
            logging_level="warning",
        )
        yield
    finally:
        ray.shutdown()
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
