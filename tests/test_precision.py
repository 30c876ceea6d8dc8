import pytest
import torch

from plat.errors import ConfigError
from plat.modules import GoalSequenceEncoder, mlp
from plat.objectives import autocast, has_fast_bfloat16


def test_hidden_layers_are_half_and_the_last_is_not():
    network = mlp(8, (16,), 4)
    dtypes = []
    network[0].register_forward_hook(lambda _, __, out: dtypes.append(out.dtype))
    with autocast("cpu", "bfloat16"):
        out = network(torch.randn(3, 8))
    assert dtypes == [torch.bfloat16]
    assert out.dtype == torch.float32


def test_results_are_close_to_full_precision():
    network, encoder = mlp(8, (64, 64), 4), GoalSequenceEncoder(8, 16)
    inputs, frames, length = torch.randn(100, 8), torch.randn(20, 6, 8), torch.randint(1, 7, (20,))
    exact = network(inputs), encoder(frames, length)
    with autocast("cpu", "bfloat16"):
        half = network(inputs), encoder(frames, length)
    for ours, theirs in zip(half, exact, strict=True):
        assert (ours - theirs).abs().max() < 0.02


@pytest.mark.parametrize(("precision", "enabled"), [("float32", False), ("bfloat16", True)])
def test_precision_is_what_was_asked_for(precision, enabled):
    with autocast("cpu", precision):
        assert torch.is_autocast_enabled("cpu") == enabled


@pytest.mark.parametrize("feature", ["amx_bf16", "avx512_bf16"])
def test_cpus_that_multiply_in_half_precision_are_used_so(monkeypatch, feature):
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {feature: True})
    assert has_fast_bfloat16("cpu")
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"avx2": True})
    assert not has_fast_bfloat16("cpu")


def test_a_device_or_a_precision_that_there_is_not():
    for ask in (lambda: autocast("nope", "bfloat16"), lambda: has_fast_bfloat16("nope")):
        with pytest.raises(ConfigError, match="device 'nope': unknown to torch, expected cpu or cuda"):
            ask()
    with pytest.raises(ConfigError, match="precision is 'half', expected 'auto', 'float32' or 'bfloat16'"):
        autocast("cpu", "half")


def test_a_gpu_that_is_not_there_is_not_fast(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert not has_fast_bfloat16("cuda")


def test_no_device_is_the_cpu():
    with autocast(None, "bfloat16"):
        assert torch.is_autocast_enabled("cpu")


def test_auto_follows_the_hardware():
    with autocast("cpu", "auto"):
        assert torch.is_autocast_enabled("cpu") == has_fast_bfloat16("cpu")


def test_a_torch_that_does_not_say_what_the_cpu_has(monkeypatch):
    monkeypatch.delattr(torch.cpu, "get_capabilities")
    assert not has_fast_bfloat16("cpu")
