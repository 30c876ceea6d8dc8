"""Prediction error of a learned dynamics model after 1 to K autoregressive steps."""

from dataclasses import dataclass
from pathlib import Path

import torch
from tensordict import TensorDictBase
from torch import Tensor

from plat.envs.state import GeneralizedState
from plat.files import replace_table
from plat.modules.dynamics import DynamicsModel
from plat.rotations import quat_angle
from plat.tasks.disturbed import told_to_model

__all__ = ["ModelErrors", "model_errors"]


@dataclass(frozen=True)
class ModelErrors:
    """Mean errors after 1 to K control steps, each ``[K]``, of the model and of a prediction of no change.

    Attributes:
        root_pos: distance of the root (m).
        root_rot: angle of the root (rad).
        joint_pos: mean over joints of the angle's error (rad).
        still_root_pos, still_root_rot, still_joint_pos: the same of the first state, for scale.
    """

    root_pos: Tensor
    root_rot: Tensor
    joint_pos: Tensor
    still_root_pos: Tensor
    still_root_rot: Tensor
    still_joint_pos: Tensor

    def write(self, path: Path) -> None:
        """Write a CSV file, one row a step."""
        steps = enumerate(zip(*vars(self).values(), strict=True), start=1)
        replace_table(path, ["step", *vars(self)], ([step, *map(float, values)] for step, values in steps))


@torch.no_grad()
def model_errors(model: DynamicsModel, windows: TensorDictBase) -> ModelErrors:
    """Compute the errors of a model over windows of simulated steps ``[B, K + 1]``.

    Args:
        model: the model; it continues from its own predictions.
        windows: ``robot_state`` and ``action``, as :meth:`plat.collectors.RolloutReplay.windows` gives them.

    >>> from tensordict import TensorDict
    >>> from plat.robots import G1
    >>> state = torch.nn.functional.pad(torch.ones(2, 5, 1), (3, 67))
    >>> windows = TensorDict({"robot_state": state, "action": torch.zeros(2, 5, 29)}, [2, 5])
    >>> model_errors(DynamicsModel(G1), windows).joint_pos.shape
    torch.Size([4])
    """
    targets, physics = told_to_model(model.robot, windows, windows["action"])
    states, parameters = windows["robot_state"], None if physics is None else physics[:, 0]
    first = state = GeneralizedState.unpack(states[:, 0])
    rows = []
    for step in range(1, states.shape[1]):
        state = model(state, targets[:, step - 1], parameters)
        actual = GeneralizedState.unpack(states[:, step])
        rows.append([*_errors(state, actual), *_errors(first, actual)])
    return ModelErrors(*(torch.stack(column) for column in zip(*rows, strict=True)))


def _errors(state: GeneralizedState, actual: GeneralizedState) -> tuple[Tensor, Tensor, Tensor]:
    return (
        (state.root_pos_w - actual.root_pos_w).norm(dim=-1).mean(),
        quat_angle(state.root_quat_w, actual.root_quat_w).mean(),
        (state.joint_pos - actual.joint_pos).abs().mean(),
    )
