from dataclasses import replace

import pytest
import torch
from tensordict.nn import TensorDictModule
from torch import nn

from plat.collectors import PrivilegedGoals
from plat.envs import KeyframeTaskConfig, make_keyframe_env
from plat.modules import (
    STUDENT_KEYS,
    ActionDecoder,
    Backbone,
    GoalSequenceEncoder,
    LatentPolicy,
    LatentPolicyConfig,
    LatentPosterior,
    LatentPrior,
    NormalizerConfig,
    ObservationNormalizer,
    PlainPolicy,
    ResidualLatentPolicy,
)
from plat.objectives import LatentImitationLoss
from plat.robots import G1
from plat.spec.observation import goal_keys, observation_size, student_keys

SMALL = LatentPolicyConfig(
    backbone=(32,), hidden_size=16, decoder=(32,), latent_size=4, prior=(16,), posterior=(16,), encoder_size=8
)


@pytest.fixture(scope="module")
def states(library):
    return PrivilegedGoals(library, stride=5)(make_keyframe_env(library, 12).reset())


@pytest.mark.parametrize("policy", [LatentPolicy(G1, SMALL), PlainPolicy(G1, SMALL)], ids=["latent", "plain"])
def test_deployed_policies_run_without_any_privileged_entry(states, policy):
    seen = states.select(*STUDENT_KEYS)
    assert not any(key in str(list(seen.keys(True))) for key in ("privileged", "dense_goal", "state"))
    assert policy.deployed()(seen)["action"].shape == (12, 29)
    assert set(policy.deployed().in_keys) <= set(STUDENT_KEYS)


def test_deployed_policy_holds_no_privileged_weights():
    policy = LatentPolicy(G1, SMALL)
    deployed = {id(parameter) for parameter in policy.deployed().parameters()}
    for part in (policy.encoder, policy.posterior):
        assert not deployed & {id(parameter) for parameter in part.parameters()}
    for part in (policy.backbone, policy.prior, policy.decoder):
        assert deployed & {id(parameter) for parameter in part.parameters()}


def test_deployed_policy_decodes_the_priors_mean(states):
    policy = LatentPolicy(G1, SMALL)
    features = policy.features()(states.select(*STUDENT_KEYS))
    expected = policy.decoder(features["hidden"], features["prior", "loc"])
    torch.testing.assert_close(policy.deployed()(states.select(*STUDENT_KEYS))["action"], expected)


def test_one_decoder_serves_both_latents(states):
    policy = LatentPolicy(G1, SMALL)
    out = policy.training_graph()(states.clone())
    for group in ("prior", "posterior"):
        expected = policy.decoder(out["hidden"], out[group, "latent"])
        torch.testing.assert_close(out[group, "action"], expected)


def test_the_posterior_depends_on_the_way_and_the_prior_does_not(states):
    policy = LatentPolicy(G1, SMALL)
    other = states.clone()
    other["privileged_goal", "frames"] = other["privileged_goal", "frames"] + 1.0
    first, second = policy.training_graph()(states.clone()), policy.training_graph()(other)
    assert torch.equal(first["prior", "loc"], second["prior", "loc"])
    assert not torch.allclose(first["posterior", "loc"], second["posterior", "loc"])


def test_sampled_policy_acts_through_the_prior(states):
    policy = LatentPolicy(G1, SMALL)
    seen = states.select(*STUDENT_KEYS)
    first, second = (policy.sampled()(seen.clone())["action"] for _ in range(2))
    assert not torch.equal(first, second)


def test_privileged_goals_keep_their_meaning(states):
    policy = LatentPolicy(G1, SMALL)
    policy.goal_normalizer.mean.fill_(1.0)
    out = policy.training_graph()(states.clone())
    raw = states["privileged_goal", "frames"]
    assert torch.equal(out["privileged_goal", "frames"], raw)
    torch.testing.assert_close(out["privileged_goal", "normalized"], ((raw - 1) / 1.01).clamp(-10, 10))


