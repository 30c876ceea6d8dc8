import pytest
import torch

from plat.collectors import PrivilegedGoals
from plat.envs import make_keyframe_env
from plat.modules import STUDENT_KEYS, LatentPolicy, LatentPolicyConfig, PlainPolicy
from plat.robots import G1

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
