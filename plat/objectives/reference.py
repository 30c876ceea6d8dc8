"""Reference loss: a new policy's joint targets become the joint angles of a task's reference."""

from dataclasses import dataclass
from typing import ClassVar

from tensordict import NestedKey, TensorDict, TensorDictBase
from tensordict.nn import TensorDictModuleBase, dispatch
from torch import Tensor
from torchrl.objectives.common import LossModule

from plat.entries import check_entries
from plat.errors import TaskError
from plat.objectives.imagination import starts_of
from plat.precision import autocast
from plat.tasks.disturbed import estimated, motor_target, shown
from plat.tasks.task import Task, remembered

__all__ = ["ReferenceLoss"]


class ReferenceLoss(LossModule):
    r"""Squared distance of a policy's joint targets from the joint angles of a task's reference (rad²).

    .. math::
        L = \| q^{target}(\pi(o_t)) - q^{ref}_{t+1} \|^2

    as a mean over joints. A policy that has learned it moves as the reference does, and does not balance. Learning by
    imagination begins with it: robots that move like that are in states that matter when they fall, unlike robots that
    only fall.

    Args:
        policy: writes ``action`` from what the task shows, or through a posterior from its privileged goals as well.
        task: observation, clock and reference (:meth:`plat.tasks.Task.reference`).

    The keys ``state`` and ``memory`` are those of :class:`plat.objectives.ImaginationLoss`. Returns
    ``loss_reference``.

    >>> from plat.modules import PlainPolicy
    >>> from plat.motions import MotionLibrary, generate_motions
    >>> from plat.tasks import TimedKeyframes, TimedKeyframesConfig
    >>> library = MotionLibrary.from_clips(generate_motions("train", seconds=8))
    >>> task = TimedKeyframes(library, TimedKeyframesConfig(chains=6))
    >>> loss = ReferenceLoss(PlainPolicy(library.robot).deployed(), task)
    >>> state, memory = task.start(4)
    >>> loss(TensorDict({"robot_state": state.pack(), "memory": memory}, [4]))["loss_reference"].shape
    torch.Size([])
    """

    @dataclass
    class _AcceptedKeys:
        state: NestedKey = "robot_state"
        memory: NestedKey = "memory"
        action: NestedKey = "action"

    tensor_keys: _AcceptedKeys
    default_keys = _AcceptedKeys
    out_keys: ClassVar[list[NestedKey]] = ["loss_reference"]

    def __init__(self, policy: TensorDictModuleBase, task: Task):
        super().__init__()
        self.policy = policy
        self.task = task
        self._privileged = any(key[0] == "privileged_goal" for key in policy.in_keys if isinstance(key, tuple))

    @property
    def in_keys(self) -> list[NestedKey]:
        """Return the keys of packed states and the task's memory."""
        return [self.tensor_keys.state, self.tensor_keys.memory]

    def _forward_value_estimator_keys(self, **_: object) -> None:
        pass

    @dispatch
    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Compute the loss of the control steps that begin in the states ``[B]``.

        Raises:
            TaskError: for a task without a reference, or with one of another shape, or without a memory.
            ObservationError: for an entry that is missing or of another shape, of the states or of the policy.
        """
        keys, task, joints = self.tensor_keys, self.task, self.task.robot.num_joints
        state, memory = starts_of(tensordict, keys.state, keys.memory, joints, "reference loss")
        with autocast(state.root_pos_w.device, "float32"):  # half precision is for networks
            observed = shown(task, state, memory)
            if self._privileged:
                observed["privileged_goal"] = task.privileged(estimated(state, memory), memory)
        acted = self.policy(observed)
        check_entries(acted, {keys.action: (joints,)}, "reference loss: policy")
        action = acted.get(keys.action)
        with autocast(state.root_pos_w.device, "float32"):
            target = motor_target(task.robot, memory, action)
            after = remembered(task, "advance", task.advance(memory.clone(), action.detach()), memory)
            wanted = task.reference(after)
        if not isinstance(wanted, Tensor) or wanted.shape != target.shape:
            found = tuple(wanted.shape) if isinstance(wanted, Tensor) else wanted
            raise TaskError(f"{type(task).__name__}.reference() returns {found}; expected {tuple(target.shape)}")
        return TensorDict({"loss_reference": (target - wanted).square().mean()})
