"""Gradients by several processes are those of one."""

import os
import signal
import threading
from collections.abc import Iterator

import pytest
import torch
from tensordict import TensorDict
from torch import nn

from plat.errors import ConfigError, ObservationError
from plat.modules import DynamicsConfig, DynamicsModel, PlainPolicy, PlainPolicyConfig
from plat.motions import MotionLibrary
from plat.objectives import DynamicsLoss, ImaginationLoss
from plat.objectives.graphed import GraphedLoss
from plat.objectives.parallel_gradients import ParallelGradients
from plat.tasks import TimedKeyframes, TimedKeyframesConfig

CPU = torch.device("cpu")


class Parts:
    """A model and a policy with their losses."""

    def __init__(self, library: MotionLibrary):
        torch.manual_seed(0)
        self.model = DynamicsModel(library.robot, DynamicsConfig(hidden=(32,)), library.dt)
        self.policy = PlainPolicy(library.robot, PlainPolicyConfig(backbone=(32,), hidden_size=16, decoder=(32,)))
        self.task = TimedKeyframes(library, TimedKeyframesConfig(chains=12, authored=0.5, shortest=10))  # no draws
        self.policy.deployed()(self.task.observe(*self.task.start(4)))
        imagined = ImaginationLoss(self.policy.deployed(), self.model, self.task, steps=3)
        self.losses = {
            "model": GraphedLoss(DynamicsLoss(self.model), self.model.parameters(), CPU, "float32"),
            "policy": GraphedLoss(imagined, self.policy.parameters(), CPU, "float32"),
        }

    def windows(self, count: int) -> TensorDict:
        state = torch.randn(count, 5, 71) * 0.1
        state[..., 3] = 1.0
        return TensorDict({"robot_state": state, "action": torch.randn(count, 5, 29)}, [count, 5])

    def states(self, count: int) -> TensorDict:
        state, memory = self.task.start(count)
        return TensorDict({"robot_state": state.pack(), "memory": memory}, [count])

    def gradients(self, name: str, batch: TensorDict) -> tuple[dict[str, torch.Tensor], list[torch.Tensor]]:
        """What one process computes."""
        losses = self.losses[name].backward(batch)
        return losses, [parameter.grad.clone() for parameter in self.losses[name].parameters]


@pytest.fixture(scope="module")
def parts(library: MotionLibrary) -> Parts:
    return Parts(library)


@pytest.fixture(scope="module")
def gradients(parts: Parts) -> Iterator[ParallelGradients]:
    with ParallelGradients(parts.losses, [parts.policy, parts.model], processes=2) as gradients:
        yield gradients


@pytest.mark.parametrize(("name", "count"), [("model", 8), ("model", 7), ("policy", 8), ("policy", 9)])
def test_two_processes_compute_what_one_does(parts: Parts, gradients: ParallelGradients, name: str, count: int) -> None:
    batch = parts.windows(count) if name == "model" else parts.states(count)
    losses, expected = parts.gradients(name, batch)
    shared = gradients.backward(name, batch)
    assert shared.keys() == losses.keys()
    means = ("loss_dynamics", "loss_policy")  # others are logged, and means over another number of steps
    torch.testing.assert_close(
        *({key: of[key] for key in of if key in means} for of in (shared, losses)), rtol=1e-4, atol=1e-6
    )
    for parameter, gradient in zip(parts.losses[name].parameters, expected, strict=True):
        torch.testing.assert_close(parameter.grad, gradient, rtol=1e-3, atol=1e-4 * float(gradient.abs().max()))
    assert any(gradient.abs().max() > 1e-4 for gradient in expected)


