"""Saved dynamics model: the learned model of the robot in a run directory, beside the policy."""

from pathlib import Path
from typing import Any

import torch
from pydantic import TypeAdapter
from safetensors import SafetensorError
from safetensors.torch import load_file

from plat.errors import CheckpointError
from plat.modules.dynamics import DynamicsConfig, DynamicsModel
from plat.robots.robot import Robot
from plat.runs.allocations import LimitedAllocations
from plat.runs.json_object import read_json
from plat.runs.locate import CONFIG_FILE, run_folder
from plat.runs.saved_run import save_weights

__all__ = ["DYNAMICS_FILE", "load_dynamics", "save_dynamics"]

DYNAMICS_FILE = "dynamics.safetensors"


def save_dynamics(folder: Path, model: DynamicsModel) -> None:
    """Write the weights of a model into a run's folder; its settings are saved with the recipe's."""
    save_weights(folder / DYNAMICS_FILE, model)


def load_dynamics(
    folder: Path, robot: Robot, device: torch.device | str = "cpu", num_parameters: int = 0
) -> DynamicsModel:
    """Return the dynamics model that a run has learned.

    Args:
        folder: run directory of ``plat expert-model`` or ``plat imagine``, or the name of weights that come with plat.
        robot: the modeled robot.
        device: device of the model.
        num_parameters: of the robot's physics that it is to be told, see :meth:`plat.modules.DynamicsModel.take_over`.

    Raises:
        CheckpointError: naming file and field, when the run has no model, or one of another robot.
    """
    folder = run_folder(folder)
    path, settings = folder / DYNAMICS_FILE, read_json(folder / CONFIG_FILE)
    if not path.exists():
        raise CheckpointError(f"{str(path)!r}: no such file; expected the run of `plat expert-model` or `plat imagine`")
    shape: Any = settings
    for name in ("recipe", "settings", "model"):
        shape = shape.get(name, {}) if isinstance(shape, dict) else {}
    try:
        weights, config = load_file(path), TypeAdapter(DynamicsConfig).validate_python(shape)
        told = len(weights["mean"]) - len(DynamicsModel(robot, DynamicsConfig(hidden=(1,))).mean)
        with LimitedAllocations():
            trained = model = DynamicsModel(robot, config, num_parameters=max(told, 0))
        trained.load_state_dict(weights)
        if told != num_parameters:
            model = DynamicsModel(robot, config, num_parameters=num_parameters)
            model.take_over(trained)
    except (ArithmeticError, KeyError, OSError, RuntimeError, SafetensorError, TypeError, ValueError) as error:
        first = str(error).strip().partition("\n")[0]
        raise CheckpointError(f"{str(path)!r}: not a model of robot {robot.name!r} ({first})") from error
    return model.to(device)
