import torch
from tensordict import TensorDict
from torchrl.envs.utils import ExplorationType, set_exploration_type

from plat.modules import LatentPosterior, LatentPrior, sample_latent


def test_prior_reads_only_the_deployable_features():
    assert LatentPrior(16, 8, (32,)).in_keys == ["hidden"]
    assert LatentPosterior(16, 12, 8, (32,)).in_keys == ["hidden", "goal_code"]


def test_keys_are_configurable():
    prior = LatentPrior(16, 8, (32,), in_key="h", group="p")
    out = prior(TensorDict({"h": torch.zeros(2, 16)}, [2]))
    assert out["p", "loc"].shape == out["p", "scale"].shape == (2, 8)


def test_standard_deviation_is_bounded_below():
    prior = LatentPrior(4, 2, ())
    with torch.no_grad():
        for layer in prior.parameters():
            layer.fill_(-50.0)
    assert prior(torch.ones(1, 4))[1].min() >= 1e-2


def test_samples_follow_the_distribution_and_carry_gradients():
    loc = torch.full((20000, 2), 1.5, requires_grad=True)
    scale = torch.full((20000, 2), 0.5)
    with set_exploration_type(ExplorationType.RANDOM):
        out = sample_latent("prior")(TensorDict({"prior": {"loc": loc, "scale": scale}}, [20000]))["prior", "latent"]
    assert abs(out.mean() - 1.5) < 0.02
    assert abs(out.std() - 0.5) < 0.02
    out.sum().backward()
    assert torch.equal(loc.grad, torch.ones_like(loc))


def test_deterministic_exploration_gives_the_mean():
    data = TensorDict({"prior": {"loc": torch.randn(3, 2), "scale": torch.ones(3, 2)}}, [3])
    with set_exploration_type(ExplorationType.DETERMINISTIC):
        assert torch.equal(sample_latent("prior")(data)["prior", "latent"], data["prior", "loc"])
