"""Hosts of workers: where they run, and how they get what they need. Here are processes on this machine."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Protocol

import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torchrl.collectors import MultiSyncCollector
from torchrl.envs import EnvBase

from plat.collectors.worker import Content, Job, WorkerCollector, in_folder
from plat.envs.physics import available_cpus
from plat.errors import PlatError
from plat.motions.library import MotionLibrary
from plat.pools import deaf_to_interrupts
from plat.precision import Precision
from plat.scratch import Scratch

__all__ = ["EnvFactory", "Host", "Processes", "RemoteCollector"]


class EnvFactory(Protocol):
    """Protocol of a factory of environments, such as :func:`plat.envs.make_tracking_env`.

    It is sent to other processes by cloudpickle, so it may be a ``partial`` or a function in a function.
    """

    def __call__(
        self, library: MotionLibrary, num_envs: int, *, num_threads: int | None, device: torch.device | str
    ) -> EnvBase:
        """Create the environment of ``num_envs`` robots."""


class RemoteCollector(Protocol):
    """Protocol of what speaks with a :class:`~plat.collectors.worker.WorkerCollector` elsewhere."""

    def __iter__(self) -> Iterator[TensorDictBase]:
        """Return an iterator over its rollouts."""

    def map_fn(self, method_name: str, list_of_args: Sequence[tuple[Any, ...]]) -> list[Any]:
        """Call one of its methods, with the only arguments of the list; a list of what it returns."""

    def shutdown(self) -> None:
        """End the worker."""


class Host(Protocol):
    """Protocol of where workers run, such as :class:`Processes`."""

    ended: tuple[type[Exception], ...]
    """What is raised when a worker has ended."""
    errors: Path | None
    """Folder in which workers leave plat's errors; None where they raise them."""

    def share(
        self, library: MotionLibrary, make_env: EnvFactory, policy: TensorDictModuleBase, precision: Precision
    ) -> Callable[[], Content]:
        """Lay out what all workers need; the function that returns it in a worker."""

    def threads(self, workers: int) -> int:
        """Return the CPUs of each of some workers."""

    def launch(self, job: Job) -> RemoteCollector:
        """Start a worker, and return what speaks with its collector."""

    def cause(self, job: Job, error: Exception) -> PlatError | None:
        """Return the error of plat that a worker ended with, if it was one."""

    def close(self) -> None:
        """Remove what was laid out."""


class Processes:
    """Processes on this machine."""

    ended: tuple[type[Exception], ...] = (RuntimeError, OSError, EOFError)

    def __init__(self) -> None:
        self._scratch = Scratch("plat-workers-")
        self.errors = self._scratch.path

    def share(
        self, library: MotionLibrary, make_env: EnvFactory, policy: TensorDictModuleBase, precision: Precision
    ) -> Callable[[], Content]:
        """Write the motions and the rest into files."""
        return in_folder(self.errors, library, make_env, policy, precision)

    def threads(self, workers: int) -> int:
        """Return this machine's CPUs for each worker, at least 1."""
        return max(1, available_cpus() // workers)

    def launch(self, job: Job) -> RemoteCollector:
        """Start a process."""
        with deaf_to_interrupts():
            return MultiSyncCollector(
                [job.environment],
                policy_factory=job.policy,
                frames_per_batch=job.num_envs * job.steps,
                collector_class=WorkerCollector,
                num_threads=torch.get_num_threads(),
                cat_results=0,
                use_buffers=True,
                trust_policy=True,
                auto_register_policy_transforms=False,
            )

    def cause(self, job: Job, error: Exception) -> PlatError | None:
        """Return what the worker left in its file: TorchRL passes no errors on."""
        return job.reported()

    def close(self) -> None:
        """Remove the files."""
        self._scratch.remove()
