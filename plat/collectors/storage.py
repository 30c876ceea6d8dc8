"""Storage of a replay buffer that a run resumes with."""

from typing import Any

from torch import Tensor
from torchrl.data import LazyTensorStorage

from plat.errors import StateError

__all__ = ["DeviceStorage"]


class DeviceStorage(LazyTensorStorage):
    """TorchRL's ``LazyTensorStorage`` whose rows are on its device after a checkpoint was loaded as well.

    TorchRL's own, while it is empty, keeps the rows where the checkpoint has them: on the CPU.

    >>> import torch
    >>> from tensordict import TensorDict
    >>> filled = DeviceStorage(4)
    >>> filled.set(0, TensorDict({"x": torch.ones(1)}, []))
    >>> loaded = DeviceStorage(4, device="meta")
    >>> loaded.load_state_dict(filled.state_dict())
    >>> loaded[:]["x"].device
    device(type='meta')
    """

    _storage: Any

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Restore a state of :meth:`state_dict`.

        Raises:
            StateError: when it is of another number of rows.
        """
        values = state_dict["_storage"]
        rows = {len(value) for name, value in values.items() if isinstance(value, Tensor) and value.ndim}
        if rows - {self.max_size}:
            raise StateError(f"buffer: a state of {max(rows)} rows, expected {self.max_size}, as many as it has")
        super().load_state_dict(state_dict)
        self._storage = self._storage.to(self.device)
