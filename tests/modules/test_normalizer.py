import math

import pytest
import torch
from tensordict import TensorDict

from plat.errors import ActionError
from plat.modules import NormalizerConfig, ObservationNormalizer


def test_statistics_of_parts_are_those_of_the_whole():
    data = TensorDict({"a": 3 + 2 * torch.randn(300, 4), "b": torch.rand(300, 1)}, [300])
    parts, whole = (ObservationNormalizer(["a", "b"], 5) for _ in range(2))
    for part in data.split([10, 90, 200]):
        parts.update(part)
    whole.update(data)
    torch.testing.assert_close(parts.mean, whole.mean)
    torch.testing.assert_close(parts.var, whole.var)
    values = torch.cat((data["a"], data["b"]), -1)
    torch.testing.assert_close(whole.mean, values.mean(0))
    torch.testing.assert_close(whole.var, values.var(0, correction=0))


def test_batch_shape_does_not_matter():
    values = torch.randn(6, 5, 3)
    flat, deep = ObservationNormalizer(["a"], 3), ObservationNormalizer(["a"], 3)
    flat.update(TensorDict({"a": values.flatten(0, 1)}, [30]))
    deep.update(TensorDict({"a": values}, [6, 5]))
    torch.testing.assert_close(flat.var, deep.var)


def test_a_single_state_and_none():
    values = torch.randn(2, 3)
    single, together = ObservationNormalizer(["a"], 3), ObservationNormalizer(["a"], 3)
    for value in values:
        single.update(TensorDict({"a": value}))
    single.update(TensorDict({"a": values[:0]}, [0]))
    together.update(TensorDict({"a": values}, [2]))
    for name, buffer in single.named_buffers():
        torch.testing.assert_close(buffer, together.get_buffer(name))


def test_output_is_standard_and_clipped():
    normalizer = ObservationNormalizer(["a"], 2, NormalizerConfig(clip=3.0))
    data = TensorDict({"a": torch.tensor([10.0, -2.0]) + torch.tensor([4.0, 0.5]) * torch.randn(5000, 2)}, [5000])
    normalizer.update(data)
    out = normalizer.using()(data)["observation"]
    torch.testing.assert_close(out.mean(0), torch.zeros(2), atol=0.02, rtol=0)
    torch.testing.assert_close(out.std(0), torch.ones(2), atol=0.05, rtol=0)
    assert out.abs().max() <= 3.0


def test_modules_share_statistics_whatever_they_read():
    normalizer = ObservationNormalizer(["a"], 2)
    other = normalizer.using(["b"], out_key="normalized_b")
    normalizer.update(TensorDict({"a": 5 + torch.randn(1000, 2)}, [1000]))
    out = other(TensorDict({"b": torch.full((1, 2), 5.0)}, [1]))["normalized_b"]
    assert out.abs().max() < 0.2


def test_acting_does_not_move_the_statistics():
    normalizer = ObservationNormalizer(["a"], 2)
    before = {name: value.clone() for name, value in normalizer.state_dict().items()}
    normalizer.using()(TensorDict({"a": torch.randn(10, 2)}, [10]))
    assert all(torch.equal(value, before[name]) for name, value in normalizer.state_dict().items())
    assert not list(normalizer.parameters())


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e30])
def test_a_batch_that_is_not_finite_changes_nothing(value: float) -> None:
    normalizer = ObservationNormalizer(["a", "b"], 5)
    data = TensorDict({"a": torch.randn(30, 4), "b": torch.rand(30, 1)}, [30])
    normalizer.update(data)
    before = {name: buffer.clone() for name, buffer in normalizer.named_buffers()}
    data["b"][7] = value
    with pytest.raises(ActionError, match="observation b: holds NaN or infinity"):
        normalizer.update(data)
    for name, buffer in normalizer.named_buffers():
        assert torch.equal(buffer, before[name])


def test_an_entry_alone_is_one():
    normalizer, data = ObservationNormalizer("speed", 3), TensorDict({"speed": torch.randn(8, 3)}, [8])
    normalizer.update(data)
    assert float(normalizer.count) == 8
    assert normalizer.using("speed")(data)["observation"].shape == (8, 3)
