"""Gradients by several processes are those of one."""

import os
import signal
import threading
from collections.abc import Iterator
from typing import TypeAlias

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
Found: TypeAlias = tuple[dict[str, torch.Tensor], list[torch.Tensor]]


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

    def gradients(self, name: str, batch: TensorDict) -> Found:
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


def computed(gradients: ParallelGradients, parts: Parts, name: str, batches: list[TensorDict]) -> list[Found]:
    """What several processes compute, each a batch."""
    found = []
    for losses in gradients.backward(name, batches):
        found.append((losses, [parameter.grad.clone() for parameter in parts.losses[name].parameters]))
    return found


@pytest.mark.parametrize("name", ["model", "policy"])
def test_two_processes_compute_what_one_does(parts: Parts, gradients: ParallelGradients, name: str) -> None:
    batches = [parts.windows(8) if name == "model" else parts.states(8) for _ in range(2)]
    expected = [parts.gradients(name, batch) for batch in batches]
    torch.testing.assert_close(computed(gradients, parts, name, batches), expected, rtol=1e-5, atol=1e-7)
    assert gradients.processes == 2
    assert not expected[0][1][0].equal(expected[1][1][0])
    assert all(any(gradient.abs().max() > 1e-4 for gradient in each) for _, each in expected)


def test_the_other_process_has_the_weights_of_the_moment(parts: Parts, gradients: ParallelGradients) -> None:
    batch = parts.states(8)
    before, _ = parts.gradients("policy", batch)
    with torch.no_grad():
        for tensor in (*parts.policy.parameters(), parts.model.mean):
            tensor.add_(0.05 * torch.randn_like(tensor))
    after = parts.gradients("policy", batch)
    assert abs(after[0]["loss_policy"] - before["loss_policy"]) > 1e-4
    torch.testing.assert_close(computed(gradients, parts, "policy", [batch] * 2), [after] * 2, rtol=1e-5, atol=1e-7)


def test_a_single_batch_is_computed_here(parts: Parts, gradients: ParallelGradients) -> None:
    batch = parts.states(3)
    found = computed(gradients, parts, "policy", [batch])
    torch.testing.assert_close(found, [parts.gradients("policy", batch)], rtol=0, atol=0)


def test_more_batches_than_processes_are_refused(parts: Parts, gradients: ParallelGradients) -> None:
    with pytest.raises(ConfigError, match="3 batches, expected at most 2, the processes"):
        computed(gradients, parts, "policy", [parts.states(3)] * 3)


def test_an_error_in_another_process_is_the_callers(parts: Parts, gradients: ParallelGradients) -> None:
    good, bad = parts.windows(8), parts.windows(8).select("robot_state")
    for batches in ([good, bad], [bad, good]):
        with pytest.raises(ObservationError, match="dynamics loss"):
            computed(gradients, parts, "model", batches)
        torch.testing.assert_close(
            computed(gradients, parts, "model", [good] * 2), [parts.gradients("model", good)] * 2, rtol=1e-5, atol=1e-7
        )


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
    falling, rising = (TensorDict({"x": sign * torch.arange(4.0)}, [4]) for sign in (-1, 1))
    with ParallelGradients({"x": loss}, [module], processes=2) as gradients:
        with pytest.raises(ObservationError, match="x is above 0"):
            list(gradients.backward("x", [falling, rising]))
        found = [
            (float(losses["loss_x"]), float(module.weight.grad))
            for losses in gradients.backward("x", [rising, falling])
        ]
        assert found == [(1.5, 1.5), (-1.5, -1.5)]
        assert "ended, with code -9; 1 process goes on without it" in capsys.readouterr().out
        assert gradients.processes == 1
        assert torch.get_num_threads() == threads


def test_what_cannot_be_sent_is_computed_here(capsys: pytest.CaptureFixture[str]) -> None:
    module = Drawing()
    module.lock = threading.Lock()
    loss = GraphedLoss(module, module.parameters(), CPU)
    with ParallelGradients({"x": loss}, [module], processes=2) as gradients:
        assert gradients.processes == 1
        assert len(list(gradients.backward("x", [TensorDict({"x": torch.zeros(4)}, [4])]))) == 1
    assert "one process computes gradients" in capsys.readouterr().out


def test_a_gpu_has_one_process() -> None:
    module = nn.Linear(2, 2, device="meta")  # which is not a CPU either
    with pytest.raises(ConfigError, match="2 processes, expected 1 on meta"):
        ParallelGradients({}, [module], processes=2)


def test_draws_follow_the_callers_stream() -> None:
    module = Drawing()
    loss, zeros = GraphedLoss(module, module.parameters(), CPU), TensorDict({"x": torch.zeros(2)}, [2])
    with ParallelGradients({"x": loss}, [module], processes=2) as gradients:
        drawn = []
        for seed in (0, 0, 1):
            torch.manual_seed(seed)
            drawn.append([float(losses["loss_x"]) for losses in gradients.backward("x", [zeros, zeros])])
    assert drawn[0] == drawn[1] != drawn[2]
    assert drawn[0][0] != drawn[0][1]


class Drawing(nn.Module):
    """A loss that draws."""

    def __init__(self) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.ones(()))

    def forward(self, batch: TensorDict) -> TensorDict:
        return TensorDict({"loss_x": self.weight * torch.randn_like(batch["x"]).mean()})
