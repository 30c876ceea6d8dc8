"""What runs inside a worker: its environment and policy, made of a job, and a collector that takes orders."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import NamedTuple, TypeAlias

import cloudpickle
import numpy as np
import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor
from torchrl.collectors import Collector
from torchrl.envs import EnvBase

from plat import errors
from plat.collectors.packing import packed, unpacked
from plat.collectors.rollouts import ActingPolicy, check_timings, gathered, restore, state_of
from plat.errors import OutputError, PlatError
from plat.files import is_full
from plat.motions.library import MotionLibrary
from plat.precision import Precision

__all__ = [
    "LIBRARY_FILE",
    "Content",
    "Job",
    "Order",
    "Report",
    "WorkerCollector",
    "for_workers",
    "in_folder",
    "seed_of",
]

LIBRARY_FILE, _PARTS = "motions.pt", "parts.pickle"


class Order(NamedTuple):
    """What a worker is told before a rollout."""

    weights: bytes
    """state of the policy, :func:`packed`"""
    random: Tensor | None
    """state of the random stream; None where the worker has one of its own"""


class Report(NamedTuple):
    """What a worker says after a rollout."""

    statistics: dict[str, float]
    """means that its environment gathered"""
    state: bytes
    """state of robots, transforms, last observation and random stream, :func:`packed`"""
    random: Tensor
    """state of the random stream"""


Content: TypeAlias = tuple[MotionLibrary, Callable[..., EnvBase], TensorDictModuleBase, Precision]
"""What all workers need: motions, factory of environments, policy and its precision."""


@dataclass(frozen=True)
class Job:
    """A worker's share of the work.

    Attributes:
        content: returns, in the worker, the motions, the factory of environments, the policy and its precision.
        number: of the worker.
        num_envs: its robots n.
        steps: control steps of a rollout.
        num_threads: of its physics pool.
        random: seed, or state of the random stream.
        errors: folder for what plat's errors in the worker say; None where they come by themselves.
    """

    content: Callable[[], Content]
    number: int
    num_envs: int
    steps: int
    num_threads: int
    random: int | Tensor
    errors: Path | None = None

    @property
    def environment(self) -> Callable[[], EnvBase]:
        """Return the factory of its environment, for another process."""
        return partial(_environment, self)

    @property
    def policy(self) -> Callable[[], TensorDictModuleBase]:
        """Return the factory of its policy, for another process."""
        return partial(_policy, self)

    def reported(self) -> PlatError | None:
        """Return the error of plat that the worker left in the folder of errors, if it did."""
        path = None if self.errors is None else self.errors / f"error-{self.number}"
        if path is None or not path.exists():
            return None
        name, _, message = path.read_text(encoding="utf-8").partition(": ")
        return getattr(errors, name, PlatError)(message)


_worker: list[Job] = []
"""The job of this process, if it is a worker."""


def _environment(job: Job) -> EnvBase:
    """Return the environment of a job, in the worker."""
    with suppress(ValueError):  # not in the main thread
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that learns, which ends its workers
    torch.set_num_threads(1)
    _worker[:] = [job]
    library, make_env, policy, _ = job.content()
    if isinstance(job.random, int):
        torch.manual_seed(job.random)
    else:
        torch.set_rng_state(job.random)
    with _told(job):
        env = make_env(library, job.num_envs, num_threads=job.num_threads, device="cpu")
        check_timings(env, policy)
        return env


def _policy(job: Job) -> TensorDictModuleBase:
    """Return the policy of a job, in the worker."""
    _, _, policy, precision = job.content()
    return ActingPolicy(policy, torch.device("cpu"), precision)


@contextmanager
def _told(job: Job) -> Iterator[None]:
    """Leave plat's errors where the process that learns finds them: TorchRL passes none on."""
    try:
        yield
    except PlatError as error:
        if job.errors is not None:
            (job.errors / f"error-{job.number}").write_text(f"{type(error).__name__}: {error}", encoding="utf-8")
        raise


class WorkerCollector(Collector):
    """TorchRL's collector in a worker, which takes weights before a rollout and reports its state after it."""

    def rollout(self) -> TensorDictBase:
        """Return the next rollout ``[n, steps]``."""
        with _told(_worker[0]):
            return super().rollout()

    def begin(self, order: Order) -> None:
        """Take the weights, and the random stream if it is the caller's."""
        _, _, policy, _ = _worker[0].content()
        policy.load_state_dict(unpacked(order.weights))
        if order.random is not None:
            torch.set_rng_state(order.random)

    def report(self) -> Report:
        """Return what was gathered, and the state that the next rollout begins in."""
        random = torch.get_rng_state()
        return Report(gathered(self.env), packed({**state_of(self), "random": random}), random)

    def resume(self, state: bytes) -> None:
        """Go on from a state that :meth:`report` returned."""
        values = unpacked(state)
        restore(self, values)
        if "random" in values:  # else it comes with the orders
            torch.set_rng_state(values["random"])


def in_folder(
    folder: Path,
    library: MotionLibrary,
    make_env: Callable[..., EnvBase],
    policy: TensorDictModuleBase,
    precision: Precision,
) -> Callable[[], Content]:
    """Write what all workers on this machine need; the function that returns it in a worker.

    Motions are mapped from their file, so workers share one copy of them in memory.

    Raises:
        OutputError: when the disk does not take it.
    """
    library, parts = library.to("cpu"), cloudpickle.dumps((make_env, policy, precision))
    with for_workers(folder):
        torch.save(library, folder / LIBRARY_FILE)
        (folder / _PARTS).write_bytes(parts)
    return partial(_from_folder, folder)


@contextmanager
def for_workers(folder: Path) -> Iterator[None]:
    """Write into a folder, as a context, what workers need.

    Raises:
        OutputError: naming the folder, when the disk does not take it.
    """
    try:
        yield
    except (OSError, RuntimeError) as error:  # torch tells a full disk in words of its own
        reason = "no space left on device" if is_full(folder) else str(error).partition("\n")[0]
        told = f"motions for the workers cannot be written to {str(folder)!r} ({reason})"
        raise OutputError(f"{told}: set TMPDIR to a folder with more room") from error


@lru_cache(maxsize=1)
def _from_folder(folder: Path) -> Content:
    library = torch.load(folder / LIBRARY_FILE, weights_only=False, mmap=True)
    return (library, *cloudpickle.loads((folder / _PARTS).read_bytes()))


def seed_of(seed: int, number: int) -> int:
    """Return the seed of a worker: streams of other workers, and of other seeds, have nothing to do with it.

    >>> len({seed_of(seed, number) for seed in range(10) for number in range(10)})
    100
    """
    return int(np.random.SeedSequence([seed, number]).generate_state(1, np.uint64)[0] >> 1)
