from dataclasses import replace

import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule, TensorDictSequential
from torchrl.envs.utils import ExplorationType, set_exploration_type

from plat.envs import DistillationTaskConfig, make_keyframe_env
from plat.errors import ConfigError
from plat.modules import (
    STUDENT_KEYS,
    FinetunedPolicy,
    KeyframeLead,
    LatentNoisePolicy,
    LatentPolicy,
    PlainPolicy,
    RefinementConfig,
    ResidualActionPolicy,
    ResidualLatentPolicy,
)
from plat.modules.settings import WalkingReach
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


@pytest.mark.parametrize("reach", [None, WalkingReach()])
def test_what_is_not_commanded_stays_0_with_a_lead(library, reach):
    student = LatentPolicy(G1, replace(SMALL, also=("parts",), reach=reach))
    before, _ = ResidualLatentPolicy(student, RefinementConfig(lead=0.05)).shown()
    state = TensorDictSequential(*before)(make_keyframe_env(library, 32, DistillationTaskConfig(partial=1.0)).reset())
    moved, bodies = state["led_goal", "keypoint_pos_b"].unflatten(-1, (-1, 3)), state["parts", "bodies"]
    assert (bodies == 0).any()
    assert (moved[bodies == 0] == 0).all()


@pytest.mark.parametrize("variant", VARIANTS)
def test_a_student_without_a_latent_is_refused(variant):
    with pytest.raises(ConfigError, match="student is a PlainPolicy, expected a LatentPolicy"):
        variant(PlainPolicy(G1))


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


def test_the_student_of_a_refinement_learns_when_it_is_fine_tuned():
    """Its weights were frozen there, and stayed so: the exploration noise alone learned."""
    refined = ResidualLatentPolicy(LatentPolicy(G1, SMALL))
    policy = FinetunedPolicy(refined.student)
    assert all(weight.requires_grad for weight in policy.parameters())
    assert not any(weight.requires_grad for weight in refined.student.parameters())


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


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_callers_student_is_left_alone(state, variant):
    student = LatentPolicy(G1, SMALL)
    before = {name: weight.clone() for name, weight in student.state_dict().items()}
    policy = variant(student)
    assert all(weight.requires_grad for weight in student.parameters())
    assert policy.robot is policy.student.robot is G1
    with torch.no_grad():
        for weight in policy.parameters():
            weight.add_(1.0)
    assert all(torch.equal(weight, before[name]) for name, weight in student.state_dict().items())


def test_a_residual_of_ones_own(state):
    class Zero(torch.nn.Module):
        def forward(self, latent: torch.Tensor) -> torch.Tensor:
            return 0 * latent

    student = LatentPolicy(G1, SMALL)
    drawn = torch.random.get_rng_state()
    residual = TensorDictModule(Zero(), [("prior", "loc")], ["refined_latent"])
    policy = ResidualLatentPolicy(student, residual=residual)
    assert torch.equal(torch.random.get_rng_state(), drawn)
    features = student.features()(state.clone())
    expected = student.decoder(features["hidden"], 0 * features["prior", "loc"])
    assert torch.equal(policy.deployed()(state.clone())["action"], expected)


def test_the_shortest_lead_is_a_setting(state):
    student = LatentPolicy(G1, SMALL)
    state["command", "horizon"] = torch.full_like(state["command", "horizon"], 0.02)
    usual, slower = (
        ResidualLatentPolicy(student, RefinementConfig(lead=0.1, shortest_lead=shortest)).frozen()(state.clone())
        for shortest in (0.1, 0.2)
    )
    way = state["goal", "root_pos_b"][:, :2]
    torch.testing.assert_close(usual["led_goal", "root_pos_b"][:, :2], 2 * way)
    torch.testing.assert_close(slower["led_goal", "root_pos_b"][:, :2], 1.5 * way)
