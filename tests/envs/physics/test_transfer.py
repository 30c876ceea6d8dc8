import pytest
import torch
from tensordict import TensorDict

from plat.envs.physics.transfer import to_device


class Noted:
    """Tensor that notes how it is moved."""

    def __init__(self):
        self.calls: list[tuple[object, ...]] = []

    def pin_memory(self) -> "Noted":
        self.calls.append(("pin_memory",))
        return self

    def to(self, device: torch.device, non_blocking: bool = False) -> "Noted":
        self.calls.append(("to", device.type, non_blocking))
        return self


def test_only_a_gpu_gets_page_locked_memory():
    for device, calls in (
        ("cpu", [("to", "cpu", False)]),
        ("cuda:1", [("pin_memory",), ("to", "cuda", True)]),
    ):
        noted = Noted()
        assert to_device(noted, torch.device(device)) is noted
        assert noted.calls == calls


def test_on_the_cpu_nothing_is_copied():
    values = torch.ones(3)
    assert to_device(values, torch.device("cpu")) is values


@pytest.mark.skipif(not torch.cuda.is_available(), reason="there is no GPU")
def test_values_arrive_on_a_gpu():
    device = torch.device("cuda")
    values = TensorDict({"a": torch.arange(4.0), "b": {"c": torch.ones(4, 2)}}, [4])
    moved = to_device(values, device)
    assert moved["b", "c"].is_cuda
    assert (moved.cpu() == values).all()
