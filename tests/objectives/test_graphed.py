"""The loss that a GPU runs as one graph. Its kernels need a GPU; what may be in it is seen on the device "meta"."""

import copy
from collections import Counter

import pytest
import torch
from tensordict import TensorDict
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from plat.envs.transforms import NoiseLevels
from plat.envs.transforms.settings import robot_ranges
from plat.modules import DynamicsConfig, DynamicsModel, Expert, ExpertConfig, PlainPolicy, PlainPolicyConfig
from plat.objectives import DynamicsLoss, GraphedLoss, ImaginationLoss
from plat.objectives.imagination_learner import _Critic
from plat.robots import G1
from plat.spec.timing import Timing
from plat.tasks import DenseTracking, SimulatedTask, TimedKeyframes, TimedKeyframesConfig
from plat.tasks.disturbed import measuring
from plat.tasks.settings import TrackingCosts

CPU = torch.device("cpu")
needs_gpu = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")


def starts(task, count=8):
    state, memory = task.start(count)
    return TensorDict({"robot_state": state.pack(), "memory": memory}, [count])


class FromTheCPU(TorchDispatchMode):
    """Counts operations that read the CPU, which a graph cannot."""

    def __init__(self):
        super().__init__()
        self.found = Counter()

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        devices = {leaf.device.type for leaf in tree_leaves((args, kwargs)) if isinstance(leaf, torch.Tensor)}
        if "cpu" in devices:
            self.found[str(func)] += 1
        return func(*args, **(kwargs or {}))


def policy_for(task):
    policy = PlainPolicy(G1, PlainPolicyConfig(also=("parts", "clock"), timing=task.timing))
    return policy, policy.deployed()


def keyframes(library):
    config = TimedKeyframesConfig(chains=12, partial=0.4, tracking=TrackingCosts(bodies=12, end_effectors=6, miss=2))
    return TimedKeyframes(library, config, timing=Timing(max_steps=150))


@pytest.mark.parametrize("kind", ["dense", "keyframes", "whole keyframes", "disturbed", "critic"])
def test_what_imagination_runs_depends_on_no_value(library, kind):
    """On "meta" nothing has a value: whatever asks for one fails."""
    critic = None
    parameters = 0
    if kind == "dense":
        task, expert = DenseTracking(library), Expert(G1, ExpertConfig(hidden=(16,)))
        policy, actor = expert, expert.deployed()
        batch = starts(task)
    elif kind == "whole keyframes":
        task = TimedKeyframes(library, TimedKeyframesConfig(chains=12, partial=0.0))
        policy = PlainPolicy(G1)
        actor, batch = policy.deployed(), starts(task)
    else:
        task = keyframes(library)
        policy, actor = policy_for(task)
        batch = starts(task)
    if kind == "disturbed":
        env = SimulatedTask(task, 8, randomization=robot_ranges(1.0))
        parameters = env.reset()["memory", "physics"].shape[-1]
        batch = env.reset().select("robot_state", "memory")
        actor = measuring(actor, NoiseLevels())
    if kind == "critic":
        critic = _Critic(task, actor, (16,), 3.0)
    model = DynamicsModel(G1, DynamicsConfig(hidden=(16,)), num_parameters=parameters)
    loss = ImaginationLoss(actor, model, task, steps=6, critic=None if critic is None else critic.estimate())
    task = copy.deepcopy(task)  # the fixture's library is everybody's
    loss.task = task
    assert task.static
    assert loss.static
    for module in (policy, actor, model, task, critic):
        if module is not None:
            module.to("meta")
    learning = [p for module in (policy, critic) if module is not None for p in module.parameters()]
    meta, losses = batch.to("meta"), GraphedLoss(loss, learning, torch.device("meta"), "float32")
    losses.backward(meta)  # constants are copied the first time
    with FromTheCPU() as reads:
        out = losses.backward(meta)
    assert not reads.found
    assert out["loss_policy"].device.type == "meta"


def test_what_the_model_learns_from_depends_on_no_value():
    model = DynamicsModel(G1, DynamicsConfig(hidden=(16,))).to("meta")
    state = torch.zeros(2, 5, 71, device="meta")
    windows = TensorDict({"robot_state": state, "action": torch.zeros(2, 5, 29, device="meta")}, [2, 5])
    losses = GraphedLoss(DynamicsLoss(model), model.parameters(), torch.device("meta"), "float32")
    losses.backward(windows)
    with FromTheCPU() as reads:
        losses.backward(windows)
    assert not reads.found


