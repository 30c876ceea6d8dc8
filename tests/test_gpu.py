import gc

import torch

from plat.gpu import _COPIES as COPIES
from plat.gpu import HORIZONTAL, UP, constant


def test_a_constant_that_fits_is_itself():
    assert constant(UP, torch.zeros(2)) is UP
    assert constant(UP, torch.device("cpu")) is UP


def test_a_copy_is_made_once_for_each_device_and_type():
    double = constant(UP, torch.zeros(1, dtype=torch.float64))
    assert double.dtype == torch.float64
    assert constant(UP, torch.ones(4, dtype=torch.float64)) is double
    elsewhere = constant(HORIZONTAL, torch.device("meta"))
    assert (elsewhere.device.type, elsewhere.dtype) == ("meta", torch.float32)
    assert constant(HORIZONTAL, torch.device("meta")) is elsewhere


def test_a_copy_made_without_gradients_serves_one_with():
    values = torch.ones(3)
    with torch.inference_mode():
        constant(values, torch.zeros(1, dtype=torch.float64))
    weight = torch.ones(3, dtype=torch.float64, requires_grad=True)
    (weight * constant(values, weight)).sum().backward()
    assert weight.grad.tolist() == [1.0, 1.0, 1.0]


def test_copies_go_with_their_constant():
    values = torch.ones(3)
    constant(values, torch.zeros(1, dtype=torch.float64))
    before = len(COPIES)
    del values
    gc.collect()
    assert len(COPIES) < before
