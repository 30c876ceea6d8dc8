import pytest
import torch
from torch import nn

from plat.errors import ConfigError
from plat.modules import (
    ActionDecoder,
    Backbone,
    GaussianNoise,
    GoalSequenceEncoder,
    KeyframeReach,
    LatentPolicy,
    LatentPosterior,
    LatentPrior,
    ObservationNormalizer,
    ReferenceOffset,
    mlp,
)
from plat.modules.residual import Residual
from plat.objectives import autocast
from plat.robots import G1


def test_layers():
    sizes = [layer.out_features for layer in mlp(3, (8, 5), 2) if isinstance(layer, nn.Linear)]
    assert sizes == [8, 5, 2]


def test_out_scale():
    torch.manual_seed(0)
    full = mlp(3, (8,), 2)
    torch.manual_seed(0)
    tenth = mlp(3, (8,), 2, out_scale=0.1)
    inputs = torch.randn(4, 3)
    torch.testing.assert_close(0.1 * full(inputs), tenth(inputs))


def test_backbone_keys():
    backbone = Backbone(4, (8,), 3, in_key="obs", out_key="h")
    assert (backbone.in_keys, backbone.out_keys) == (["obs"], ["h"])


def test_backbone_computes_in_half_and_hands_on_float32():
    backbone, dtypes = Backbone(4, (8,), 3), []
    linear = [layer for layer in backbone.modules() if isinstance(layer, nn.Linear)]
    for layer in linear:
        layer.register_forward_hook(lambda _, __, out: dtypes.append(out.dtype))
    observation = torch.randn(5, 4)
    exact = backbone(observation=observation)
    with autocast("cpu", "bfloat16"):
        half = backbone(observation=observation)
    assert dtypes == [torch.float32, torch.float32, torch.bfloat16, torch.bfloat16]
    assert half.dtype == torch.float32
    torch.testing.assert_close(half, exact, atol=0.02, rtol=0.02)


def test_decoder_modules_share_their_weights():
    decoder = ActionDecoder(3, 2, 4, (8,))
    first, second = decoder.using("h", "z"), decoder.using("h", ("q", "z"), out_key=("q", "a"))
    assert next(first.parameters()) is next(second.parameters())
    assert second.out_keys == [("q", "a")]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: mlp(0, (8,), 2), "mlp: in_features is 0, expected a whole number of at least 1"),
        (lambda: mlp(3, (0,), 2), "mlp: hidden is .0,., expected a tuple, each a whole number from 1"),
        (lambda: mlp(3, 8, 2), "mlp: hidden is 8, expected a tuple"),
        (lambda: mlp(3, (8,), -2), "mlp: out_features is -2"),
        (lambda: ActionDecoder(8, -1, 4, (8,)), "decoder: latent_size is -1"),
        (lambda: LatentPrior(8, 0, (8,)), "prior: latent_size is 0"),
        (lambda: LatentPosterior(8, 8, 4, (8,), min_std=-1.0), "posterior: min_std is -1.0"),
        (lambda: GoalSequenceEncoder(80, 0), "goal encoder: hidden_size is 0"),
        (lambda: ObservationNormalizer([], 0), "observation: num_features is 0"),
        (lambda: ObservationNormalizer([], 1), "observation: in_keys is empty"),
        (lambda: GaussianNoise(0, 1.0), "exploration noise: num_actions is 0"),
        (lambda: ReferenceOffset(G1, ["a", "b"], "c", interval=0.0), "action on the reference: interval is 0.0"),
        (lambda: LatentPolicy(G1).imagined(1.5), "imagined: share is 1.5, expected a number from 0 to 1"),
        (lambda: KeyframeReach(None, 1.0), "reach: reach is None, expected a WalkingReach"),
        (lambda: Residual(8, 4, 4, (8,), -1.0, ("h", "z", "z"), "y"), "residual: alpha is -1.0"),
    ],
)
def test_sizes_that_make_no_sense_are_refused(make, message):
    with pytest.raises(ConfigError, match=message):
        make()
