import pytest
import torch

from plat.baselines import OnnxPolicy
from plat.errors import BundleError, CheckpointError

pytest.importorskip("onnxruntime")


def test_rows_do_not_depend_on_each_other(shared_data):
    for name, inputs in (("twist2/twist2_1017_20k", 1432), ("wbc/policy_066ab15", 132)):
        network = OnnxPolicy(shared_data / "baselines" / f"{name}.onnx", inputs, 29)
        rows = torch.randn(3, inputs)
        together = network(rows)
        assert together.shape == (3, 29)
        torch.testing.assert_close(together[1:2], network(rows[1:2]), atol=1e-5, rtol=1e-5)


def test_a_file_that_is_no_network(tmp_path):
    (tmp_path / "a.onnx").write_bytes(b"nothing")
    with pytest.raises(BundleError, match="a.onnx': not a readable .onnx file"):
        OnnxPolicy(tmp_path / "a.onnx", 3, 2)


def test_a_network_of_other_widths(shared_data):
    with pytest.raises(CheckpointError, match="from 132 to 29 numbers, expected from 100 to 29"):
        OnnxPolicy(shared_data / "baselines" / "wbc" / "policy_066ab15.onnx", 100, 29)
