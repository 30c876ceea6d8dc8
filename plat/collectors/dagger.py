"""DAgger: rollouts of the student, labeled with the teacher's actions."""

from collections.abc import Sequence

import torch
from tensordict import NestedKey, TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor
from torchrl.data import RandomSampler, TensorDictReplayBuffer

from plat.bounds import Count, Fraction, check_value
from plat.collectors.goals import PrivilegedGoals
from plat.collectors.storage import DeviceStorage
from plat.errors import ActionError
from plat.gpu import check_device
from plat.motions.library import MotionLibrary
from plat.precision import Precision, autocast
from plat.spec.timing import timing_of

__all__ = ["LOOKUP_KEYS", "ExpertLabels", "MixedPolicy", "dagger_buffer"]

LOOKUP_KEYS = (("motion", "frame"), ("command", "steps_left"), ("estimate", "root_pos_w"), ("estimate", "root_quat_w"))
"""What is stored of a state so that its privileged goals can be gathered later."""


class ExpertLabels:
    """DAgger labeling: adds the teacher's actions to a rollout and flattens it.

    It also fits as ``postproc`` of a TorchRL collector.

    Args:
        expert: deterministic policy that writes its action to ``expert_action``, as :meth:`plat.modules.Teacher.labels`
            returns it; None for rollouts that hold their labels, of a :class:`MixedPolicy` that keeps them.
        keys: entries to keep beside :data:`LOOKUP_KEYS` and the label: the student's observation.
        precision: of the teacher's hidden layers, see :func:`plat.objectives.autocast`.

    Source: Ross et al., "A Reduction of Imitation Learning and Structured Prediction to No-Regret Online Learning",
    arXiv 1011.0686.
    """

    def __init__(self, expert: TensorDictModuleBase | None, keys: Sequence[NestedKey], precision: Precision = "auto"):
        self._expert = expert
        self._precision = precision
        self._keys = [*keys, *LOOKUP_KEYS, "expert_action"]

    @torch.no_grad()
    def __call__(self, rollout: TensorDictBase) -> TensorDictBase:
        """Return states ``[N * T]`` with ``expert_action``, from a rollout ``[N, T]``.

        Of trajectories that a collector padded to one length (``split_trajs``), the padding is left out.

        Raises:
            ActionError: naming the entry, for states or labels that are not finite: they must not enter a buffer.
        """
        flat = rollout.exclude("next").reshape(-1)
        if (mask := flat.get(("collector", "mask"), None)) is not None:
            flat = flat[mask.view(-1)]
        if self._expert is not None:
            with autocast(rollout.device, self._precision):
                flat = self._expert(flat)
        states = flat.select(*self._keys)
        for key in self._keys:
            if not states.get(key).isfinite().all():
                raise ActionError(f"rollout: {key} holds NaN or infinity; nothing of it is kept")
        return states


class MixedPolicy(TensorDictModuleBase):
    """Mixture of student and teacher: the teacher takes some of the steps, so that an untrained student reaches more
    states.

    Args:
        student: writes ``action``.
        expert: writes ``expert_action``.
        expert_share: probability that a robot's next step is the teacher's; a buffer, to be lowered while the student
            learns.
        keep_labels: label every step and keep the label in the rollout. A stateful teacher needs it.
    """

    def __init__(
        self,
        student: TensorDictModuleBase,
        expert: TensorDictModuleBase,
        expert_share: float = 0.0,
        *,
        keep_labels: bool = False,
    ):
        super().__init__()
        check_value("mixed policy: expert_share", expert_share, Fraction)
        self.student = student
        self.timing = timing_of(student)  # the teacher's may be another
        self.expert = expert
        self.keep_labels = keep_labels
        self.in_keys = list(dict.fromkeys([*student.in_keys, *expert.in_keys]))
        self.out_keys = ["action", "expert_action"] if keep_labels else ["action"]
        self.register_buffer("expert_share", torch.tensor(float(expert_share)))

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write the action to take, and the label where it is kept."""
        seen = tensordict.select(*self.expert.in_keys)
        tensordict = self.student(tensordict)
        if not (self.keep_labels or self.expert_share > 0):
            return tensordict
        label: Tensor = self.expert(seen)["expert_action"]
        if self.keep_labels:
            tensordict["expert_action"] = label
        if self.expert_share > 0:
            by_expert = torch.rand(*tensordict.shape, 1, device=label.device) < self.expert_share
            tensordict["action"] = torch.where(by_expert, label, tensordict["action"])
        return tensordict


def dagger_buffer(
    library: MotionLibrary, capacity: int, batch_size: int, stride: int = 1, device: torch.device | str = "cpu"
) -> TensorDictReplayBuffer:
    """Return the aggregated data set: a ring buffer of labeled states, sampled with their privileged goals.

    Args:
        library: motions that the goals are gathered from, on any device.
        capacity: number of states; the oldest are overwritten.
        batch_size: states per sample.
        stride: see :class:`PrivilegedGoals`.
        device: of the states and of their goals.
    """
    check_value("buffer: capacity", capacity, Count)
    check_value("buffer: batch_size", batch_size, Count)
    return TensorDictReplayBuffer(
        storage=DeviceStorage(capacity, device=check_device(device)),
        sampler=RandomSampler(),
        transform=PrivilegedGoals(library.to(device), stride),
        batch_size=batch_size,
    )
