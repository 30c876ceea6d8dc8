"""DAgger: the student acts, the expert says what it would have done."""

from collections.abc import Sequence

import torch
from tensordict import NestedKey, TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor
from torchrl.data import LazyTensorStorage, RandomSampler, TensorDictReplayBuffer

from plat.collectors.goals import PrivilegedGoals
from plat.motions.library import MotionLibrary
from plat.precision import Precision, autocast

__all__ = ["LOOKUP_KEYS", "ExpertLabels", "MixedPolicy", "dagger_buffer"]

LOOKUP_KEYS = (("motion", "frame"), ("command", "steps_left"), ("state", "root_pos_w"), ("state", "root_quat_w"))
"""What is stored of a state so that its privileged goals can be gathered later."""


class ExpertLabels:
    """Labels a rollout with the expert's actions and flattens it; also fits as ``postproc`` of a TorchRL collector.

    Args:
        expert: deterministic policy that writes its action to ``expert_action``, such as
            ``expert.deployed("dense_goal", out_key="expert_action")``.
        keys: entries to keep beside :data:`LOOKUP_KEYS` and the label: the student's observation.
        precision: of the expert's hidden layers, see :func:`plat.objectives.autocast`.

    Source: Ross et al., "A Reduction of Imitation Learning and Structured Prediction to No-Regret Online Learning",
    arXiv 1011.0686.
    """

    def __init__(self, expert: TensorDictModuleBase, keys: Sequence[NestedKey], precision: Precision = "auto"):
        self._expert = expert
        self._precision = precision
        self._keys = [*keys, *LOOKUP_KEYS, "expert_action"]

    @torch.no_grad()
    def __call__(self, rollout: TensorDictBase) -> TensorDictBase:
        """States ``[N * T]`` with ``expert_action``, from a rollout ``[N, T]``."""
        flat = rollout.exclude("next").reshape(-1)
        with autocast(rollout.device, self._precision):
            return self._expert(flat).select(*self._keys)


class MixedPolicy(TensorDictModuleBase):
    """Lets the expert take some of the steps, so that an untrained student gets to see more than its first fall.

    Args:
        student: writes ``action``.
        expert: writes ``expert_action``.
        expert_share: probability that a robot's next step is the expert's; a buffer, to be lowered while the student
            learns.
    """

    def __init__(self, student: TensorDictModuleBase, expert: TensorDictModuleBase, expert_share: float = 0.0):
        super().__init__()
        self.student = student
        self.expert = expert
        self.in_keys = list(dict.fromkeys([*student.in_keys, *expert.in_keys]))
        self.out_keys = ["action"]
        self.register_buffer("expert_share", torch.tensor(float(expert_share)))

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write the action that is taken."""
        tensordict = self.student(tensordict)
        if self.expert_share > 0:
            label: Tensor = self.expert(tensordict.select(*self.expert.in_keys))["expert_action"]
            by_expert = torch.rand(*tensordict.shape, 1, device=label.device) < self.expert_share
            tensordict["action"] = torch.where(by_expert, label, tensordict["action"])
        return tensordict


def dagger_buffer(
    library: MotionLibrary, capacity: int, batch_size: int, stride: int = 1, device: torch.device | str = "cpu"
) -> TensorDictReplayBuffer:
    """The aggregated data set: a ring of labelled states whose samples come with their privileged goals.

    Args:
        library: motions that the goals are gathered from.
        capacity: number of states; the oldest give way.
        batch_size: states a sample.
        stride: see :class:`PrivilegedGoals`.
    """
    return TensorDictReplayBuffer(
        storage=LazyTensorStorage(capacity, device=device),
        sampler=RandomSampler(),
        transform=PrivilegedGoals(library, stride),
        batch_size=batch_size,
    )
