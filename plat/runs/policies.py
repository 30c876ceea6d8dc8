"""Registry of the policies that runs save: a kind is a class and the class of its config."""

import dataclasses
import json
from enum import Enum
from pathlib import Path
from types import FunctionType, NoneType
from typing import Any, Literal, NamedTuple, Protocol, runtime_checkable

import torch
from pydantic import TypeAdapter, ValidationError
from tensordict.nn import TensorDictModuleBase
from torch import nn
from torch.nn.modules.lazy import LazyModuleMixin

from plat.errors import CheckpointError, ConfigError, RobotError
from plat.json_file import short
from plat.modules.deployed import timed
from plat.modules.policies import (
    Expert,
    ExpertConfig,
    FinetunedPolicy,
    LatentNoisePolicy,
    LatentPolicy,
    LatentPolicyConfig,
    PlainPolicy,
    PlainPolicyConfig,
    Refinement,
    RefinementConfig,
    ResidualActionPolicy,
    ResidualLatentPolicy,
)
from plat.robots import Robot, get_robot
from plat.runs.allocations import LimitedAllocations
from plat.runs.inputs import same_robot
from plat.runs.trained_for import TRAINED_FOR, check_trained_for, trained_for
from plat.spec.timing import timing_of
from plat.words import perhaps

__all__ = [
    "Policy",
    "build_policy",
    "check_rebuilt",
    "complete_spec",
    "deployed",
    "policy_spec",
    "register_policy",
]


@runtime_checkable
class Policy(Protocol):
    """Protocol of a saved policy."""

    robot: Robot
    config: Any

    def deployed(self) -> TensorDictModuleBase:
        """Return the deterministic policy: writes ``action``."""
        ...


def deployed(policy: Policy, *goals: Any) -> TensorDictModuleBase:
    """Return what a policy's ``deployed(*goals)`` returns, with the policy's timing where that has none.

    Raises:
        ConfigError: for what has none, such as the module that it returned.
    """
    if not callable(getattr(policy, "deployed", None)):
        raise ConfigError(f"policy is a {type(policy).__name__}, expected one as plat.load and load_policy return it")
    module, timing = policy.deployed(*goals), timing_of(policy)
    return module if timing is None or timing_of(module) is not None else timed(module, timing)


class _Kind(NamedTuple):
    policy_class: type
    config_class: type
    base: Literal["robot", "student"]
    """argument that the policy is constructed from, see :func:`register_policy`"""


# Names of saved policies in config.json.
_KINDS: dict[str, _Kind] = {
    "expert": _Kind(Expert, ExpertConfig, "robot"),
    "latent": _Kind(LatentPolicy, LatentPolicyConfig, "robot"),
    "plain": _Kind(PlainPolicy, PlainPolicyConfig, "robot"),
    "residual_latent": _Kind(ResidualLatentPolicy, RefinementConfig, "student"),
    "residual_latent_noise": _Kind(LatentNoisePolicy, RefinementConfig, "student"),
    "residual_action": _Kind(ResidualActionPolicy, RefinementConfig, "student"),
    "finetuned": _Kind(FinetunedPolicy, RefinementConfig, "student"),
}


def register_policy(
    kind: str, policy_class: type, config_class: type, *, base: Literal["robot", "student"] | None = None
) -> None:
    """Register a policy class, so that runs save and load it; call it where the class is defined.

    Args:
        kind: its name in ``config.json``.
        policy_class: a module with the attributes ``robot`` and ``config`` and a ``deployed()``. It is made by its
            ``build(base, config)`` if it has one, else by ``policy_class(base, config)``; a run begins only where
            that has the same parts as the policy. Its attribute ``timing`` is
            the timing that it is trained with; without one it is the default :class:`plat.spec.timing.Timing`.
        config_class: a dataclass.
        base: what the policy is built on: the robot, or a student that it keeps as its attribute ``student`` and that
            is saved with it. By default the student for a :class:`plat.modules.Refinement`, the robot for others.

    Raises:
        ConfigError: when another class has that name.

    >>> from plat.robots import G1
    >>> class Deeper(LatentPolicy):
    ...     def __init__(self, robot, config=None):
    ...         super().__init__(robot, config or LatentPolicyConfig(backbone=(512, 512)))
    >>> register_policy("deeper", Deeper, LatentPolicyConfig)
    >>> policy_spec(Deeper(G1))["kind"]
    'deeper'
    """
    base = base or ("student" if issubclass(policy_class, Refinement) else "robot")
    known = _KINDS.setdefault(kind, _Kind(policy_class, config_class, base)).policy_class
    if known is not policy_class:
        raise ConfigError(
            f"kind {kind!r} is a {known.__name__} already, choose another name for {policy_class.__name__}"
        )


