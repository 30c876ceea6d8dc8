"""Updates of the dynamics model, one after the other or in a process beside the one that learns."""

import pickle
from collections.abc import Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Any, TypeAlias

import cloudpickle
import torch
from tensordict import TensorDictBase
from torch import Tensor, nn

from plat.errors import ConfigError
from plat.modules.dynamics import DynamicsModel
from plat.objectives.dynamics import DynamicsLoss
from plat.objectives.finite import FiniteUpdates
from plat.objectives.graphed import GraphedLoss
from plat.objectives.helper import Helper
from plat.objectives.muon import muon_and_adam
from plat.objectives.settings import ImaginationConfig

__all__ = ["ModelUpdates", "ModelUpdatesBeside"]

Losses: TypeAlias = dict[str, Tensor]


class ModelUpdates:
    """Updates of a model by windows of what was simulated: its loss, and Muon and Adam.

    Args:
        model: of the robot.
        config: settings.

    Attributes:
        optimizers: of the model.
        finite: guard of the updates; those whose gradient is not finite are skipped.

    >>> from tensordict import TensorDict
    >>> from plat.robots import G1
    >>> state = torch.nn.functional.pad(torch.ones(2, 5, 1), (3, 67))
    >>> windows = TensorDict({"robot_state": state, "action": torch.zeros(2, 5, 29)}, [2, 5])
    >>> "model/loss" in ModelUpdates(DynamicsModel(G1), ImaginationConfig()).update(windows)
    True
    """

    def __init__(self, model: DynamicsModel, config: ImaginationConfig):
        self.model = model
        self.optimizers = muon_and_adam(model.network, config.rates().muon_lr, config.model_lr)
        self.finite = FiniteUpdates("model")
        self._grad_norm = config.grad_norm
        self._loss = GraphedLoss(DynamicsLoss(model), model.parameters(), model.mean.device, config.precision)

    def update(self, windows: TensorDictBase) -> Losses:
        """Update the model by windows ``[B, T]`` of successive steps, and return what is logged.

        Raises:
            ActionError: when 50 gradients in a row were not finite.
        """
        losses = self._loss.backward(windows)
        learns = self.finite.allow(nn.utils.clip_grad_norm_(self.model.parameters(), self._grad_norm))
        for optimizer in self.optimizers:
            if learns:
                optimizer.step()
            optimizer.zero_grad()
        named = {"model/loss" if name == "loss_dynamics" else f"model/{name}": each for name, each in losses.items()}
        return {**named, "model/skipped": torch.tensor(float(not learns))}

    def answer(self, order: tuple[dict[str, Any], list[Tensor], list[TensorDictBase]]) -> tuple[dict[str, Any], Any]:
        """Update the model by several windows, from a state of another process and its normalizer's buffers.

        Returns:
            The state afterwards, and what :meth:`update` returned.
        """
        state, buffers, batches = order
        self.load_state_dict(state)
        _copy(self.model.buffers(), buffers)
        losses = [self.update(windows) for windows in batches]
        return self.state_dict(), losses

    def state_dict(self) -> dict[str, Any]:
        """Return what updates change: the model's parameters, and what its optimizers remember."""
        return {
            "parameters": [parameter.detach() for parameter in self.model.parameters()],
            "optimizers": [optimizer.state_dict() for optimizer in self.optimizers],
            "skipped": self.finite.in_a_row,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore a state of :meth:`state_dict`."""
        _copy(self.model.parameters(), state["parameters"])
        for optimizer, values in zip(self.optimizers, state["optimizers"], strict=True):
            optimizer.load_state_dict(values)
        self.finite.in_a_row = int(state["skipped"])


class ModelUpdatesBeside:
    """Updates of a model in a process of its own, while the caller goes on with the model as it was.

    That process is started for the first ones. It is sent what the updates begin with, and sends back what they end
    with, so a run keeps all that it needs here. Where it ends, for want of memory perhaps, the updates are done in this
    one, and a line says so.

    Args:
        updates: of a model on the CPU.

    Raises:
        ConfigError: for a model on a GPU.

    Call :meth:`close` at the end.

    >>> from tensordict import TensorDict
    >>> from plat.robots import G1
    >>> state = torch.nn.functional.pad(torch.ones(2, 5, 1), (3, 67))
    >>> windows = TensorDict({"robot_state": state, "action": torch.zeros(2, 5, 29)}, [2, 5])
    >>> beside = ModelUpdatesBeside(ModelUpdates(DynamicsModel(G1), ImaginationConfig()))
    >>> beside.begin([windows, windows])
    >>> len(beside.finish())
    2
    >>> beside.close()
    """

    def __init__(self, updates: ModelUpdates):
        if (device := updates.model.mean.device.type) != "cpu":
            raise ConfigError(f"model updates: a model on {device}, expected one on cpu for a process beside this one")
        self._updates = updates
        self._helper: Helper | None = None
        self.ended = False
        """Whether the process has ended, and updates are done in this one."""
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="plat-model")
        self._pending: Future[Any] | None = None
        self._batches: Sequence[TensorDictBase] = ()
        self._losses: list[Losses] = []

    def begin(self, batches: Sequence[TensorDictBase]) -> None:
        """Begin the updates by some windows, one after the other, when those before are done."""
        self.wait()
        self._batches = batches
        if self.ended:
            self._here()
            return
        if self._helper is None:
            self._helper = Helper(partial(cloudpickle.loads, cloudpickle.dumps(self._updates)), "plat-model")
        buffers = [buffer.detach() for buffer in self._updates.model.buffers()]
        order = pickle.dumps((self._updates.state_dict(), buffers, batches))
        self._pending = self._pool.submit(self._helper.ask, order)

    def finish(self) -> list[Losses]:
        """Wait until the model has what was begun, and return what is logged of all since the last call.

        Raises:
            ActionError: when 50 gradients in a row were not finite.
        """
        self.wait()
        losses, self._losses = self._losses, []
        return losses

    def wait(self) -> None:
        """Wait until the model has what was begun; as before, :meth:`finish` returns what is logged."""
        pending, self._pending = self._pending, None
        if pending is None:
            return
        try:
            state, losses = pending.result()
        except (EOFError, OSError):
            self.ended = True
            assert self._helper is not None
            self._helper.close()
            code = self._helper.exit_code
            print(f"the process of the model ended, with code {code}; it learns in this one", flush=True)
            self._here()
        else:
            self._updates.load_state_dict(state)
            self._losses += losses

    def _here(self) -> None:
        self._losses += [self._updates.update(windows) for windows in self._batches]

    def close(self) -> None:
        """End the process, whatever it is at; again has no effect."""
        if self._helper is not None:
            self._helper.close()
        self._pool.shutdown()
        self._pending = None


def _copy(ours: Iterable[Tensor], theirs: Iterable[Tensor]) -> None:
    with torch.no_grad():
        for tensor, values in zip(ours, theirs, strict=True):
            tensor.copy_(values)
