"""Ray clusters: joining the one that there is, and CPUs of its machines."""

import importlib
import logging
import os
from collections.abc import Sequence
from types import ModuleType
from typing import Any

from plat.errors import ConfigError, WorkerError
from plat.extras import require
from plat.words import counted

__all__ = ["Cluster", "check_ray", "most_each"]


def check_ray() -> None:
    """Raise an error where Ray is not installed.

    Raises:
        ConfigError: saying what to install.
    """
    require("ray", "--ray needs", "ray", error=ConfigError)


class Cluster:
    """Ray cluster that this process has joined.

    It is the one that the process is already connected to, else the one at ``RAY_ADDRESS``, else one that this machine
    is part of (``ray start``). Where there is none, one is started on this machine until :meth:`close`.

    Raises:
        ConfigError: where Ray is not installed.
        WorkerError: where no cluster can be joined or started.

    Attributes:
        ray: the package.
        alone: whether the cluster is this machine, for this process.
    """

    def __init__(self) -> None:
        check_ray()
        self.ray: ModuleType = importlib.import_module("ray")
        self.alone = False
        self._joined = not self.ray.is_initialized()
        if self._joined:
            self._join()

    def _join(self) -> None:
        options: dict[str, Any] = {"logging_level": logging.WARNING}
        named = os.environ.get("RAY_ADDRESS")
        try:
            try:
                self.ray.init(address=named or "auto", **options)
            except ConnectionError:
                if named:
                    raise
                self.ray.init(address="local", include_dashboard=False, **options)
                self.alone = True
        except (ConnectionError, RuntimeError, ValueError, TimeoutError) as error:
            where = f"RAY_ADDRESS {named!r}" if named else "a cluster on this machine"
            reason = (str(error).splitlines() or [type(error).__name__])[0]
            raise WorkerError(f"--ray: {where} cannot be reached ({reason})") from error

    def machines(self) -> list[dict[str, Any]]:
        """Return what Ray knows of each machine that is there."""
        return [node for node in self.ray.nodes() if node["Alive"]]

    def cpus_each(self, workers: int) -> int:
        """Return the CPUs of each of some workers, see :func:`most_each`."""
        return most_each([int(node["Resources"].get("CPU", 0)) for node in self.machines()], workers)

    def close(self) -> None:
        """Leave the cluster, if the process joined it here; end it, if it was started here."""
        if self._joined and self.ray.is_initialized():
            self.ray.shutdown()

    def __enter__(self) -> "Cluster":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def most_each(machines: Sequence[int], workers: int) -> int:
    """Return the most CPUs that each of some workers can have, all on one machine.

    Args:
        machines: CPUs of each.
        workers: their number.

    Raises:
        WorkerError: for more workers than CPUs.

    >>> most_each([16, 8], 3), most_each([16, 8], 4)
    (8, 5)
    """
    for cpus in range(max(machines, default=0), 0, -1):
        if sum(have // cpus for have in machines) >= workers:
            return cpus
    raise WorkerError(f"--ray: {counted(workers, 'worker')}, expected at most {sum(machines)}, the CPUs of the cluster")
