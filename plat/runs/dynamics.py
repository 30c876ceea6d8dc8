"""Saved dynamics model: the learned model of the robot in a run directory, beside the policy."""

from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor

from plat.errors import CheckpointError, ConfigError
from plat.gpu import check_device
from plat.modules.dynamics import DynamicsConfig, DynamicsModel
from plat.robots.robot import Robot
from plat.runs.allocations import LimitedAllocations
from plat.runs.locate import CONFIG_FILE, read_config, run_folder
from plat.runs.saved_run import save_weights
from plat.runs.trained_for import check_trained_for
from plat.spec.timing import Timing

__all__ = ["DYNAMICS_FILE", "control_dt_of", "load_dynamics", "save_dynamics"]

DYNAMICS_FILE = "dynamics.safetensors"


def save_dynamics(folder: Path, model: DynamicsModel) -> None:
    """Write the weights of a model into a run's folder; its control step is that of the run's policy."""
    save_weights(folder / DYNAMICS_FILE, model)


def load_dynamics(
    folder: Path, robot: Robot, device: torch.device | str = "cpu", num_parameters: int = 0
) -> DynamicsModel:
    """Return the dynamics model that a run has learned, in the shape of its weights, at the run's control step.

    A model of a robot of another name may be gone on from, where it has as many joints.

    Args:
        folder: run directory of ``plat imagine``, ``plat expert-model`` or ``plat refine-model``, or the name of
            weights that come with plat.
        robot: the modeled robot.
        device: device of the model.
        num_parameters: of the robot's physics that it is to be told, see :meth:`plat.modules.DynamicsModel.take_over`.

    Raises:
        CheckpointError: naming file and field, when the run has no model, one of another number of joints, or one of a
            robot that had this name and was another one.
    """
    device = check_device(device)
    folder = run_folder(folder)
    path, told_in = folder / DYNAMICS_FILE, folder / CONFIG_FILE
    policy = read_config(folder).get("policy")
    dt = control_dt_of(policy, told_in)
    if not path.exists():
        raise CheckpointError(f"{str(path)!r}: no such file; expected a run of imagination (`plat imagine`)")
    check_trained_for(policy, robot, told_in)
    try:
        weights = load_file(path)
        if broken := [name for name, tensor in weights.items() if not torch.isfinite(tensor).all()]:
            raise ValueError(f"{broken[0]!r} holds NaN or infinity")
        config = DynamicsConfig(hidden=_hidden(weights))
        told = len(weights["mean"]) - len(DynamicsModel(robot, DynamicsConfig(hidden=(1,))).mean)
        with LimitedAllocations():
            trained = model = DynamicsModel(robot, config, dt, num_parameters=max(told, 0))
        trained.load_state_dict(weights)
        if told != num_parameters:
            model = DynamicsModel(robot, config, dt, num_parameters=num_parameters)
            model.take_over(trained)
    except (ArithmeticError, KeyError, OSError, RuntimeError, SafetensorError, TypeError, ValueError) as error:
        first = str(error).strip().partition("\n")[0]
        raise CheckpointError(f"{str(path)!r}: not a model of robot {robot.name!r} ({first})") from error
    return model.to(device)


def _hidden(weights: dict[str, Tensor]) -> tuple[int, ...]:
    """Return the sizes of the hidden layers of a model's weights: settings may be of another model."""
    layers = 0
    while f"network.{2 * layers}.weight" in weights:
        layers += 1
    return tuple(len(weights[f"network.{2 * layer}.weight"]) for layer in range(layers - 1))


def control_dt_of(policy: Any, path: Path) -> float:
    """Return the control step (s) of the policy that a run's ``config.json`` describes, at that path.

    Raises:
        CheckpointError: naming file and field, when there is no such control step.
    """
    timing: Any = {}
    while isinstance(policy, dict) and not timing:  # what is built on a student has the student's
        config, policy = policy.get("config"), policy.get("student")
        timing = config.get("timing", {}) if isinstance(config, dict) else {}
    try:
        return Timing(**timing).control_dt
    except (ArithmeticError, ConfigError, TypeError) as error:
        raise CheckpointError(f"{str(path)!r}: policy: {error}") from None
