import gc

import pytest
import torch

from plat.collectors import RolloutReplay, dagger_buffer
from plat.envs import make_keyframe_env, make_tracking_env
from plat.errors import ConfigError
from plat.gpu import _COPIES as COPIES
from plat.gpu import HORIZONTAL, UP, check_device, check_stays, constant
from plat.motions import MotionLibrary
from plat.robots import G1
from plat.runs import load_policy
from plat.runs.dynamics import load_dynamics
from tests.conftest import standing_clip


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


@pytest.mark.parametrize("device", ["nope", "meta", 3.5, None])
def test_what_is_no_device_of_this_machine_is_one_line(device):
    with pytest.raises(ConfigError, match="^device .*: not on this machine .*expected"):
        check_device(device)


def test_what_stays_where_it_was_made_says_so():
    with pytest.raises(
        ConfigError, match=r"env: is on 'cuda:0' and cannot be moved, expected one made with device='cpu'"
    ):
        check_stays("cpu", torch.device("cuda", 0), "env")


def test_whatever_takes_a_device_names_one_that_is_not_there():
    library = MotionLibrary.from_clips([standing_clip("still", frames=60)])
    for take in (
        library.to,
        lambda device: make_tracking_env(library, 1, device=device),
        lambda device: make_keyframe_env(library, 1, device=device),
        lambda device: dagger_buffer(library, 4, 2, device=device),
        lambda device: RolloutReplay(1, 4, ["x"], device=device),
        lambda device: load_policy("plat-g1", device),
        lambda device: load_dynamics("imagined-g1", G1, device),
    ):
        with pytest.raises(ConfigError, match="device 'nope': not on this machine"):
            take("nope")
