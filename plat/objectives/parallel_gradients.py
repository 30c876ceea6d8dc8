"""Gradients of losses by several processes, each of a batch of its own."""

import multiprocessing
import pickle
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType

import cloudpickle
import torch
from tensordict import TensorDictBase
from torch import Tensor, nn

from plat import errors
from plat.bounds import Count, check_value
from plat.errors import ConfigError, PlatError
from plat.objectives.graphed import GraphedLoss
from plat.pools import begin_helper
from plat.scratch import Scratch
from plat.words import counted

__all__ = ["ParallelGradients"]

_FILE = "losses.pt"


class ParallelGradients:
    """Losses and their gradients, of several batches at once by as many processes of one CPU each.

    The operations of an imagined rollout are many and small. Most of its time goes by between them, whatever the size
    of the batch, and neither PyTorch's threads nor smaller batches save much. So here every process has a whole batch.
    It has a copy of the losses, is sent the weights, and sends its gradient back. All gradients are of the same
    weights. Whoever updates these by one after the other uses gradients that are a few updates old: at most as old as
    there are other processes. Processes draw from streams that the caller's stream seeds, so a run is the same from one
    time to the next.

    What the losses hold besides, such as tables of a task, is written to a file that all processes map. It is what it
    was when they began: a task whose steps depend on what changes during training needs one process.

    Where that file cannot be written, or would hold what no other process can have, there is one process. A process
    that ends, for want of memory perhaps, is not replaced: the others go on without it. A line says so in both cases.

    Args:
        losses: by name.
        modules: whose parameters and buffers the losses read, and which change from one call to the next.
        processes: including this one; 1 for no others. For losses on the CPU.

    Raises:
        ConfigError: for several processes and modules on a GPU.

    Use it as a context, or call :meth:`close`.

    >>> from tensordict import TensorDict
    >>> from plat.modules import DynamicsModel
    >>> from plat.objectives import DynamicsLoss
    >>> from plat.robots import G1
    >>> model = DynamicsModel(G1)
    >>> state = torch.nn.functional.pad(torch.ones(2, 5, 1), (3, 67))
    >>> windows = TensorDict({"robot_state": state, "action": torch.zeros(2, 5, 29)}, [2, 5])
    >>> loss = GraphedLoss(DynamicsLoss(model), model.parameters(), torch.device("cpu"))
    >>> with ParallelGradients({"model": loss}, [model]) as gradients:
    ...     for losses in gradients.backward("model", [windows]):
    ...         print(all(parameter.grad is not None for parameter in model.parameters()))
    True
    """

    def __init__(self, losses: Mapping[str, GraphedLoss], modules: Sequence[nn.Module], processes: int = 1):
        check_value("gradients: processes", processes, Count)
        self._losses = dict(losses)
        self._tensors = _tensors(modules)
        self._helpers: list[_Helper] = []
        self._pool: ThreadPoolExecutor | None = None
        if processes == 1:
            return
        if elsewhere := {tensor.device.type for tensor in self._tensors} - {"cpu"}:
            raise ConfigError(f"gradients: {processes} processes, expected 1 on {min(elsewhere)}; several are for CPUs")
        self._scratch = Scratch("plat-gradients-")
        path = self._scratch.path / _FILE
        try:
            torch.save((self._losses, nn.ModuleList(modules)), path, pickle_module=cloudpickle)
        except (OSError, RuntimeError, TypeError, AttributeError, pickle.PicklingError) as error:  # disk full, a lock
            self._scratch.remove()
            told = str(error).partition("\n")[0]
            print(f"one process computes gradients: {path} could not be written for others ({told})", flush=True)
            return
        self._pool = ThreadPoolExecutor(processes - 1, thread_name_prefix="plat-gradients")
        self._helpers = [_Helper(path) for _ in range(processes - 1)]

    @property
    def processes(self) -> int:
        """How many processes there are: so many batches take as long as one."""
        return 1 + len(self._helpers)

    def backward(self, name: str, batches: Sequence[TensorDictBase]) -> Iterator[dict[str, Tensor]]:
        """Compute losses and gradients of batches, all with the weights of this moment.

        Args:
            name: of the loss.
            batches: at most as many as there are processes.

        Yields:
            What the loss returns of each batch, detached. The parameters have its gradient then, in place of others.

        Raises:
            ConfigError: for more batches.
            PlatError: what the loss raises, here or in another process.
        """
        if len(batches) > self.processes:
            raise ConfigError(f"gradients: {len(batches)} batches, expected at most {self.processes}, the processes")
        loss, (ours, *others) = self._losses[name], batches
        if self._pool is None or not others:
            yield loss.backward(ours)
            return
        weights = [tensor.detach() for tensor in self._tensors]
        orders = [(name, int(torch.randint(2**62, ())), weights, batch) for batch in others]
        asked = list(zip(self._helpers, others, orders, strict=False))
        answers = [self._pool.submit(helper.ask, pickle.dumps(order)) for helper, _, order in asked]
        threads = torch.get_num_threads()
        torch.set_num_threads(1)  # the other CPUs are busy
        try:
            found = [loss.gradients(ours)]
        finally:
            wait(answers)  # whatever is raised: the next order must not meet this one
            torch.set_num_threads(threads)
        for (helper, batch, _), answer in zip(asked, answers, strict=True):
            try:
                found.append(answer.result())
            except (EOFError, OSError):
                self._do_without(helper)
                found.append(loss.gradients(batch))
        for losses, gradients in found:
            for parameter, gradient in zip(loss.parameters, gradients, strict=True):
                parameter.grad = gradient
            yield losses

    def _do_without(self, helper: "_Helper") -> None:
        helper.close()
        self._helpers = [other for other in self._helpers if other is not helper]
        left = counted(self.processes, "process goes", "processes go")
        print(
            f"a process that computed gradients ended, with code {helper.exit_code}; {left} on without it", flush=True
        )

    def close(self) -> None:
        """End the other processes; again has no effect."""
        if self._pool is None:
            return
        for helper in self._helpers:
            helper.close()
        self._pool.shutdown()
        self._helpers, self._pool = [], None
        self._scratch.remove()

    def __enter__(self) -> "ParallelGradients":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class _Helper:
    """Another process, and what speaks with it."""

    def __init__(self, path: Path):
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(path, theirs), daemon=True, name="plat-gradients")
        self._process.start()
        theirs.close()

    @property
    def exit_code(self) -> int | None:
        """What the process ended with."""
        return self._process.exitcode

    def ask(self, order: bytes) -> tuple[dict[str, Tensor], list[Tensor | None]]:
        """Return losses and gradients of a batch.

        Raises:
            EOFError, OSError: when the process is gone.
            PlatError: what the loss raised.
        """
        self._connection.send_bytes(order)
        found, failure = pickle.loads(self._connection.recv_bytes())
        if failure is not None:
            kind, message = failure
            raise getattr(errors, kind, PlatError)(message)
        return found

    def close(self) -> None:
        self._connection.close()
        self._process.join(5)
        if self._process.is_alive():  # in the middle of a gradient
            self._process.kill()
            self._process.join()


def _serve(path: Path, connection: Connection) -> None:
    """Answer orders until the process that learns is gone."""
    begin_helper()
    torch.set_num_threads(1)
    losses, modules = torch.load(path, weights_only=False, mmap=True)
    tensors = _tensors(modules)
    with suppress(EOFError, OSError):
        while True:
            name, seed, weights, batch = pickle.loads(connection.recv_bytes())
            with torch.no_grad():
                for tensor, values in zip(tensors, weights, strict=True):
                    tensor.copy_(values)
            torch.manual_seed(seed)
            found, failure = None, None
            try:
                found = losses[name].gradients(batch)
            except PlatError as error:
                failure = type(error).__name__, str(error)
            # not send(): tensors would go by files there, one each
            connection.send_bytes(pickle.dumps((found, failure)))


def _tensors(modules: Iterable[nn.Module]) -> list[Tensor]:
    return [tensor for module in modules for tensor in (*module.parameters(), *module.buffers())]