def test_statistics_of_the_goal_sequence_are_of_whole_keyframes(library):
    config = KeyframeTaskConfig(partial=0.5)
    policy = LatentPolicy(G1, replace(SMALL, also=("parts",)))
    env = make_keyframe_env(library, 32, config)
    visited = env.rollout(30, break_when_any_done=False)
    whole = torch.cat(list(visited["parts"].values()), -1).all(-1)
    assert 0.2 < whole.float().mean() < 0.9
    policy.update_normalizers(visited)
    goals = torch.cat([visited[key] for key in goal_keys()], -1)
    torch.testing.assert_close(policy.goal_normalizer.mean, goals[whole].mean(0), atol=1e-5, rtol=1e-4)
    torch.testing.assert_close(policy.goal_normalizer.var, goals[whole].var(0, correction=0), atol=1e-5, rtol=1e-3)
    # the student itself sees the zeros
    assert policy.normalizer.count == visited.numel()
    # keyframes of which none is whole have statistics all the same
    other = LatentPolicy(G1, replace(SMALL, also=("parts",)))
    other.update_normalizers(visited[~whole])
    assert other.goal_normalizer.count == (~whole).sum()


def test_plain_graph_writes_no_label(states):
    label = torch.full((12, 29), 7.0)
    out = PlainPolicy(G1, SMALL).training_graph()(states.clone().set("expert_action", label))
    assert torch.equal(out["expert_action"], label)
    assert out["action"].shape == (12, 29)


def test_a_policy_takes_all_of_its_parts():
    size, goal_size = observation_size(student_keys(), G1), observation_size(goal_keys(), G1)
    parts = {
        "normalizer": ObservationNormalizer(student_keys(), size),
        "backbone": Backbone(size, (8,), 6),
        "prior": LatentPrior(6, 3, (8,)),
        "goal_normalizer": ObservationNormalizer(goal_keys(), goal_size),
        "encoder": GoalSequenceEncoder(goal_size, 5),
        "posterior": LatentPosterior(6, 5, 3, (8,)),
        "decoder": ActionDecoder(6, 3, G1.num_joints, (8,)),
    }
    drawn = torch.random.get_rng_state()
    policy = LatentPolicy(G1, **parts)
    assert torch.equal(torch.random.get_rng_state(), drawn)  # nothing was built beside them
    assert all(getattr(policy, name) is part for name, part in parts.items())
    plain = PlainPolicy(G1, backbone=parts["backbone"], decoder=ActionDecoder(6, 0, G1.num_joints, (8,)))
    assert plain.backbone is parts["backbone"]


class Quantized(nn.Module):
    """Finite scalar quantization to three levels, with straight-through gradients."""

    def __init__(self, features: int, size: int):
        super().__init__()
        self.linear = nn.Linear(features, size)

    def forward(self, *features: torch.Tensor) -> torch.Tensor:
        value = self.linear(torch.cat(features, -1)).tanh()
        return value + (value.round() - value).detach()


def test_a_quantized_latent_is_a_composition(states):
    policy = LatentPolicy(
        G1,
        SMALL,
        prior=TensorDictModule(Quantized(16, 4), ["hidden"], [("prior", "code")]),
        posterior=TensorDictModule(Quantized(16 + 8, 4), ["hidden", "goal_code"], [("posterior", "code")]),
        sample=lambda group: TensorDictModule(nn.Identity(), [(group, "code")], [(group, "latent")]),
        mode=("prior", "code"),
    )
    loss = LatentImitationLoss(
        policy.training_graph(), divergence=nn.MSELoss(reduction="none"), parameters=("code",), beta=1.0
    )
    losses = loss(states.clone().set("expert_action", torch.zeros(12, 29)))
    sum(value for name, value in losses.items() if name.startswith("loss_")).backward()
    assert all(parameter.grad is not None for parameter in policy.parameters())
    seen = states.select(*STUDENT_KEYS)
    assert set(policy.features()(seen.clone())["prior", "code"].unique().tolist()) <= {-1.0, 0.0, 1.0}
    refined = ResidualLatentPolicy(policy)
    assert torch.equal(refined.deployed()(seen.clone())["action"], policy.deployed()(seen.clone())["action"])


def test_constants_of_parts_are_settings(states):
    policy = LatentPolicy(G1, replace(SMALL, normalizer=NormalizerConfig(clip=0.1), min_std=0.7))
    features = policy.features()(states.select(*STUDENT_KEYS))
    assert features["observation"].abs().max() <= 0.1
    assert features["prior", "scale"].min() >= 0.7


def test_a_part_of_a_deployed_policy_is_a_sequence():
    policy = LatentPolicy(G1, SMALL)
    deployed = policy.deployed()
    assert deployed[:1].out_keys == policy.features().out_keys
    assert deployed[1].out_keys == ["action"]
    hidden = deployed.select_subsequence(out_keys=["hidden"])
    assert "hidden" in hidden.out_keys
    assert "action" not in hidden.out_keys
    assert deployed.select_subsequence().out_keys[-1] == "action"
