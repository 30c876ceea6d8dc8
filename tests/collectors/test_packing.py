import torch

from plat.collectors.packing import as_bytes, as_tensor, packed, unpacked


def test_values_come_back_as_they_were():
    values = {"a": torch.arange(3), "nested": {"b": 1.5, "c": [True, None]}}
    data = as_bytes(as_tensor(packed(values)))
    found = unpacked(data)
    assert found["nested"] == values["nested"]
    assert found["a"].equal(values["a"])
