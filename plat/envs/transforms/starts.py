"""Start sampling: failure-weighted starts, and fixed ones."""

import warnings
from typing import Annotated, Any

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.envs import Transform

from plat.bounds import Count, Fraction, Natural, Positive, Range, Robots, check_value
from plat.envs.transforms.base import Statistics
from plat.motions.bins import ClipBins
from plat.motions.library import MotionLibrary

__all__ = ["FailureWeightedStarts", "FirstFrames"]


class FirstFrames(Transform):
    """Starts of robot ``i`` on the first frame of clip ``i``, at every reset.

    Args:
        library: as many motions as there are robots.
    """

    def __init__(self, library: MotionLibrary):
        super().__init__()
        self._start = library.clip_start

    def _reset_env_preprocess(self, tensordict: TensorDictBase | None) -> TensorDictBase:
        if tensordict is None:
            tensordict = TensorDict({}, [len(self._start)], device=self._start.device)
        tensordict["motion"] = TensorDict({"start": self._start}, [len(self._start)])
        return tensordict


class FailureWeightedStarts(Transform):
    """Failure-weighted start sampling: episodes start more often where the policy fails.

    Motions are cut into bins of a second. Bins are drawn in proportion to a moving average of their failures, which is
    spread over the bins just before. A fraction of the draws stays uniform over all frames. Put it after the
    termination transform. After ``set_seed`` the failures are forgotten: the same episodes follow the same seed.

    Args:
        library: motions.
        num_envs: number of robots N.
        uniform: fraction of the starts that are uniform over frames.
        bin_seconds: length of a bin (s).
        lead: number of bins, counted back from the one of the failure, that share its weight.
        decay: weight of each bin relative to the one after it.
        memory: the moving average forgets by ``1 / e`` in this many steps, at least 2.
        min_frames_left: as in :class:`plat.envs.MotionTrackingEnv`.

    Source: adaptive sampling of BeyondMimic, arXiv 2508.08241.
    """

    def __init__(
        self,
        library: MotionLibrary,
        num_envs: int,
        *,
        uniform: float = 0.5,
        bin_seconds: float = 1.0,
        lead: int = 3,
        decay: float = 0.8,
        memory: int = 1000,
        min_frames_left: int = 1,
    ):
        super().__init__()
        for name, value, hint in (
            ("library", library, MotionLibrary),
            ("num_envs", num_envs, Robots),
            ("min_frames_left", min_frames_left, Natural),
            ("uniform", uniform, Fraction),
            ("bin_seconds", bin_seconds, Positive),
            ("lead", lead, Count),
            ("decay", decay, Positive),
            ("memory", memory, Annotated[int, Range(2)]),
        ):
            check_value(f"starts: {name}", value, hint)
        self.statistics = Statistics()
        self._num_envs = num_envs
        self._uniform = uniform
        self._forget = 1.0 - 1.0 / memory
        kernel = decay ** torch.arange(lead, dtype=torch.float32)
        self._kernel = kernel / kernel.sum()
        self._bins = ClipBins(library, min_frames_left, max(1, round(bin_seconds / library.dt)))
        self.register_buffer("failures", torch.zeros(self._bins.count, device=library.device))
        self._failure_cdf: Tensor | None = None
        self._scale = 1.0
        self._steps_since_cdf = 0
        self._seedings = 0

    def sample(self, count: int) -> Tensor:
        """Sample start frames ``[count]``."""
        frames = self._bins.draw_frames(count)
        if self._failure_cdf is None:
            return frames
        device = self.failures.device
        place = torch.searchsorted(self._failure_cdf, torch.rand(count, device=device)).clamp_max(self._bins.count - 1)
        return torch.where(torch.rand(count, device=device) < self._uniform, frames, self._bins.draw_within(place))

    def record(self, frame: Tensor) -> None:
        """Count failures at frames ``[n]``."""
        for back, share in enumerate(self._kernel.tolist()):
            bins = self._bins.of_frame(frame, back)
            # newer failures are scaled up instead of older ones down: the cost of a step is then constant
            amount = torch.full((len(bins),), share * self._scale, device=bins.device)
            self.failures.index_add_(0, bins, amount)

    def forget(self) -> None:
        """Call :meth:`forget_all`, with a warning: the old name of it."""
        told = "FailureWeightedStarts.forget is now forget_all; the old name is removed in version 0.3"
        warnings.warn(told, FutureWarning, stacklevel=2)
        self.forget_all()

    def forget_all(self) -> None:
        """Forget all failures, so that the next starts are uniform again."""
        self.failures.zero_()
        self._failure_cdf = None
        self._scale = 1.0
        self._steps_since_cdf = 0

    def get_extra_state(self) -> dict[str, Any]:
        """Return, for :meth:`state_dict`, what the next draws depend on beside :attr:`failures`."""
        return {
            "failure_cdf": self._failure_cdf,
            "scale": self._scale,
            "steps_since_cdf": self._steps_since_cdf,
        }

    def set_extra_state(self, state: dict[str, Any]) -> None:
        """Restore what :meth:`get_extra_state` returned."""
        cdf = state["failure_cdf"]
        self._failure_cdf = None if cdf is None else cdf.to(self.failures.device)
        self._scale, self._steps_since_cdf = float(state["scale"]), int(state["steps_since_cdf"])
        self._seedings = self._seedings_of_env()  # what was restored after a seed was set is not forgotten for it

    def _seedings_of_env(self) -> int:
        return getattr(self.container, "seedings", 0)

    def _advance(self) -> None:
        self._scale /= self._forget
        self._steps_since_cdf += 1
        # the only operation over all bins, therefore rare
        if self._steps_since_cdf >= 50:
            self.failures /= self._scale
            self._scale = 1.0
            self._steps_since_cdf = 0
            total = self.failures.sum()
            self._failure_cdf = _cdf(self.failures) if total > 0 else None
            if total > 0:
                share = self.failures / total
                self.statistics.add("starts/top_bin_share", share.max())

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        failed = next_tensordict["terminated"][:, 0]
        if failed.any():
            self.record(next_tensordict["motion", "frame"][failed])
        self._advance()
        return next_tensordict

    def _reset_env_preprocess(self, tensordict: TensorDictBase | None) -> TensorDictBase:
        if self._seedings != self._seedings_of_env():
            self.forget_all()
            self._seedings = self._seedings_of_env()
        if tensordict is None:
            tensordict = TensorDict({}, [self._num_envs], device=self.failures.device)
        tensordict["motion"] = TensorDict({"start": self.sample(self._num_envs)}, [self._num_envs])
        return tensordict


def _cdf(weights: Tensor) -> Tensor:
    return weights.cumsum(0) / weights.sum()
