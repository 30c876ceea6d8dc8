"""ONNX networks as policies."""

from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from plat.deploy.onnx_session import open_session
from plat.errors import CheckpointError
from plat.extras import importing

__all__ = ["OnnxPolicy"]


class OnnxPolicy:
    """ONNX network with one input ``[N, inputs]`` and one output ``[N, outputs]``, both float32.

    A file that was exported for batch size 1 is called row by row.

    Args:
        path: the ``.onnx`` file.
        inputs: expected width of the input.
        outputs: expected width of the output.

    Raises:
        BundleError: when the file cannot be read; when onnxruntime is not installed.
        CheckpointError: when its widths are others.
    """

    def __init__(self, path: str | Path, inputs: int, outputs: int):
        self._path = Path(path)
        self._session = open_session(self._path)
        (entry,), (result,) = self._session.get_inputs(), self._session.get_outputs()
        if (entry.shape[-1], result.shape[-1]) != (inputs, outputs):
            raise CheckpointError(
                f"ONNX policy {str(path)!r}: from {entry.shape[-1]} to {result.shape[-1]} numbers, "
                f"expected from {inputs} to {outputs}"
            )
        self._entry = entry.name
        self._single = entry.shape[0] == 1

    def constant(self, name: str) -> Tensor:
        """Return a constant of the network, flat, float32.

        Raises:
            CheckpointError: when there is none of that name; when the package onnx is not installed.
        """
        with importing("baselines", f"ONNX policy {str(self._path)!r}: reading its constants needs", CheckpointError):
            import onnx  # only for networks whose constants are asked for
        graph = onnx.load(self._path).graph
        for initializer in graph.initializer:
            if initializer.name == name:
                return torch.from_numpy(onnx.numpy_helper.to_array(initializer).astype(np.float32)).flatten()
        raise CheckpointError(
            f"ONNX policy {str(self._path)!r}: no constant {name!r} in it, expected the released file"
        )

    def __call__(self, observation: Tensor) -> Tensor:
        """Compute the output ``[N, outputs]`` for ``[N, inputs]``."""
        rows = observation.cpu().numpy().astype(np.float32)
        batches = np.split(rows, len(rows)) if self._single else [rows]
        results = [self._session.run(None, {self._entry: batch})[0] for batch in batches]
        return torch.from_numpy(np.concatenate(results)).to(observation.device)
