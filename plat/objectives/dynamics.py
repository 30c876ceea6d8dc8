"""Loss of the learned dynamics model."""

from dataclasses import dataclass
from typing import Any, ClassVar

from tensordict import NestedKey, TensorDict, TensorDictBase
from tensordict.nn import dispatch
from torch import Tensor, nn
from torchrl.objectives.common import LossModule

from plat.bounds import NonNegative, check_value
from plat.entries import check_entries
from plat.envs.state import GeneralizedState
from plat.errors import ObservationError
from plat.modules.dynamics import DynamicsModel
from plat.tasks.distances import smooth_angle
from plat.tasks.disturbed import told_to_model

__all__ = ["DynamicsLoss"]


class DynamicsLoss(LossModule):
    r"""Autoregressive loss of a :class:`plat.modules.DynamicsModel` over a window of simulated steps.

    From the first state of the window the model continues from its own predictions:

    .. math::
        L = \frac{1}{K} \sum_{k=1}^{K} \sum_i w_i \, |\hat{s}^i_k - s^i_k| / \sigma_i

    over the parts :math:`i` of the state, each divided by the spread :math:`\sigma_i` of its own one-step change, so
    that no unit counts more than another. That of a position is the spread of its velocity times the control step.

    Args:
        model: the model.

    Keyword Args:
        position_weight: weight of root position, root orientation and joint angles; velocities have 1.

    The keys ``state`` and ``action`` say where a window's steps are. ``memory`` is that of the task: of randomized
    robots it says by how much their targets were late and off, and what the model is told of their physics.

    Returns ``loss_dynamics``, and for the log the errors at the window's end: ``root_pos_error`` (m),
    ``root_rot_error`` (rad) and ``joint_pos_error`` (rad).

    Source: SuperTrack (Fussell et al. 2021), section 4.

    >>> import torch
    >>> from plat.robots import G1
    >>> state = torch.nn.functional.pad(torch.ones(2, 5, 1), (3, 67))  # two windows of four steps
    >>> windows = TensorDict({"robot_state": state, "action": torch.zeros(2, 5, 29)}, [2, 5])
    >>> sorted(DynamicsLoss(DynamicsModel(G1))(windows).keys())
    ['joint_pos_error', 'loss_dynamics', 'root_pos_error', 'root_rot_error']
    """

    @dataclass
    class _AcceptedKeys:
        state: NestedKey = "robot_state"
        action: NestedKey = "action"
        memory: NestedKey = "memory"

    tensor_keys: _AcceptedKeys
    default_keys = _AcceptedKeys
    out_keys: ClassVar[list[NestedKey]] = ["loss_dynamics", "root_pos_error", "root_rot_error", "joint_pos_error"]

    def __init__(self, model: DynamicsModel, *, position_weight: float = 0.3):
        super().__init__()
        check_value("dynamics loss: position_weight", position_weight, NonNegative)
        self.model = model
        self.position_weight = position_weight
        self.register_forward_pre_hook(_with_memory)

    @property
    def in_keys(self) -> list[NestedKey]:
        """Return the keys of packed states and actions, and of the memory that windows of randomized robots have."""
        return [self.tensor_keys.state, self.tensor_keys.action, self.tensor_keys.memory]

    def _forward_value_estimator_keys(self, **_: object) -> None:
        pass

    @dispatch
    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Compute the loss of windows ``[B, K + 1]``; the action of a window's last state is not used.

        Raises:
            ObservationError: for an entry that is missing or of another shape, and windows of a single state.
        """
        keys, joints = self.tensor_keys, self.model.robot.num_joints
        windows = {keys.state: ("K + 1", 13 + 2 * joints), keys.action: ("K + 1", joints)}
        check_entries(tensordict, windows, "dynamics loss")
        shape = tensordict.get(keys.state).shape
        if len(shape) != 3 or shape[1] < 2:
            raise ObservationError(f"dynamics loss: windows {tuple(shape[:-1])}, expected [B, K + 1] with K at least 1")
        # time first: the states of a step are then contiguous
        states = tensordict.get(keys.state).transpose(0, 1).contiguous()
        targets, physics = told_to_model(self.model.robot, tensordict, tensordict.get(keys.action), keys.memory)
        targets = targets.transpose(0, 1).contiguous()
        parameters = None if physics is None else physics[:, 0]
        lin, ang, joint = (part.mean() for part in self.model.spread[: 6 + joints].split((3, 3, joints)))
        position = self.position_weight / self.model.dt
        state = GeneralizedState.unpack(states[0])
        total = states.new_zeros(())
        for target, values in zip(targets[:-1], states[1:], strict=True):
            state, actual = self.model(state, target, parameters), GeneralizedState.unpack(values)
            root_pos = _mean_distance(state.root_pos_w, actual.root_pos_w)
            root_rot = smooth_angle(state.root_quat_w, actual.root_quat_w).mean()
            joint_pos = _mean_distance(state.joint_pos, actual.joint_pos)
            total = total + (
                _mean_distance(state.root_lin_vel_w, actual.root_lin_vel_w) / lin
                + _mean_distance(state.root_ang_vel_b, actual.root_ang_vel_b) / ang
                + _mean_distance(state.joint_vel, actual.joint_vel) / joint
                + position * (root_pos / lin + root_rot / ang + joint_pos / joint)
            )
        return TensorDict(
            {
                "loss_dynamics": total / (len(states) - 1),
                "root_pos_error": root_pos.detach(),
                "root_rot_error": root_rot.detach(),
                "joint_pos_error": joint_pos.detach(),
            }
        )


def _with_memory(loss: nn.Module, args: tuple[Any, ...]) -> tuple[Any, ...] | None:
    """Give windows of nominal robots an empty memory: ``select_out_keys`` takes what lacks an input for no batch."""
    assert isinstance(loss, DynamicsLoss)
    windows, key = args[0] if args else None, loss.tensor_keys.memory
    if not isinstance(windows, TensorDictBase) or windows.get(key, None) is not None:
        return None
    return (windows.copy().set(key, TensorDict({}, windows.batch_size)), *args[1:])


def _mean_distance(predicted: Tensor, actual: Tensor) -> Tensor:
    return (predicted - actual).abs().mean()
