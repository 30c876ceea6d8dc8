"""Actors of a Ray cluster as hosts of workers: TorchRL's collector in each."""

import importlib
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import cloudpickle
import torch
from filelock import FileLock
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase

from plat.collectors.cluster import Cluster
from plat.collectors.hosts import EnvFactory, RemoteCollector
from plat.collectors.worker import LIBRARY_FILE, Content, Job, WorkerCollector, for_workers
from plat.errors import PlatError
from plat.files import replace_file
from plat.motions.library import MotionLibrary
from plat.precision import Precision
from plat.scratch import Scratch

__all__ = ["RayActors", "local_copy"]

_CHUNK = 1 << 26
"""Bytes of the motions' file that pass through Ray at a time."""


class RayActors:
    """Actors of a Ray cluster, see :class:`~plat.collectors.cluster.Cluster`.

    Motions lie in one file for each machine, which the workers there map into memory. A machine that does not see the
    learner's file makes a copy of it in its temporary folder.

    All machines have the same versions of Python, plat and its libraries.
    """

    # TorchRL's RayCollector is not beneath: it ends with the first actor that is lost, and what an environment raises
    # comes out of it as text.

    errors: Path | None = None

    def __init__(self) -> None:
        self._cluster = Cluster()
        self._ray: Any = self._cluster.ray
        self.ended: tuple[type[Exception], ...] = (self._ray.exceptions.RayError,)
        self._scratch = Scratch("plat-workers-")
        self._folder = self._scratch.path
        self._chunks: tuple[Any, ...] = ()

    def share(
        self, library: MotionLibrary, make_env: EnvFactory, policy: TensorDictModuleBase, precision: Precision
    ) -> Callable[[], Content]:
        """Write the motions into a file, and hand it to Ray where there may be other machines.

        Raises:
            OutputError: when the disk does not take it.
        """
        library, path = library.to("cpu"), self._folder / LIBRARY_FILE
        with for_workers(self._folder):
            torch.save(library, path)
        if not self._cluster.alone:
            with path.open("rb") as file:
                self._chunks = tuple(map(self._ray.put, iter(partial(file.read, _CHUNK), b"")))
        parts = cloudpickle.dumps((make_env, policy, precision))
        return partial(_content, path, path.stat().st_size, self._chunks, parts)

    def threads(self, workers: int) -> int:
        """Return the CPUs of the cluster's machines for each worker.

        Raises:
            WorkerError: for more workers than CPUs.
        """
        return self._cluster.cpus_each(workers)

    def launch(self, job: Job) -> RemoteCollector:
        """Start an actor. It waits until the cluster has room for it."""
        actor = self._ray.remote(RayWorker).options(num_cpus=job.num_threads).remote()
        collector = _Remote(self._ray, actor)
        try:
            collector.ask("begin", job)
        except BaseException:
            collector.shutdown()
            raise
        return collector

    def cause(self, job: Job, error: Exception) -> PlatError | None:
        """Return what the actor raised: Ray passes it on."""
        cause = getattr(error, "cause", None)
        return cause if isinstance(cause, PlatError) else None

    def close(self) -> None:
        """Remove the files, on all machines."""
        if self._chunks and self._ray.is_initialized():
            self._remove_copies()
        self._scratch.remove()
        self._cluster.close()

    def _remove_copies(self) -> None:
        name, self._chunks = self._folder.name, ()

        def remove() -> None:  # goes to the other machines by value, so that they need not import this module
            shutil.rmtree(Path(tempfile.gettempdir()) / name, ignore_errors=True)

        on = importlib.import_module("ray.util.scheduling_strategies").NodeAffinitySchedulingStrategy
        task = self._ray.remote(remove)
        strategies = [on(machine["NodeID"], soft=True) for machine in self._cluster.machines()]
        removed = [task.options(num_cpus=0, scheduling_strategy=strategy).remote() for strategy in strategies]
        self._ray.wait(removed, num_returns=len(removed), timeout=10)


class RayWorker:
    """A worker's collector, in an actor of Ray."""

    def begin(self, job: Job) -> None:
        """Make the environment, the policy and their collector."""
        self._collector = WorkerCollector(
            job.environment(),
            job.policy(),
            frames_per_batch=job.num_envs * job.steps,
            track_traj_ids=False,
            trust_policy=True,
            auto_register_policy_transforms=False,
        )
        self._rollouts = iter(self._collector)

    def rollout(self) -> TensorDictBase:
        """Return the next rollout."""
        return next(self._rollouts)

    def call(self, method: str, arguments: tuple[Any, ...]) -> Any:
        """Return what a method of the collector returns."""
        return getattr(self._collector, method)(*arguments)


class _Remote:
    """What speaks with a :class:`RayWorker`."""

    def __init__(self, ray: Any, actor: Any):
        self._ray, self._actor = ray, actor

    def ask(self, method: str, *arguments: Any) -> Any:
        """Return what a method of the actor returns."""
        return self._ray.get(getattr(self._actor, method).remote(*arguments))

    def __iter__(self) -> Iterator[TensorDictBase]:
        while True:
            yield self.ask("rollout")

    def map_fn(self, method_name: str, list_of_args: Sequence[tuple[Any, ...]]) -> list[Any]:
        """Call a method of its collector."""
        return [self.ask("call", method_name, tuple(arguments)) for arguments in list_of_args]

    def shutdown(self) -> None:
        """End the actor."""
        self._ray.kill(self._actor)


@lru_cache(maxsize=1)
def _content(path: Path, size: int, chunks: Sequence[Any], parts: bytes) -> Content:
    """Return what a worker needs, in the worker."""
    library = torch.load(local_copy(path, size, chunks), weights_only=False, mmap=True)
    return (library, *cloudpickle.loads(parts))


def local_copy(path: Path, size: int, chunks: Sequence[Any]) -> Path:
    """Return a file of the learner's on this machine: itself where it is seen, else the only copy for all workers.

    Args:
        path: of the file, there.
        size: its bytes.
        chunks: references of Ray to its parts.
    """
    if path.exists() and path.stat().st_size == size:
        return path
    copy = Path(tempfile.gettempdir()) / path.parent.name / path.name
    copy.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(f"{copy}.lock"):
        if not copy.exists():
            replace_file(copy, partial(_fetch, chunks))
    return copy


def _fetch(chunks: Sequence[Any], part: Path) -> None:
    get = importlib.import_module("ray").get
    with part.open("wb") as file:
        for chunk in chunks:
            file.write(get(chunk))
