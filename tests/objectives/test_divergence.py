import torch
from torch.distributions import Normal, kl_divergence

from plat.objectives import gaussian_kl


def test_against_torch_distributions():
    loc, other_loc = torch.randn(2, 50, 4, dtype=torch.float64)
    scale, other_scale = 0.1 + 2 * torch.rand(2, 50, 4, dtype=torch.float64)
    expected = kl_divergence(Normal(loc, scale), Normal(other_loc, other_scale))
    torch.testing.assert_close(gaussian_kl(loc, scale, other_loc, other_scale), expected)


def test_zero_for_the_same_and_positive_otherwise():
    loc, scale = torch.randn(20, 3), 0.5 + torch.rand(20, 3)
    assert gaussian_kl(loc, scale, loc, scale).abs().max() < 1e-6
    assert (gaussian_kl(loc, scale, loc + 0.1, scale) > 0).all()
