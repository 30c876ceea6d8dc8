"""Running normalization of observations to zero mean and unit variance."""

from collections.abc import Sequence

import torch
from tensordict import NestedKey, TensorDictBase
from tensordict.nn import TensorDictModule
from torch import Tensor, nn

from plat.bounds import Count, as_names, check_value
from plat.entries import Shape, check_entries, expects
from plat.errors import ActionError, ConfigError
from plat.modules.settings import NormalizerConfig

__all__ = ["NormalizerConfig", "ObservationNormalizer"]


class ObservationNormalizer(nn.Module):
    """Running normalizer: concatenates entries and normalizes them.

    ``out = clip((x - mean) / (std + eps))``. The statistics are buffers: they are saved and exported with the policy,
    and change only in :meth:`update`. Call that after the update that used the data, never before: statistics that
    move between acting and learning look to PPO like a changed policy.

    Args:
        in_keys: entries ``[*B, n_i]`` that :meth:`update` reads, and :meth:`using` by default.
        num_features: their total size F.
        config: offset of the standard deviation, and bound on the result.
        widths: size of each entry; entries are checked against it. None for entries that are not checked.

    >>> from tensordict import TensorDict
    >>> normalizer = ObservationNormalizer(["a", "b"], num_features=3)
    >>> data = TensorDict({"a": torch.randn(64, 2), "b": 5 + torch.randn(64, 1)}, [64])
    >>> normalizer.update(data)
    >>> abs(normalizer.using()(data)["observation"].mean().item()) < 0.1
    True
    """

    mean: Tensor
    var: Tensor
    count: Tensor

    def __init__(
        self,
        in_keys: Sequence[NestedKey],
        num_features: int,
        config: NormalizerConfig | None = None,
        widths: Sequence[int] | None = None,
    ):
        super().__init__()
        check_value("observation: num_features", num_features, Count)
        check_value("observation: config", config, NormalizerConfig | None)
        if not in_keys:
            raise ConfigError("observation: in_keys is empty, expected the entries that are normalized")
        if widths is not None and sum(widths) != num_features:
            raise ConfigError(f"widths: {sum(widths)} in all, expected num_features, {num_features}")
        self.widths = None if widths is None else tuple(widths)
        config = config or NormalizerConfig()
        self.in_keys = list(as_names(in_keys))
        self.eps = config.eps
        self.clip = config.clip
        self.register_buffer("mean", torch.zeros(num_features))
        self.register_buffer("var", torch.ones(num_features))
        self.register_buffer("count", torch.zeros((), dtype=torch.float64))

    def forward(self, *entries: Tensor) -> Tensor:
        """Return the normalized observation ``[*B, F]`` of entries ``[*B, n_i]``."""
        # one pass and one buffer: at the sizes of a goal sequence fresh memory costs more than arithmetic
        factor = 1 / (self.var.sqrt() + self.eps)
        values = torch.addcmul(-self.mean * factor, torch.cat(entries, -1), factor)
        return values.clamp_(-self.clip, self.clip)

    def using(self, in_keys: Sequence[NestedKey] | None = None, out_key: NestedKey = "observation") -> TensorDictModule:
        """Return this normalizer as a module; several may share its statistics and read different entries."""
        keys = list(as_names(in_keys or self.in_keys))
        return expects(TensorDictModule(self, in_keys=keys, out_keys=[out_key]), self._shapes(keys), "observation")

    def _shapes(self, keys: Sequence[NestedKey]) -> dict[NestedKey, Shape]:
        """Return the shapes of entries in the place of ``in_keys``; a single one holds them all side by side."""
        if len(keys) == 1:
            return {keys[0]: (len(self.mean),)}
        if self.widths is None or len(self.widths) != len(keys):
            return {}
        return {key: (width,) for key, width in zip(keys, self.widths, strict=True)}

    @torch.no_grad()
    def update(self, tensordict: TensorDictBase) -> None:
        """Take a batch ``[*B]`` into the statistics (Chan et al. 1979, parallel variance); none if it is empty.

        Raises:
            ActionError: naming the entry, for a batch that is not finite; the statistics stay what they were.
            ObservationError: for an entry that is missing or of another width.
        """
        check_entries(tensordict, self._shapes(self.in_keys), "observation")
        values = torch.cat([tensordict.get(key) for key in self.in_keys], -1)
        values = values.view(-1, values.shape[-1])
        if len(values) == 0:
            return
        batch_mean = values.mean(0)
        batch_var = (values - batch_mean).square_().mean(0)  # torch.var_mean takes six times as long over rows
        if not torch.isfinite(batch_var).all():
            entry = max(self.in_keys, key=lambda key: float(tensordict.get(key).abs().nan_to_num(torch.inf).max()))
            raise ActionError(
                f"observation {entry}: holds NaN or infinity, or numbers too large to square; nothing was learned from "
                "this batch"
            )
        batch_var, batch_mean, batch_count = batch_var.double(), batch_mean.double(), len(values)
        count = self.count + batch_count
        delta = batch_mean - self.mean
        square_sum = self.var * self.count + batch_var * batch_count + delta**2 * self.count * batch_count / count
        self.mean += (delta * batch_count / count).to(self.mean)
        self.var.copy_(square_sum / count)
        self.count.copy_(count)
