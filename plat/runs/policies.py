"""Registry of the policies that runs save: a kind is a class and the class of its config."""

import dataclasses
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol, runtime_checkable

import torch
from pydantic import TypeAdapter, ValidationError
from tensordict.nn import TensorDictModuleBase

from plat.errors import CheckpointError, ConfigError, RobotError
from plat.json_file import short
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

__all__ = ["Policy", "build_policy", "complete_spec", "policy_spec", "register_policy"]


@runtime_checkable
class Policy(Protocol):
    """Protocol of a saved policy."""

    robot: Robot
    config: Any

    def deployed(self) -> TensorDictModuleBase:
        """Return the deterministic policy: writes ``action``."""
        ...


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
            ``build(base, config)`` if it has one, else by ``policy_class(base, config)``. Its attribute ``timing`` is
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

    It holds the kind, the robot, the sizes, and the student of a policy that is built on one.

    Raises:
        CheckpointError: when the policy's class is not registered.
    """
    found = type(policy)
    name = next((name for name, kind in _KINDS.items() if kind.policy_class is found), None)
    if name is None:
        raise CheckpointError(
            f"a {found.__name__} is none of the policies that plat saves; plat.runs.register_policy adds one"
        )
    kind = _KINDS[name]
    config = TypeAdapter(kind.config_class).dump_python(policy.config, mode="json")
    spec = {"kind": name, "robot": policy.robot.name, "config": config}
    return {**spec, "student": policy_spec(policy.student)} if kind.base == "student" else spec


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
        CheckpointError: naming file and field, when it describes no policy.
    """
    if not isinstance(spec, dict) or not {"kind", "robot", "config"} <= set(spec):
        raise CheckpointError(f"{str(path)!r}: 'policy' is not an object with 'kind', 'robot' and 'config'")
    try:
        robot = get_robot(spec["robot"])
    except RobotError as error:
        raise CheckpointError(f"{str(path)!r}: the policy is for another robot: {error}") from None
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


def _config(config_class: Any, values: Any, path: Path) -> Any:
    known = {field.name for field in dataclasses.fields(config_class)}
    unknown = set(values) - known if isinstance(values, dict) else set()
    if unknown:
        raise CheckpointError(f"{str(path)!r}: unknown fields {short(sorted(unknown))} of {config_class.__name__}")
    try:
        return TypeAdapter(config_class).validate_python(values)
    except ValidationError as error:
        first = error.errors()[0]
        told = first["msg"].removeprefix("Value error, ")
        if first["loc"]:
            told = f"{config_class.__name__}.{'.'.join(map(str, first['loc']))}: {told}"
        raise CheckpointError(f"{str(path)!r}: {told}") from error
