import pytest

from plat.baselines import ReleasedTrackers, Twist2, Wbc
from plat.errors import CheckpointError


def test_those_that_are_given_are_loaded(shared_data):
    pytest.importorskip("onnxruntime")
    folder = shared_data / "baselines"
    both = ReleasedTrackers(twist2=folder / "twist2/twist2_1017_20k.onnx", wbc=folder / "wbc/policy_066ab15.onnx")
    assert {name: type(tracker) for name, tracker in both.load().items()} == {"TWIST2": Twist2, "wbc": Wbc}
    assert ReleasedTrackers().load() == {}


def test_a_network_of_another_tracker_is_refused(shared_data):
    pytest.importorskip("onnxruntime")
    with pytest.raises(CheckpointError, match="from 132 to 29 numbers, expected from 1432 to 29"):
        ReleasedTrackers(twist2=shared_data / "baselines/wbc/policy_066ab15.onnx").load()
