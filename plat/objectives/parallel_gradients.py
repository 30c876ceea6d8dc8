"""Gradients of losses by several processes, each with a part of the batch."""

import multiprocessing
import pickle
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import Any

import cloudpickle
import numpy as np
import torch
from tensordict import TensorDict, TensorDictBase
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
    """Losses and their gradients, computed by several processes of one CPU each.

    The operations of an imagined rollout are many and small, and PyTorch's threads gain little with them: two are 1.1
    times as fast as one. Here a batch is split instead. Every process has a copy of the losses, is sent the weights and
    its part of a batch, and sends its gradient back. The mean of the gradients, by the sizes of the parts, is that of
    the whole batch, for losses that are means over it. Processes draw from streams that the caller's stream seeds, so a
    run is the same from one time to the next.

    What the losses hold besides, such as tables of a task, is written to a file that all processes map. It is what it
    was when they began: a task whose steps depend on what changes during training needs one process.

    Where that file cannot be written, or would hold what no other process can have, there is one process. A process
    that ends, for want of memory perhaps, is not replaced: the others go on without it. A line says so in both cases.

    Args:
        losses: by name.
        modules: whose parameters and buffers the losses read, and which change from one batch to the next.
        processes: including this one; 1 for no others. For losses on the CPU.

    Raises:
        ConfigError: for several processes and modules on a GPU.

    Use it as a context, or call :meth:`close`. While there are several processes this one's PyTorch has one thread.

    >>> from plat.modules import DynamicsModel
    >>> from plat.objectives import DynamicsLoss
    >>> from plat.robots import G1
    >>> model = DynamicsModel(G1)
    >>> state = torch.nn.functional.pad(torch.ones(2, 5, 1), (3, 67))
    >>> windows = TensorDict({"robot_state": state, "action": torch.zeros(2, 5, 29)}, [2, 5])
    >>> loss = GraphedLoss(DynamicsLoss(model), model.parameters(), torch.device("cpu"))
    >>> with ParallelGradients({"model": loss}, [model]) as gradients:
    ...     losses = gradients.backward("model", windows)
    >>> all(parameter.grad is not None for parameter in model.parameters())
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
        self._threads = torch.get_num_threads()
        self._pool = ThreadPoolExecutor(processes - 1, thread_name_prefix="plat-gradients")
        self._helpers = [_Helper(path) for _ in range(processes - 1)]
        torch.set_num_threads(1)

    def backward(self, name: str, batch: TensorDictBase) -> dict[str, Tensor]:
        """Compute losses and gradients, which replace those that the parameters have.

        Args:
            name: of the loss.
            batch: tensors ``[B, ...]``.

        Returns:
            What the loss returns, detached.

        Raises:
            PlatError: what the loss raises, here or in another process.
        """
        loss = self._losses[name]
        if not self._helpers or len(batch) <= len(self._helpers):
            return loss.backward(batch)
        ours, *parts = batch.chunk(1 + len(self._helpers))
        weights = [tensor.detach().numpy() for tensor in self._tensors]
        orders = [(name, int(torch.randint(2**62, ())), weights, _plain(part)) for part in parts]
        # a batch may be split into fewer parts than there are processes
        asked = list(zip(self._helpers, parts, orders, strict=False))
        assert self._pool is not None
        answers = [self._pool.submit(helper.ask, pickle.dumps(order, protocol=5)) for helper, _, order in asked]
        sums = _Sums(loss.parameters)
        try:
            sums.add(loss.backward(ours), _gradients(loss), len(ours))
        finally:
            wait(answers)  # whatever is raised: the next order must not meet this one
        for (helper, part, _), answer in zip(asked, answers, strict=True):
            try:
                sums.add(*answer.result(), len(part))
            except (EOFError, OSError):
                self._do_without(helper)
                sums.add(loss.backward(part), _gradients(loss), len(part))
        return sums.means()

    def _do_without(self, helper: "_Helper") -> None:
        helper.close()
        self._helpers = [other for other in self._helpers if other is not helper]
        told = f"a process that computed gradients ended, with code {helper.exit_code}"
        print(f"{told}; {counted(1 + len(self._helpers), 'process goes', 'processes go')} on without it", flush=True)

    def close(self) -> None:
        """End the other processes; again has no effect."""
        if self._pool is None:
            return
        for helper in self._helpers:
            helper.close()
        self._pool.shutdown()
        self._helpers, self._pool = [], None
        self._scratch.remove()
        torch.set_num_threads(self._threads)

    def __enter__(self) -> "ParallelGradients":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class _Sums:
    """Losses and gradients of the parts of a batch, added up by their sizes."""

    def __init__(self, parameters: Sequence[nn.Parameter]):
        self._parameters = parameters
        self._gradients: list[Tensor | None] = [None] * len(parameters)
        self._losses: dict[str, Tensor] = {}
        self._count = 0

    def add(self, losses: Mapping[str, Tensor], gradients: Sequence[Tensor | None], count: int) -> None:
        self._count += count
        for name, value in losses.items():
            self._losses[name] = self._losses.get(name, torch.zeros_like(value)) + count * value
        for number, gradient in enumerate(gradients):
            if gradient is not None:
                before = self._gradients[number]
                self._gradients[number] = count * gradient if before is None else before.add_(gradient, alpha=count)

    def means(self) -> dict[str, Tensor]:
        """Return the mean losses; the mean gradients become those of the parameters."""
        for parameter, gradient in zip(self._parameters, self._gradients, strict=True):
            parameter.grad = None if gradient is None else gradient.div_(self._count)
        return {name: value / self._count for name, value in self._losses.items()}


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
        """Return losses and gradients of a part of a batch.

        Raises:
            EOFError, OSError: when the process is gone.
            PlatError: what the loss raised.
        """
        self._connection.send_bytes(order)
        losses, gradients, failure = pickle.loads(self._connection.recv_bytes())
        if failure is not None:
            kind, message = failure
            raise getattr(errors, kind, PlatError)(message)
        return {name: torch.from_numpy(value) for name, value in losses.items()}, [
            None if values is None else torch.from_numpy(values) for values in gradients
        ]

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
            name, seed, weights, part = pickle.loads(connection.recv_bytes())
            connection.send_bytes(pickle.dumps(_answer(losses[name], tensors, seed, weights, part), protocol=5))


def _answer(
    loss: GraphedLoss, tensors: Sequence[Tensor], seed: int, weights: Iterable[np.ndarray], part: dict[str, Any]
) -> tuple[dict[str, np.ndarray], list[np.ndarray | None], tuple[str, str] | None]:
    with torch.no_grad():
        for tensor, values in zip(tensors, weights, strict=True):
            tensor.copy_(torch.from_numpy(values))
    torch.manual_seed(seed)
    try:
        losses = loss.backward(_tensordict(part))
    except PlatError as error:
        return {}, [], (type(error).__name__, str(error))
    gradients = [None if gradient is None else gradient.numpy() for gradient in _gradients(loss)]
    return {name: value.numpy() for name, value in losses.items()}, gradients, None


def _gradients(loss: GraphedLoss) -> list[Tensor | None]:
    return [parameter.grad for parameter in loss.parameters]


def _tensors(modules: Iterable[nn.Module]) -> list[Tensor]:
    return [tensor for module in modules for tensor in (*module.parameters(), *module.buffers())]


def _plain(part: TensorDictBase) -> dict[str, Any]:
    """A batch as arrays: tensors would go by files, one each."""
    entries = {
        name: _plain(value) if isinstance(value, TensorDictBase) else value.numpy() for name, value in part.items()
    }
    return {"entries": entries, "shape": tuple(part.shape)}


def _tensordict(part: dict[str, Any]) -> TensorDict:
    entries = {
        name: _tensordict(value) if isinstance(value, dict) else torch.from_numpy(value)
        for name, value in part["entries"].items()
    }
    return TensorDict(entries, part["shape"])
