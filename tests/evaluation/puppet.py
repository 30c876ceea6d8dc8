"""A robot that is wherever a test wants it, for metrics with known answers."""

from collections.abc import Callable

import pytest
import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from plat.envs import MotionTrackingEnv
from plat.envs.transforms import Horizon
from plat.evaluation import CommandRecords, evaluate
from plat.motions import MotionLibrary

Offset = Callable[[Tensor], Tensor]


def still(tensordict: TensorDictBase) -> TensorDictBase:
    """A policy for robots that are moved by hand."""
    return tensordict.set("action", torch.zeros(*tensordict.shape, 29))


def evaluate_puppet(
    monkeypatch: pytest.MonkeyPatch, library: MotionLibrary, horizon: Horizon, offset: Offset, **kwargs
) -> CommandRecords:
    """Evaluate a robot that is on the reference but for an ``offset`` of its qpos ``[n, 36]`` at frames ``[n]``."""
    monkeypatch.setattr("plat.evaluation.rollout.MotionTrackingEnv", puppet(offset))
    return evaluate(still, library, horizon, **kwargs)


def puppet(offset: Offset) -> type[MotionTrackingEnv]:
    """Environment whose robots are on the reference but for an offset."""

    class Puppet(MotionTrackingEnv):
        def _step(self, tensordict: TensorDictBase) -> TensorDict:
            self._last_action = tensordict["action"]
            self._frame = self._frame + 1
            qpos, qvel = self._start_state(self._frame)
            self.physics.set_state(torch.arange(self.num_envs), qpos + offset(self._frame), qvel)
            out = self._observe()
            truncated = (self._frame >= self.library.last_frame[self._frame])[:, None]
            flags = {"terminated": torch.zeros_like(truncated), "truncated": truncated, "done": truncated.clone()}
            return out.update({"reward": torch.zeros(self.num_envs, 1), **flags})

    return Puppet


def nowhere(frame: Tensor) -> Tensor:
    """No offset."""
    return torch.zeros(len(frame), 36, dtype=torch.float64)
