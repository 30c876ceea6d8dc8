import numpy as np
import pytest
import torch

from plat.errors import BundleError
from plat.export import JointTargetNetwork
from plat.export.onnx_file import OPSET, onnx_model
from tests.export.runs import small_policy

onnx = pytest.importorskip("onnx")
onnxruntime = pytest.importorskip("onnxruntime")


@pytest.fixture(scope="module")
def model():
    network = JointTargetNetwork(small_policy("residual_latent"))
    return onnx_model(network, network.num_features, {"key": "value"})


def test_one_input_one_output_and_a_batch_of_any_size(model):
    session = onnxruntime.InferenceSession(model.SerializeToString())
    (entry,), (result,) = session.get_inputs(), session.get_outputs()
    assert (entry.name, entry.shape) == ("observation", ["batch", 177])
    assert (result.name, result.shape) == ("joint_position_target", ["batch", 29])
    rows = np.random.default_rng(0).normal(size=(7, 177)).astype(np.float32)
    together = session.run(None, {"observation": rows})[0]
    alone = session.run(None, {"observation": rows[3:4]})[0]
    np.testing.assert_allclose(together[3:4], alone, atol=1e-6)


def test_operators_are_of_one_version(model):
    assert [(entry.domain, entry.version) for entry in model.opset_import] == [("", OPSET)]


def test_nothing_but_the_given_metadata_is_inside(model):
    assert {entry.key: entry.value for entry in model.metadata_props} == {"key": "value"}
    content = model.SerializeToString()
    assert b".py" not in content
    assert b"stack_trace" not in content


class DataDependent(torch.nn.Module):
    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        return observation if observation.sum() > 0 else -observation


def test_a_network_that_onnx_cannot_hold():
    with pytest.raises(BundleError, match=r"torch cannot write this policy as ONNX \(.+\)$"):
        onnx_model(DataDependent(), 177, {})