def policy_spec(policy: Any) -> dict[str, Any]:
    """Return the description from which :func:`build_policy` makes an equal object.

    It holds the kind, the robot, the sizes, and the student that a refined policy is built on. It also holds the
    robot's properties that the policy depends on (:func:`plat.runs.trained_for.trained_for`).

    Raises:
        CheckpointError: when the policy's class is not registered.
    """
    return {**_spec(policy), TRAINED_FOR: trained_for(policy.robot)}


def _spec(policy: Any) -> dict[str, Any]:
    found = type(policy)
    name = next((name for name, kind in _KINDS.items() if kind.policy_class is found), None)
    if name is None:
        raise CheckpointError(
            f"a {found.__name__} is none of the policies that plat saves; plat.runs.register_policy adds one"
        )
    kind = _KINDS[name]
    config = TypeAdapter(kind.config_class).dump_python(policy.config, mode="json")
    spec = {"kind": name, "robot": policy.robot.name, "config": config}
    return {**spec, "student": _spec(policy.student)} if kind.base == "student" else spec


def complete_spec(spec: Any, path: Path) -> dict[str, Any]:
    """Return a description with every field: fields unknown to an older plat get their defaults.

    Raises:
        CheckpointError: naming ``path``, its file, when it describes no policy.
    """
    with torch.random.fork_rng(devices=[]):  # the random weights are discarded
        return policy_spec(build_policy(spec, path))


def build_policy(spec: Any, path: Path) -> Policy:
    """Return the policy of a description, with weights drawn at random.

    Args:
        spec: what :func:`policy_spec` returned.
        path: its file, for messages.

    Raises:
        CheckpointError: naming file and field, when it describes no policy, or one for a robot that had this name and
            was another one.
    """
    if not isinstance(spec, dict) or not {"kind", "robot", "config"} <= set(spec):
        raise CheckpointError(f"{str(path)!r}: 'policy' is not an object with 'kind', 'robot' and 'config'")
    known = ("kind", "robot", "config", "student", TRAINED_FOR)
    try:
        _check_known(spec, dict.fromkeys(known), "policy")
    except CheckpointError as error:
        raise CheckpointError(f"{str(path)!r}: {error}") from None
    try:
        robot = get_robot(spec["robot"])
    except RobotError as error:
        raise CheckpointError(f"{str(path)!r}: the policy is for another robot: {error}") from None
    check_trained_for(spec, robot, path)
    if not isinstance(spec["kind"], str) or spec["kind"] not in _KINDS:
        raise CheckpointError(
            f"{str(path)!r}: unknown kind of policy {short(spec['kind'])}, expected one of {sorted(_KINDS)} "
            "or one given to plat.runs.register_policy (--import MODULE imports the module that does so)"
        )
    kind = _KINDS[spec["kind"]]
    base = build_policy(spec.get("student"), path) if kind.base == "student" else robot
    config = _config(kind.config_class, spec["config"], path)
    where = f"{str(path)!r}: {kind.config_class.__name__}"
    try:
        with LimitedAllocations():
            return getattr(kind.policy_class, "build", kind.policy_class)(base, config)
    except ConfigError as error:
        raise CheckpointError(f"{where}: {error}") from None
    except (ArithmeticError, IndexError, MemoryError, RuntimeError, TypeError, ValueError) as error:
        told = str(error).strip().partition("\n")[0]
        raise CheckpointError(f"{where}: no policy can be built of it ({type(error).__name__}: {told})") from error


def check_rebuilt(policy: Any, spec: dict[str, Any], path: Path) -> None:
    """Check that :func:`build_policy` makes a policy of the same parts, so that its weights load as what was trained.

    It draws weights, which are discarded.

    Args:
        policy: the policy.
        spec: its description.
        path: the file that is to hold it, for messages.

    Raises:
        CheckpointError: naming the first part that differs.
    """
    built = build_policy(spec, path)
    assert isinstance(built, nn.Module)
    robot = policy.robot
    if not same_robot(robot, get_robot(robot.name)):
        raise CheckpointError(f"robot {robot.name!r} of the policy is not the one of that name: give it another name")
    part = _first_own(policy, built)
    if part is None:
        try:
            built.load_state_dict(policy.state_dict())
        except RuntimeError as error:
            part = str(error).strip().rpartition("\n")[2].strip()
    if part is not None:
        name = type(policy).__name__
        raise CheckpointError(
            f"a {name} with parts of its own ({part}) would load as another policy or not at all: make it a subclass "
            "whose constructor or build(base, config) makes them, and give that to plat.runs.register_policy"
        )


