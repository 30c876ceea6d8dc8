"""Policies on disk: ``config.json`` rebuilds the object, ``model.safetensors`` fills in its weights."""

import dataclasses
import inspect
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol

import torch
from pydantic import TypeAdapter, ValidationError
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from tensordict.nn import TensorDictModuleBase
from torch import nn

from plat import json_file
from plat.errors import CheckpointError, RobotError
from plat.files import replace_file
from plat.modules.policies.expert import Expert, ExpertConfig
from plat.modules.policies.refinement import (
    FinetunedPolicy,
    LatentNoisePolicy,
    RefinementConfig,
    ResidualActionPolicy,
    ResidualLatentPolicy,
)
from plat.modules.policies.student import LatentPolicy, LatentPolicyConfig, PlainPolicy, PlainPolicyConfig
from plat.robots import Robot, get_robot

__all__ = [
    "Policy",
    "complete_spec",
    "load_policy",
    "policy_spec",
    "read_json",
    "register_policy",
    "save_weights",
    "write_json",
]

# How a saved policy is called in config.json, its class and that of its config. Only saving and loading look here.
_KINDS: dict[str, tuple[type, type]] = {
    "expert": (Expert, ExpertConfig),
    "latent": (LatentPolicy, LatentPolicyConfig),
    "plain": (PlainPolicy, PlainPolicyConfig),
    "residual_latent": (ResidualLatentPolicy, RefinementConfig),
    "residual_latent_noise": (LatentNoisePolicy, RefinementConfig),
    "residual_action": (ResidualActionPolicy, RefinementConfig),
    "finetuned": (FinetunedPolicy, RefinementConfig),
}


class Policy(Protocol):
    """What every saved policy can do."""

    robot: Robot

    def deployed(self) -> TensorDictModuleBase:
        """The deterministic policy: writes ``action``."""
        ...


def register_policy(kind: str, policy_class: type, config_class: type) -> None:
    """Let runs save and load policies of a class of your own; call it where the class is defined.

    Args:
        kind: its name in ``config.json``.
        policy_class: a module that is built as ``policy_class(robot, config)``, or as ``policy_class(student, config)``
            if it takes a ``student``; it keeps them as attributes, and has a ``deployed()``.
        config_class: a dataclass.

    Raises:
        ValueError: when another class goes by that name.

    >>> from plat.robots import G1
    >>> class Deeper(LatentPolicy):
    ...     def __init__(self, robot, config=None):
    ...         super().__init__(robot, config or LatentPolicyConfig(backbone=(512, 512)))
    >>> register_policy("deeper", Deeper, LatentPolicyConfig)
    >>> policy_spec(Deeper(G1))["kind"]
    'deeper'
    """
    known, _ = _KINDS.setdefault(kind, (policy_class, config_class))
    if known is not policy_class:
        raise ValueError(
            f"kind {kind!r} is a {known.__name__} already, choose another name for {policy_class.__name__}"
        )


def policy_spec(policy: Any) -> dict[str, Any]:
    """Description from which :func:`load_policy` builds the same object: kind, sizes, robot, and its student."""
    found = type(policy)
    kind = next((kind for kind, (policy_class, _) in _KINDS.items() if policy_class is found), None)
    if kind is None:
        raise CheckpointError(
            f"a {found.__name__} is none of the policies that plat saves; plat.runs.register_policy adds one"
        )
    _, config_class = _KINDS[kind]
    config = TypeAdapter(config_class).dump_python(policy.config, mode="json")
    spec = {"kind": kind, "robot": policy.robot.name, "config": config}
    return {**spec, "student": policy_spec(policy.student)} if _takes_student(found) else spec


def _takes_student(policy_class: type) -> bool:
    return "student" in inspect.signature(policy_class).parameters


def complete_spec(spec: Any, path: Path) -> dict[str, Any]:
    """A description with every field: those that an older plat did not know yet have their defaults.

    Raises:
        CheckpointError: naming ``path``, the file that it is from, when it describes no policy.
    """
    with torch.random.fork_rng(devices=[]):  # the weights that are drawn here are of no use
        return policy_spec(_build(spec, path))


