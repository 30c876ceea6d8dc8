"""ONNX export of a torch module."""

import logging
import warnings
from collections.abc import Mapping
from typing import Any

import torch
from torch import nn

from plat.deploy.bundle import INPUT, OUTPUT
from plat.errors import BundleError
from plat.extras import require

__all__ = ["OPSET", "onnx_model"]

OPSET = 23
"""Version of ONNX's operators: the newest that torch's exporter writes without a converter."""


def onnx_model(network: nn.Module, num_features: int, metadata: Mapping[str, str]) -> Any:
    """Return the ``onnx.ModelProto`` of a network from ``observation`` ``[batch, F]`` to ``joint_position_target``.

    It holds the weights and only the metadata that is given; torch's own metadata would reveal paths of source files.

    Args:
        network: in evaluation mode, on the CPU.
        num_features: size of an observation F.
        metadata: goes to the model's ``metadata_props``.

    Raises:
        BundleError: when onnx or onnxscript is not installed, or the network uses an operation that ONNX lacks.
    """
    require("export", "exporting needs", "onnx", "onnxscript", error=BundleError)
    import onnx

    # its warnings on torchvision and on its own deprecated calls do not concern the user
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            program = torch.onnx.export(
                network,
                (torch.zeros(2, num_features),),
                dynamo=True,
                dynamic_shapes=({0: torch.export.Dim("batch", min=1)},),
                input_names=[INPUT],
                output_names=[OUTPUT],
                opset_version=OPSET,
                external_data=False,
                verbose=False,
            )
        except torch.onnx.OnnxExporterError as error:
            cause = str(error.__cause__ or error).strip().splitlines()[0]
            raise BundleError(f"torch cannot write this policy as ONNX ({cause})") from error
    assert program is not None  # it is None only when a file name is given to the old exporter
    model = program.model_proto
    graph = model.graph
    for entry in (model, graph, *graph.node, *graph.input, *graph.output, *graph.value_info, *graph.initializer):
        entry.ClearField("metadata_props")
        entry.ClearField("doc_string")
    onnx.helper.set_model_props(model, dict(metadata))
    onnx.checker.check_model(model, full_check=True)
    return model
