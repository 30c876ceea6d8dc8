import pytest

from plat.baselines import ReleasedTrackers, Twist2, Wbc
from plat.errors import BundleError


def test_those_that_are_given_are_loaded(shared_data):
    pytest.importorskip("onnxruntime")
    folder = shared_data / "baselines"
    both = ReleasedTrackers(twist2=folder / "twist2/twist2_1017_20k.onnx", wbc=folder / "wbc/policy_066ab15.onnx")
    assert {name: type(tracker) for name, tracker in both.load().items()} == {"TWIST2": Twist2, "wbc": Wbc}
    assert ReleasedTrackers().load() == {}


def test_files_may_be_named_by_texts(tmp_path):
    pytest.importorskip("onnxruntime")
    with pytest.raises(BundleError, match="wbc.onnx': no such file"):
        ReleasedTrackers(wbc=str(tmp_path / "wbc.onnx")).load()
