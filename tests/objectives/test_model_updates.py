"""The model learns the same in another process as in this one."""

import os
import signal
from collections.abc import Iterator

import pytest
import torch
from tensordict import TensorDict

from plat.errors import ConfigError, ObservationError
from plat.modules import DynamicsConfig, DynamicsModel
from plat.objectives import ImaginationConfig
from plat.objectives.model_updates import ModelUpdates, ModelUpdatesBeside
from plat.robots import G1

CONFIG = ImaginationConfig(precision="float32", settle=2)


def updates() -> ModelUpdates:
    """Those of a new model, always the same one."""
    torch.manual_seed(0)
    return ModelUpdates(DynamicsModel(G1, DynamicsConfig(hidden=(32, 32))), CONFIG)


def windows(seed: int) -> TensorDict:
    generator = torch.Generator().manual_seed(seed)
    state = 0.1 * torch.randn(16, 5, 71, generator=generator)
    state[..., 3] = 1.0
    return TensorDict({"robot_state": state, "action": torch.randn(16, 5, 29, generator=generator)}, [16, 5])


def assert_alike(ours: ModelUpdates, theirs: ModelUpdates) -> None:
    found, expected = ours.state_dict(), theirs.state_dict()
    torch.testing.assert_close(found["parameters"], expected["parameters"], rtol=1e-5, atol=1e-7)
    for one, other in zip(found["optimizers"], expected["optimizers"], strict=True):
        torch.testing.assert_close(one["state"], other["state"], rtol=1e-4, atol=1e-7)


@pytest.fixture(scope="module")
def process() -> Iterator[ModelUpdatesBeside]:
    beside = ModelUpdatesBeside(updates())
    yield beside
    beside.close()


@pytest.fixture
def beside(process: ModelUpdatesBeside) -> ModelUpdatesBeside:
    """Updates of a new model, in a process that has to remember nothing."""
    process._updates = updates()
    return process


@pytest.fixture
def ending() -> Iterator[ModelUpdatesBeside]:
    """Those whose process will end."""
    beside = ModelUpdatesBeside(updates())
    yield beside
    beside.close()


def test_a_model_learns_what_follows() -> None:
    learning = updates()
    losses = [float(learning.update(windows(0))["model/loss"]) for _ in range(60)]
    assert losses[-1] < 0.7 * losses[0]


def test_another_process_does_the_same_updates(beside: ModelUpdatesBeside) -> None:
    here = updates()
    there, start = beside._updates, here.model.network[0].weight.detach().clone()
    for seeds in ((1, 2), (3,)):
        expected = [here.update(windows(seed)) for seed in seeds]
        beside.begin([windows(seed) for seed in seeds])
        torch.testing.assert_close(beside.finish(), expected, rtol=1e-4, atol=1e-6)
        assert_alike(there, here)
    assert not there.model.network[0].weight.equal(start)


def test_until_it_is_done_the_model_is_as_it_was(beside: ModelUpdatesBeside) -> None:
    model = beside._updates.model
    before = model.network[0].weight.detach().clone()
    beside.begin([windows(1)])
    assert model.network[0].weight.equal(before)
    beside.wait()
    assert not model.network[0].weight.equal(before)
    beside.begin([windows(2)])
    assert len(beside.finish()) == 2  # with those of before, which nobody had asked for
    assert beside.finish() == []


def test_rates_and_what_is_usual_are_those_of_the_moment(beside: ModelUpdatesBeside) -> None:
    here = updates()
    for learning in (here, beside._updates):
        for optimizer in learning.optimizers:
            optimizer.param_groups[0]["lr"] *= 0.1
        learning.model.mean.fill_(0.3)
    here.update(windows(1))
    beside.begin([windows(1)])
    beside.finish()
    assert_alike(beside._updates, here)
    assert float(here.model.mean.mean()) == float(beside._updates.model.mean.mean()) == pytest.approx(0.3)


def test_a_process_that_ends_is_done_without(ending: ModelUpdatesBeside, capsys: pytest.CaptureFixture[str]) -> None:
    here = updates()
    expected = [here.update(windows(seed)) for seed in (1, 2, 3)]
    assert ending._helper is None  # nobody would end it if something failed before the first updates
    ending.begin([windows(1)])
    ending.wait()
    assert not ending.ended
    os.kill(ending._helper._process.pid, signal.SIGKILL)
    ending.begin([windows(2)])
    ending.wait()
    assert "the process of the model ended, with code -9; it learns in this one" in capsys.readouterr().out
    assert ending.ended
    ending.begin([windows(3)])
    torch.testing.assert_close(ending.finish(), expected, rtol=1e-4, atol=1e-6)
    assert_alike(ending._updates, here)


def test_an_error_in_the_other_process_is_the_callers(beside: ModelUpdatesBeside) -> None:
    beside.begin([windows(1).select("robot_state")])
    with pytest.raises(ObservationError, match="dynamics loss"):
        beside.finish()
    beside.begin([windows(1)])
    assert len(beside.finish()) == 1


def test_it_may_end_in_the_middle(ending: ModelUpdatesBeside) -> None:
    ending.begin([windows(seed) for seed in range(200)])
    process = ending._helper._process
    ending.close()
    assert not process.is_alive()
    ending.close()


def test_a_model_on_a_gpu_has_no_process_beside() -> None:
    model = DynamicsModel(G1, DynamicsConfig(hidden=(8,))).to("meta")  # which is not a CPU either
    with pytest.raises(ConfigError, match="a model on meta, expected one on cpu"):
        ModelUpdatesBeside(ModelUpdates(model, CONFIG))
