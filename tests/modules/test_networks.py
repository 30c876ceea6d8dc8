import torch
from torch import nn

from plat.modules import ActionDecoder, Backbone, mlp
from plat.objectives import autocast


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