def _first_own(policy: nn.Module, built: nn.Module) -> str | None:
    """Return the name of the first part or setting that a policy does not share with the one that was built."""
    ours, theirs = dict(policy.named_modules()), dict(built.named_modules())
    for name in ours | theirs:
        if name not in ours or name not in theirs or _kind_of(ours[name]) != _kind_of(theirs[name]):
            return name
        if isinstance(theirs[name], LazyModuleMixin):
            continue  # it has its sizes from its first input
        own, made = _settings(ours[name]), _settings(theirs[name])
        for setting in own | made:
            if setting not in own or setting not in made or own[setting] != made[setting]:
                return f"{name}.{setting}".lstrip("._")
    return None


# Attributes of every module, what torch.compile leaves, what the description holds, and what entries are checked by.
_NO_SETTINGS = {*vars(nn.Module()), "_compiled_call_impl", "config", "widths"}


def _settings(module: nn.Module) -> dict[str, Any]:
    """Return what a module computes by beside weights and parts; nothing of a user's, which may keep more there."""
    if type(module).__module__.partition(".")[0] not in ("plat", "tensordict", "torch", "torchrl"):
        return {}
    return {name: _comparable(value) for name, value in vars(module).items() if name not in _NO_SETTINGS}


def _comparable(value: Any) -> Any:
    if isinstance(value, (list, tuple)):
        return [_comparable(item) for item in value]
    if isinstance(value, FunctionType):
        return value.__code__
    if isinstance(value, (bool, int, float, str, Enum, NoneType)):
        return value
    return _name_of(value if isinstance(value, type) else type(value))


def _kind_of(module: nn.Module) -> str:
    # a lazy layer becomes an ordinary one
    return _name_of(getattr(module, "cls_to_become", None) or type(module))


def _name_of(found: type) -> str:
    """Return the full name of a class; some are made anew for each object."""
    return f"{found.__module__}.{found.__qualname__}"


def _config(config_class: Any, values: Any, path: Path) -> Any:
    adapter, name = TypeAdapter(config_class), config_class.__name__
    known = dict.fromkeys(field.name for field in dataclasses.fields(config_class))
    try:
        _check_known(values, known, name)  # first: what is misspelled may be what is missing
        # as JSON, where a list is a tuple; strict, or a text that looks like a number would be one
        config = adapter.validate_json(json.dumps(values), strict=True)
        _check_known(values, adapter.dump_python(config, mode="json"), name)
    except CheckpointError as error:
        raise CheckpointError(f"{str(path)!r}: {error}") from None
    except ValidationError as error:
        first = error.errors()[0]
        told, where = first["msg"], ".".join(map(str, (name, *first["loc"])))
        if told.startswith("Input should be "):
            told = f"{where} is {short(first['input'])}, expected {told.removeprefix('Input should be ')}"
        elif first["loc"]:
            told = f"{where}: {told.removeprefix('Value error, ')}"
        else:
            told = told.removeprefix("Value error, ")
        raise CheckpointError(f"{str(path)!r}: {told}") from error
    return config


def _check_known(values: Any, known: Any, where: str) -> None:
    """Raise an error that names the first field, at any depth, that a config does not have.

    Args:
        values: what a file holds.
        known: the config as it would be written, or a mapping with its fields alone.
        where: name of the config; begins the message.

    Raises:
        CheckpointError: with the nearest name that there is.
    """
    if isinstance(values, list) and isinstance(known, list):
        for index, pair in enumerate(zip(values, known, strict=False)):
            _check_known(*pair, f"{where}.{index}")
    if isinstance(values, dict) and isinstance(known, dict):
        for name, value in values.items():
            if name not in known:
                near = perhaps(name, known) or f", expected {', '.join(known) or 'none'}"
                raise CheckpointError(f"{where}: unknown field {short(name)}{near}")
            _check_known(value, known[name], f"{where}.{name}")
