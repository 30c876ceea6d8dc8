"""Policies on disk: ``config.json`` rebuilds the object, ``model.safetensors`` fills in its weights."""

import dataclasses
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

from plat.envs.robot import G1, Robot
from plat.errors import CheckpointError
from plat.files import replace_file
from plat.modules.expert import Expert, ExpertConfig
from plat.modules.imitation import LatentPolicy, LatentPolicyConfig, PlainPolicy, PlainPolicyConfig
from plat.modules.refinement import (
    FinetunedPolicy,
    LatentNoisePolicy,
    RefinementConfig,
    ResidualActionPolicy,
    ResidualLatentPolicy,
)

__all__ = ["Policy", "complete_spec", "load_policy", "policy_spec", "read_json", "save_weights", "write_json"]

ROBOTS = {G1.name: G1}

# How a saved policy is called in config.json. Only loading looks here.
_PLAIN_KINDS: dict[str, tuple[type, type]] = {
    "expert": (Expert, ExpertConfig),
    "latent": (LatentPolicy, LatentPolicyConfig),
    "plain": (PlainPolicy, PlainPolicyConfig),
}
_REFINED_KINDS: dict[str, type] = {
    "residual_latent": ResidualLatentPolicy,
    "residual_latent_noise": LatentNoisePolicy,
    "residual_action": ResidualActionPolicy,
    "finetuned": FinetunedPolicy,
}


class Policy(Protocol):
    """What every saved policy can do."""

    robot: Robot

    def deployed(self) -> TensorDictModuleBase:
        """The deterministic policy: writes ``action``."""
        ...


def policy_spec(policy: Any) -> dict[str, Any]:
    """Description from which :func:`load_policy` builds the same object: kind, sizes, robot, and its student."""
    found = type(policy)
    for kind, (policy_class, config_class) in _PLAIN_KINDS.items():
        if found is policy_class:
            config = TypeAdapter(config_class).dump_python(policy.config, mode="json")
            return {"kind": kind, "robot": policy.robot.name, "config": config}
    for kind, policy_class in _REFINED_KINDS.items():
        if found is policy_class:
            config = TypeAdapter(RefinementConfig).dump_python(policy.config, mode="json")
            student = policy_spec(policy.student)
            return {"kind": kind, "robot": policy.robot.name, "config": config, "student": student}
    raise CheckpointError(f"a {found.__name__} is none of the policies that plat saves")


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
    try:
        content = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise CheckpointError(f"{str(path)!r}: not a readable JSON file ({error})") from error
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
    if spec["robot"] not in ROBOTS:
        raise CheckpointError(
            f"{str(path)!r}: the policy is for robot {spec['robot']!r}, expected one of {sorted(ROBOTS)}"
        )
    if kind in _PLAIN_KINDS:
        policy_class, config_class = _PLAIN_KINDS[kind]
        return policy_class(ROBOTS[spec["robot"]], _config(config_class, spec["config"], path))
    if kind in _REFINED_KINDS:
        return _REFINED_KINDS[kind](_build(spec.get("student"), path), _config(RefinementConfig, spec["config"], path))
    raise CheckpointError(
        f"{str(path)!r}: unknown kind of policy {kind!r}, expected one of {sorted({**_PLAIN_KINDS, **_REFINED_KINDS})}"
    )


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
