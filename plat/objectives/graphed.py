"""Losses whose kernels run as one CUDA graph."""

from collections.abc import Iterable

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor, nn

from plat.precision import Precision, autocast

__all__ = ["GraphedLoss"]

# Runs before the capture, in which libraries choose their algorithms and constants reach the GPU.
_WARM_UPS = 3


class GraphedLoss:
    """A loss and its gradient, captured as a CUDA graph once and replayed for every further batch of that shape.

    An imagined rollout is tens of thousands of small kernels. A GPU runs them many times faster than Python can ask for
    them, whatever the size of the batch. On a CPU, and for batches of another shape than the first, the loss is
    computed as usual.

    A loss can be captured if what it runs does not depend on the values in a batch: no ``if`` on a tensor, no mask as
    an index, nothing copied from the CPU (:attr:`plat.tasks.Task.static`).

    Args:
        loss: returns losses, of which those named ``loss_...`` are added up, and what is logged.
        parameters: what learns.
        device: where they are.
        precision: of the networks' hidden layers.
        capture: whether the loss can be captured.

    >>> from plat.modules import DynamicsModel
    >>> from plat.objectives import DynamicsLoss
    >>> from plat.robots import G1
    >>> model = DynamicsModel(G1)
    >>> state = torch.nn.functional.pad(torch.ones(2, 5, 1), (3, 67))
    >>> windows = TensorDict({"robot_state": state, "action": torch.zeros(2, 5, 29)}, [2, 5])
    >>> losses = GraphedLoss(DynamicsLoss(model), model.parameters(), torch.device("cpu")).backward(windows)
    >>> all(parameter.grad is not None for parameter in model.parameters())
    True
    """

    def __init__(
        self,
        loss: nn.Module,
        parameters: Iterable[nn.Parameter],
        device: torch.device,
        precision: Precision = "auto",
        *,
        capture: bool = True,
    ):
        self._loss = loss
        self._parameters = [parameter for parameter in parameters if parameter.requires_grad]
        self._device = device
        self._precision: Precision = precision
        self._capture = capture and device.type == "cuda"
        self._graph: torch.cuda.CUDAGraph | None = None
        self._batch = self._losses = TensorDict()
        self._gradients: list[Tensor | None] = []

    def backward(self, batch: TensorDictBase) -> dict[str, Tensor]:
        """Compute losses and gradients, which replace those that the parameters have.

        Returns:
            What the loss returns, detached.
        """
        if self._capture and self._graph is None:
            self._record(batch)
        if self._graph is None or batch.shape != self._batch.shape:
            losses, gradients = self._computed(batch)
        else:
            self._batch.update_(batch)
            self._graph.replay()
            losses, gradients = self._losses.clone(), self._gradients
        for parameter, gradient in zip(self._parameters, gradients, strict=True):
            parameter.grad = gradient
        return dict(losses.items())

    def _computed(self, batch: TensorDictBase) -> tuple[TensorDictBase, list[Tensor | None]]:
        with autocast(self._device, self._precision):
            losses: TensorDictBase = self._loss(batch)
        total = torch.stack([value for name, value in losses.items() if name.startswith("loss_")]).sum()
        if not self._parameters:  # all are frozen
            return losses.detach(), []
        return losses.detach(), list(torch.autograd.grad(total, self._parameters, allow_unused=True))

    def _record(self, batch: TensorDictBase) -> None:
        self._batch = batch.clone()
        stream = torch.cuda.Stream(self._device)
        stream.wait_stream(torch.cuda.current_stream(self._device))
        with torch.cuda.stream(stream):
            for _ in range(_WARM_UPS):
                self._computed(self._batch)
        torch.cuda.current_stream(self._device).wait_stream(stream)
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph, capture_error_mode="thread_local"):  # workers' rollouts arrive in other threads
            losses, self._gradients = self._computed(self._batch)
        self._losses, self._graph = TensorDict(dict(losses.items())), graph