def test_the_other_process_has_the_weights_of_the_moment(parts: Parts, gradients: ParallelGradients) -> None:
    batch = parts.states(8)
    before, _ = parts.gradients("policy", batch)
    with torch.no_grad():
        for tensor in (*parts.policy.parameters(), parts.model.mean):
            tensor.add_(0.05 * torch.randn_like(tensor))
    after, _ = parts.gradients("policy", batch)
    assert abs(after["loss_policy"] - before["loss_policy"]) > 1e-4
    shared = gradients.backward("policy", batch)
    torch.testing.assert_close(shared["loss_policy"], after["loss_policy"], rtol=1e-4, atol=1e-6)


def test_a_batch_too_small_to_split_is_not_split(parts: Parts, gradients: ParallelGradients) -> None:
    batch = parts.states(1)
    losses, _ = parts.gradients("policy", batch)
    torch.testing.assert_close(gradients.backward("policy", batch)["loss_policy"], losses["loss_policy"])


def test_an_error_in_another_process_is_the_callers(parts: Parts, gradients: ParallelGradients) -> None:
    batch = parts.windows(8)
    batch["action"][5] = torch.nan  # no error, but no number
    assert gradients.backward("model", batch)["loss_dynamics"].isnan()
    with pytest.raises(ObservationError, match="dynamics loss"):
        gradients.backward("model", batch.select("robot_state"))


class Failing(nn.Module):
    """A loss that the other process cannot compute."""

    def __init__(self) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.ones(()))
        self.home = os.getpid()

    def forward(self, batch: TensorDict) -> TensorDict:
        if os.getpid() != self.home:
            if batch["x"].sum() > 0:
                raise ObservationError("x is above 0")
            os.kill(os.getpid(), signal.SIGKILL)
        return TensorDict({"loss_x": self.weight * batch["x"].mean()})


def test_a_process_that_ends_is_done_without(capsys: pytest.CaptureFixture[str]) -> None:
    module = Failing()
    loss, threads = GraphedLoss(module, module.parameters(), CPU), torch.get_num_threads()
    with ParallelGradients({"x": loss}, [module], processes=2) as gradients:
        with pytest.raises(ObservationError, match="x is above 0"):
            gradients.backward("x", TensorDict({"x": torch.arange(4.0)}, [4]))
        for _ in range(2):
            losses = gradients.backward("x", TensorDict({"x": -torch.arange(4.0)}, [4]))
            assert losses["loss_x"] == module.weight.grad == -1.5
        assert capsys.readouterr().out.count("ended, with code -9; 1 process goes on without it") == 1
        assert torch.get_num_threads() == 1
    assert torch.get_num_threads() == threads


def test_what_cannot_be_sent_is_computed_here(capsys: pytest.CaptureFixture[str]) -> None:
    module = Drawing()
    module.lock = threading.Lock()
    loss, threads = GraphedLoss(module, module.parameters(), CPU), torch.get_num_threads()
    with ParallelGradients({"x": loss}, [module], processes=2) as gradients:
        assert gradients.backward("x", TensorDict({"x": torch.zeros(4)}, [4]))["loss_x"].isfinite()
        assert torch.get_num_threads() == threads
    assert "one process computes gradients" in capsys.readouterr().out


def test_a_gpu_has_one_process() -> None:
    module = nn.Linear(2, 2, device="meta")  # which is not a CPU either
    with pytest.raises(ConfigError, match="2 processes, expected 1 on meta"):
        ParallelGradients({}, [module], processes=2)


def test_draws_follow_the_callers_stream() -> None:
    module = Drawing()
    loss = GraphedLoss(module, module.parameters(), CPU)
    with ParallelGradients({"x": loss}, [module], processes=2) as gradients:
        drawn = []
        for seed in (0, 0, 1):
            torch.manual_seed(seed)
            drawn += [float(gradients.backward("x", TensorDict({"x": torch.zeros(2)}, [2]))["loss_x"])]
    assert drawn[0] == drawn[1] != drawn[2]


class Drawing(nn.Module):
    """A loss that draws."""

    def __init__(self) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.ones(()))

    def forward(self, batch: TensorDict) -> TensorDict:
        return TensorDict({"loss_x": self.weight * torch.randn_like(batch["x"]).mean()})
