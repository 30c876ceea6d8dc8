"""Action decoder ``a = pi_theta(h, z)``."""

from collections.abc import Sequence

import torch
from tensordict import NestedKey
from tensordict.nn import TensorDictModule
from torch import Tensor, nn

from plat.bounds import Count, Natural, check_value
from plat.entries import expects
from plat.errors import ConfigError
from plat.modules.networks import mlp

__all__ = ["ActionDecoder"]


class ActionDecoder(nn.Module):
    """Action decoder for posterior and prior latents alike; without a latent, the plain policy ``pi_theta(h)``.

    :meth:`using` makes TensorDict modules of it that share these weights.

    Args:
        hidden_features: size of ``h``.
        latent_size: size of ``z``; 0 for a decoder without a latent.
        num_actions: size of ``a``.
        hidden: sizes of the hidden layers.

    >>> from tensordict import TensorDict
    >>> decoder = ActionDecoder(16, 8, 29, (32,))
    >>> step = decoder.using("hidden", ("prior", "loc"))
    >>> step(TensorDict({"hidden": torch.zeros(4, 16), "prior": {"loc": torch.zeros(4, 8)}}, [4]))["action"].shape
    torch.Size([4, 29])
    """

    def __init__(self, hidden_features: int, latent_size: int, num_actions: int, hidden: Sequence[int]):
        super().__init__()
        check_value("decoder: hidden_features", hidden_features, Count)
        check_value("decoder: latent_size", latent_size, Natural)
        self.widths = (hidden_features, latent_size)[: 2 if latent_size else 1]
        self.network = mlp(hidden_features + latent_size, hidden, num_actions)

    def forward(self, *features: Tensor) -> Tensor:
        """Return actions ``[*B, num_actions]`` for ``h`` and ``z`` ``[*B, ...]``."""
        return self.network(torch.cat(features, -1))

    def using(self, *in_keys: NestedKey, out_key: NestedKey = "action") -> TensorDictModule:
        """Return this decoder as a module that reads ``h`` and ``z`` from ``in_keys``.

        Raises:
            ConfigError: for another number of keys than the decoder reads.
        """
        if len(in_keys) != len(self.widths):
            raise ConfigError(f"decoder: {len(in_keys)} entries {in_keys}, expected {len(self.widths)}")
        shapes = {key: (width,) for key, width in zip(in_keys, self.widths, strict=True)}
        return expects(TensorDictModule(self, in_keys=list(in_keys), out_keys=[out_key]), shapes, "decoder")
