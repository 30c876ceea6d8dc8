"""Policies and models in float64, as gradients are checked in: they compute what they compute in float32."""

import copy

import pytest
import torch

from plat.envs import GeneralizedState
from plat.modules import (
    Critic,
    DynamicsConfig,
    DynamicsModel,
    Expert,
    ExpertConfig,
    LatentPolicy,
    LatentPolicyConfig,
    PlainPolicy,
    PlainPolicyConfig,
    RefinementConfig,
    ResidualActionPolicy,
    ResidualLatentPolicy,
    WalkingReach,
    mlp,
)
from plat.objectives import LatentImitationLoss
from plat.robots import G1
from plat.spec.observation import privileged_keys
from plat.tasks import DenseTracking, TimedKeyframes, TimedKeyframesConfig

SMALL = LatentPolicyConfig(backbone=(8,), hidden_size=8, decoder=(8,), prior=(8,), posterior=(8,), encoder_size=8)


@pytest.fixture(scope="module")
def keyframes(library):
    task = TimedKeyframes(library, TimedKeyframesConfig(chains=6))
    state, memory = task.start(4)
    seen = task.observe(state, memory)
    seen["privileged_goal"] = task.privileged(state, memory)
    return seen.set("expert_action", torch.zeros(4, 29))


def in_double(values):
    return values.apply(lambda value: value.double() if value.is_floating_point() else value)


@pytest.mark.parametrize(
    "policy",
    [
        LatentPolicy(G1, SMALL),
        PlainPolicy(G1, PlainPolicyConfig(backbone=(8,), also=("parts",), reach=WalkingReach(), symmetric=True)),
        ResidualLatentPolicy(LatentPolicy(G1, SMALL), RefinementConfig(lead=0.05)),
        ResidualActionPolicy(LatentPolicy(G1, SMALL)),
    ],
    ids=lambda policy: type(policy).__name__,
)
def test_policies(keyframes, policy):
    action = policy.deployed()(keyframes.copy())["action"]
    double = copy.deepcopy(policy).double().deployed()(in_double(keyframes))["action"]
    assert double.dtype == torch.float64
    torch.testing.assert_close(double, action.double(), atol=1e-4, rtol=1e-4)


def test_expert(library):
    config = ExpertConfig(hidden=(8,), action="reference_velocity", ahead=(1, 2), lead=0.065, symmetric=True)
    expert = Expert(G1, config)
    task = DenseTracking(library, expert.goals)
    seen = task.observe(*task.start(4))
    action = expert.deployed()(seen.copy())["action"]
    double = expert.double().deployed()(in_double(seen))["action"]
    torch.testing.assert_close(double, action.double(), atol=1e-4, rtol=1e-4)


def test_imitation_loss(keyframes):
    policy = LatentPolicy(G1, SMALL).double()
    losses = LatentImitationLoss(policy.training_graph()).double()(in_double(keyframes))
    losses["loss_posterior"].backward()
    assert policy.encoder.module.embed[0].weight.grad.dtype == torch.float64


def test_networks():
    assert mlp(3, (4,), 2).double()(torch.zeros(1, 3, dtype=torch.float64)).dtype == torch.float64
    critic = Critic(G1, privileged_keys(), (4,)).double()
    size = len(critic.normalizer.mean)
    value = critic.head()(critic_observation=torch.zeros(2, size, dtype=torch.float64))
    assert value.dtype == torch.float64
    state = GeneralizedState.unpack(torch.nn.functional.pad(torch.ones(2, 1), (3, 67)).double())
    after = DynamicsModel(G1, DynamicsConfig(hidden=(4,))).double()(state, torch.zeros(2, 29, dtype=torch.float64))
    assert after.joint_vel.dtype == torch.float64
