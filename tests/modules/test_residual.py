import torch

from plat.modules import Residual


def residual(alpha: float) -> Residual:
    return Residual(6, 4, 4, (8,), alpha, in_keys=("hidden", "z", "z"), out_key="out")


def test_starts_at_exactly_its_base():
    hidden, base = torch.randn(5, 6), torch.randn(5, 4)
    assert torch.equal(residual(0.7)(hidden, base, base), base)


def test_learns_from_the_first_step():
    module = residual(0.7)
    base = torch.randn(5, 4)
    module(torch.randn(5, 6), base, base).sum().backward()
    last = [parameter for parameter in module.parameters() if parameter.ndim == 2][-1]
    assert last.grad.abs().max() > 0


def test_alpha_scales_the_correction():
    hidden, base = torch.randn(5, 6), torch.randn(5, 4)
    small, large = residual(0.1), residual(1.0)
    with torch.no_grad():
        for parameter in small.parameters():
            parameter.normal_()
    large.load_state_dict(small.state_dict())
    torch.testing.assert_close(
        10 * (small(hidden, base, base) - base), large(hidden, base, base) - base, atol=1e-4, rtol=1e-4
    )