def test_gradients_are_those_of_the_loss(library):
    task = DenseTracking(library)
    expert, model = Expert(G1, ExpertConfig(hidden=(16,))), DynamicsModel(G1, DynamicsConfig(hidden=(16,)))
    loss, batch = ImaginationLoss(expert.deployed(), model, task, steps=3), starts(task)
    loss(batch)["loss_policy"].backward()
    wanted = [parameter.grad for parameter in expert.parameters()]
    losses = GraphedLoss(loss, expert.parameters(), CPU, "float32")
    for _ in range(2):  # gradients are replaced, not added up
        out = losses.backward(batch)
    assert any(gradient is not None for gradient in wanted)
    for parameter, gradient in zip(expert.parameters(), wanted, strict=True):
        assert (parameter.grad is None) == (gradient is None)
        if gradient is not None:
            torch.testing.assert_close(parameter.grad, gradient)
    assert not any(value.requires_grad for value in out.values())


def test_a_weight_that_the_loss_does_not_reach_has_no_gradient():
    model, idle = torch.nn.Linear(2, 1), torch.nn.Parameter(torch.ones(1))

    class Loss(torch.nn.Module):
        def forward(self, batch):
            return TensorDict({"loss_value": model(batch["x"]).mean(), "seen": torch.ones(())})

    out = GraphedLoss(Loss(), [*model.parameters(), idle], CPU).backward(TensorDict({"x": torch.ones(3, 2)}, [3]))
    assert idle.grad is None
    assert model.weight.grad.tolist() == [[1.0, 1.0]]
    assert sorted(out) == ["loss_value", "seen"]


def test_what_is_frozen_has_a_loss_and_no_gradient():
    model = DynamicsModel(G1, DynamicsConfig(hidden=(16,))).requires_grad_(False)
    state = torch.nn.functional.pad(torch.ones(2, 3, 1), (3, 67))
    windows = TensorDict({"robot_state": state, "action": torch.zeros(2, 3, 29)}, [2, 3])
    losses = GraphedLoss(DynamicsLoss(model), model.parameters(), CPU).backward(windows)
    assert losses["loss_dynamics"] > 0
    assert all(parameter.grad is None for parameter in model.parameters())


@needs_gpu
def test_the_graph_computes_what_python_does(library):
    device = torch.device("cuda")
    task = DenseTracking(library).to(device)
    expert = Expert(G1, ExpertConfig(hidden=(32,))).to(device)
    model = DynamicsModel(G1, DynamicsConfig(hidden=(32,))).to(device)
    loss = ImaginationLoss(expert.deployed(), model, task, steps=8)
    graphed = GraphedLoss(loss, expert.parameters(), device, "float32")
    usual = GraphedLoss(loss, expert.parameters(), device, "float32", capture=False)
    for count in (16, 16, 16, 5):  # the last is of another shape, and is computed as usual
        batch = starts(task, count).to(device)
        wanted = usual.backward(batch)
        gradients = {name: parameter.grad.clone() for name, parameter in expert.network.named_parameters()}
        found = graphed.backward(batch)
        torch.testing.assert_close(found["loss_policy"], wanted["loss_policy"])
        for name, parameter in expert.network.named_parameters():
            torch.testing.assert_close(parameter.grad, gradients[name], rtol=1e-3, atol=1e-6)


@needs_gpu
def test_a_graph_follows_the_weights_and_draws_anew(library):
    device = torch.device("cuda")
    task = copy.deepcopy(keyframes(library)).to(device)
    policy, actor = policy_for(task)
    policy.to(device)
    actor.to(device)
    loss = ImaginationLoss(actor, DynamicsModel(G1).to(device), task, steps=12)
    graphed, batch = GraphedLoss(loss, policy.parameters(), device), starts(task, 64).to(device)
    before, again = (float(graphed.backward(batch)["loss_policy"]) for _ in range(2))
    assert before != again  # new commands are drawn within the rollout
    optimizer = torch.optim.Adam(policy.parameters(), lr=3e-3, fused=True)
    for _ in range(30):
        graphed.backward(batch)
        optimizer.step()
    assert float(graphed.backward(batch)["loss_policy"]) < before