def load_policy(run: str | Path, device: torch.device | str = "cpu") -> Any:
    """The policy of a run directory, in evaluation mode.

    Raises:
        CheckpointError: naming file and field, when something is missing, broken or of another robot.
    """
    run = Path(run)
    spec = read_json(run / "config.json").get("policy", {})
    policy = _build(spec, run / "config.json")
    path = run / "model.safetensors"
    if not path.exists():
        raise CheckpointError(f"{str(path)!r}: no such file; has the run saved a checkpoint yet?")
    try:
        weights = load_file(path)
    except (OSError, SafetensorError) as error:
        raise CheckpointError(f"{str(path)!r}: not a readable safetensors file ({error})") from error
    expected = policy.state_dict()
    missing, unknown = sorted(set(expected) - set(weights)), sorted(set(weights) - set(expected))
    if missing or unknown:
        raise CheckpointError(
            f"{str(path)!r}: lacks {missing[:3]} and has the unknown {unknown[:3]} "
            f"({len(missing)} missing, {len(unknown)} unknown), expected the weights of a {spec['kind']!r} policy"
        )
    for name, tensor in expected.items():
        if weights[name].shape != tensor.shape:
            raise CheckpointError(
                f"{str(path)!r}: {name!r} has shape {tuple(weights[name].shape)}, "
                f"expected {tuple(tensor.shape)} by the sizes in config.json"
            )
        if not torch.isfinite(weights[name]).all():
            raise CheckpointError(
                f"{str(path)!r}: {name!r} holds NaN or infinity: the run diverged, take an earlier one"
            )
    policy.load_state_dict(weights)
    return policy.to(device).eval()


def save_weights(path: Path, module: nn.Module) -> None:
    """Write a module's weights; the file at ``path`` is replaced in one step or not at all.

    Raises:
        CheckpointError: when the disk does not take them; what was there before is intact.
    """
    weights = {name: tensor.detach().cpu().contiguous() for name, tensor in module.state_dict().items()}
    _replace(path, lambda part: save_file(weights, part))


def read_json(path: Path) -> dict[str, Any]:
    """A JSON object from a file."""
    if not path.exists():
        raise CheckpointError(f"{str(path)!r}: no such file, expected a run directory with config.json")
    content = json_file.read_json(path, CheckpointError, repr(str(path)))
    if not isinstance(content, dict):
        raise CheckpointError(f"{str(path)!r}: holds a {type(content).__name__}, expected an object")
    return content


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a JSON object; the file is replaced in one step or not at all."""
    text = json.dumps(content, indent=2) + "\n"
    _replace(path, lambda part: part.write_text(text))


def _replace(path: Path, write: Callable[[Path], object]) -> None:
    try:
        replace_file(path, write)
    except (OSError, SafetensorError) as error:
        raise CheckpointError(f"{str(path)!r} could not be written ({error}); the file before it is intact") from error


def _build(spec: Any, path: Path) -> Any:
    if not isinstance(spec, dict) or not {"kind", "robot", "config"} <= set(spec):
        raise CheckpointError(f"{str(path)!r}: 'policy' is not an object with 'kind', 'robot' and 'config'")
    kind = spec["kind"]
    try:
        robot = get_robot(spec["robot"])
    except RobotError as error:
        raise CheckpointError(f"{str(path)!r}: the policy is for another robot: {error}") from None
    if kind not in _KINDS:
        raise CheckpointError(
            f"{str(path)!r}: unknown kind of policy {kind!r}, expected one of {sorted(_KINDS)} "
            "or one that plat.runs.register_policy has been told of"
        )
    policy_class, config_class = _KINDS[kind]
    base = _build(spec.get("student"), path) if _takes_student(policy_class) else robot
    return policy_class(base, _config(config_class, spec["config"], path))


def _config(config_class: Any, values: Any, path: Path) -> Any:
    known = {field.name for field in dataclasses.fields(config_class)}
    unknown = set(values) - known if isinstance(values, dict) else set()
    if unknown:
        raise CheckpointError(f"{str(path)!r}: unknown fields {sorted(unknown)} of {config_class.__name__}")
    try:
        return TypeAdapter(config_class).validate_python(values)
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(str(part) for part in first["loc"])
        raise CheckpointError(f"{str(path)!r}: {config_class.__name__}.{field}: {first['msg']}") from error
