from dataclasses import replace

import pytest
import torch
from tensordict import TensorDict
from torchrl.envs.utils import ExplorationType, set_exploration_type

from plat.envs import make_keyframe_env
from plat.modules import (
    STUDENT_KEYS,
    FinetunedPolicy,
    KeyframeLead,
    LatentNoisePolicy,
    LatentPolicy,
    RefinementConfig,
    ResidualActionPolicy,
    ResidualLatentPolicy,
)
from plat.robots import G1
from plat.spec.timing import Timing
from tests.modules.policies.test_student import SMALL

VARIANTS = [ResidualLatentPolicy, LatentNoisePolicy, ResidualActionPolicy, FinetunedPolicy]
FROZEN = VARIANTS[:3]


@pytest.fixture
def state(library) -> TensorDict:
    return make_keyframe_env(library, 6).reset()


@pytest.mark.parametrize("variant", VARIANTS)
def test_starts_at_exactly_the_students_action(state, variant):
    student = LatentPolicy(G1, SMALL)
    expected = student.deployed()(state.clone())["action"]
    policy = variant(student)
    assert torch.equal(policy.deployed()(state.clone())["action"], expected)
    with set_exploration_type(ExplorationType.DETERMINISTIC):
        assert torch.equal(policy.actor()(state.clone())["action"], expected)


@pytest.mark.parametrize("variant", VARIANTS)
def test_a_lead_moves_the_keyframe_and_nothing_else(state, variant):
    timing = Timing(max_steps=150)
    policy = variant(LatentPolicy(G1, replace(SMALL, timing=timing)), RefinementConfig(lead=0.05))
    student = policy.student.deployed()
    moved = KeyframeLead(0.05, horizon=3.0)(state.clone())
    state["goal"].update(moved["led_goal"])
    expected = student(state)["action"]
    assert set(policy.deployed().in_keys) == set(STUDENT_KEYS)
    original = moved.exclude("led_goal")
    assert torch.equal(policy.deployed()(original.clone())["action"], expected)
    with set_exploration_type(ExplorationType.DETERMINISTIC):
        assert torch.equal(policy.actor()(original)["action"], expected)


@pytest.mark.parametrize("variant", VARIANTS)
def test_head_reads_what_the_actor_wrote(state, variant):
    policy = variant(LatentPolicy(G1, SMALL))
    rollout = policy.actor()(state.clone())
    dist = policy.head().get_dist(rollout.select(*policy.head().in_keys))
    sample, log_prob = rollout[policy.sample_key], rollout[f"{policy.sample_key}_log_prob"]
    torch.testing.assert_close(dist.log_prob(sample), log_prob)
    assert rollout["action"].shape == (6, 29)


@pytest.mark.parametrize("variant", FROZEN)
def test_only_residual_and_noise_can_learn(variant):
    policy = variant(LatentPolicy(G1, SMALL))
    learning = {name.split(".")[0] for name, weight in policy.named_parameters() if weight.requires_grad}
    assert learning == {"residual", "noise"}


def test_finetuning_leaves_the_privileged_part_alone(state):
    policy = FinetunedPolicy(LatentPolicy(G1, SMALL))
    out = policy.head()(policy.frozen()(state.clone()))
    out["loc"].sum().backward()
    touched = {name.split(".")[1] for name, weight in policy.named_parameters() if weight.grad is not None}
    assert {"backbone", "prior", "decoder"} <= touched
    assert not touched & {"encoder", "posterior"}


@pytest.mark.parametrize("variant", VARIANTS)
def test_deployed_policies_read_the_students_observation(state, variant):
    deployed = variant(LatentPolicy(G1, SMALL)).deployed()
    assert set(deployed.in_keys) <= set(STUDENT_KEYS)
    assert deployed(state.select(*STUDENT_KEYS))["action"].shape == (6, 29)


def test_latent_noise_explores_along_the_decoder(state):
    policy = LatentNoisePolicy(LatentPolicy(G1, SMALL), RefinementConfig(init_std=0.5))
    rollout = policy.actor()(state.clone())
    assert rollout["sampled_latent"].shape == (6, SMALL.latent_size)
    expected = policy.student.decoder(rollout["hidden"], rollout["sampled_latent"])
    torch.testing.assert_close(rollout["action"], expected)


@pytest.mark.parametrize(("variant", "size"), [(ResidualLatentPolicy, SMALL.latent_size), (ResidualActionPolicy, 29)])
def test_residuals_act_where_they_should(state, variant, size):
    policy = variant(LatentPolicy(G1, SMALL), RefinementConfig(alpha=0.25))
    last = policy.residual.module.network[-1]
    torch.nn.init.ones_(last.bias)
    features = policy.student.features()(state.clone())
    latent = features["prior", "loc"]
    if variant is ResidualLatentPolicy:
        expected = policy.student.decoder(features["hidden"], latent + 0.25)
    else:
        expected = policy.student.decoder(features["hidden"], latent) + 0.25
    assert last.out_features == size
    torch.testing.assert_close(policy.deployed()(state.clone())["action"], expected)
