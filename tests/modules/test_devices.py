"""Policies that are moved to a device before anything is made of them, as the recipes do it.

On "meta" operations have shapes and no values: what was left behind on the CPU is found without a GPU.
"""

import pytest
import torch

from plat.modules import (
    Expert,
    ExpertConfig,
    FinetunedPolicy,
    LatentNoisePolicy,
    LatentPolicy,
    LatentPolicyConfig,
    PlainPolicy,
    PlainPolicyConfig,
    RefinementConfig,
    ResidualActionPolicy,
    ResidualLatentPolicy,
    WalkingReach,
    take_over,
)
from plat.robots import G1
from plat.spec.timing import Timing
from plat.tasks import DenseTracking, TimedKeyframes, TimedKeyframesConfig

META = torch.device("meta")


def seen(task):
    return task.observe(*task.start(4)).to(META)


@pytest.fixture(scope="module")
def keyframes(library):
    task = TimedKeyframes(library, TimedKeyframesConfig(chains=6, partial=0.5), timing=Timing(max_steps=150))
    return seen(task)


@pytest.mark.parametrize(
    "config",
    [
        ExpertConfig(),
        ExpertConfig(action="default_offset"),
        ExpertConfig(action="reference_velocity", ahead=(1, 2), lead=0.065, catch_up=1.0),
    ],
)
def test_experts(library, config):
    expert = Expert(G1, config).to(META)
    observed = seen(DenseTracking(library, expert.goals))
    for actor in (expert.actor(), expert.deployed()):
        assert actor(observed.copy())["action"].device == META


@pytest.mark.parametrize("also", [(), ("parts", "clock")])
def test_students(keyframes, also):
    for student in (
        PlainPolicy(G1, PlainPolicyConfig(also=also, reach=WalkingReach())),
        LatentPolicy(G1, LatentPolicyConfig(also=also)),
    ):
        student.to(META)
        assert student.deployed()(keyframes.copy())["action"].device == META
        assert student.sampled()(keyframes.copy())["action"].device == META


@pytest.mark.parametrize("kind", [ResidualLatentPolicy, LatentNoisePolicy, ResidualActionPolicy, FinetunedPolicy])
def test_refined_students(keyframes, kind):
    policy = kind(LatentPolicy(G1), RefinementConfig(lead=0.05)).to(META)
    for actor in (policy.actor(), policy.deployed()):
        assert actor(keyframes.copy())["action"].device == META


def test_widening():
    small, large = (
        PlainPolicy(G1).to(META),
        PlainPolicy(G1, PlainPolicyConfig(also=("clock",), backbone=(600,))).to(META),
    )
    take_over(large, small)
    assert all(value.device == META for value in large.state_dict().values())
