"""Checks of TensorDict entries: an entry that is missing or of the wrong shape is named, before torch meets it.

Only metadata is looked at, never values: a check costs microseconds.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any, TypeVar

import torch
from tensordict import NestedKey, TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor, nn

from plat.errors import ConfigError, ObservationError

__all__ = ["Shape", "check_entries", "check_policy", "check_rollout", "expects"]

M = TypeVar("M", bound=nn.Module)
Shape = Sequence[int | str]
"""Trailing dimensions of an entry. A letter is a dimension of any size, ``"3 K"`` one of any multiple of 3."""


def check_entries(
    tensordict: TensorDictBase, shapes: Mapping[NestedKey, Shape], what: str, *, double: bool = True
) -> None:
    """Raise an error for the first entry that is missing, holds no floating-point numbers or has a wrong shape.

    Args:
        tensordict: the entries.
        shapes: trailing dimensions of each, such as ``(29,)`` or ``("L", 64)``; what stands before them has to be
            the same for all.
        what: reads the entries; begins the message.
        double: whether float64 will do.

    Raises:
        ObservationError: naming the entry and the shape that would be right.

    >>> from tensordict import TensorDict
    >>> check_entries(TensorDict({"action": torch.zeros(4, 28)}, [4]), {"action": (29,)}, "step")
    Traceback (most recent call last):
    ...
    plat.errors.ObservationError: step: entry 'action' has shape (4, 28), expected [*B, 29]
    """
    if not isinstance(tensordict, TensorDictBase):
        raise ObservationError(f"{what}: got a {type(tensordict).__name__}, expected a TensorDict")
    batch: tuple[NestedKey, torch.Size] | None = None
    for key, shape in shapes.items():
        value = tensordict.get(key, None)
        if not isinstance(value, Tensor):
            raise ObservationError(f"{what}: no entry {key!r}, expected one of shape {_text(shape)}")
        here, size = value.shape, len(shape)
        if len(here) < size or any(
            not _fits(expected, found) for expected, found in zip(shape, here[-size:], strict=True)
        ):
            raise ObservationError(f"{what}: entry {key!r} has shape {tuple(here)}, expected {_text(shape)}")
        if not value.is_floating_point() or (value.dtype == torch.float64 and not double):
            raise ObservationError(f"{what}: entry {key!r} is {_dtype(value)}, expected float32")
        first = here[: len(here) - size]
        if batch is None:
            batch = key, first
        elif batch[1] != first:
            raise ObservationError(
                f"{what}: entry {key!r} has batch {tuple(first)}, expected {tuple(batch[1])} as of {batch[0]!r}"
            )


def check_rollout(rollout: TensorDictBase, what: str, keys: Iterable[NestedKey]) -> None:
    """Raise an error for a rollout that is not ``[N, T]`` or lacks an entry or a group.

    Args:
        rollout: of N robots over T steps.
        what: reads it; begins the message.
        keys: entries and groups.

    Raises:
        ObservationError: naming what is wrong.
    """
    if not isinstance(rollout, TensorDictBase) or len(rollout.batch_size) != 2:
        found = tuple(rollout.batch_size) if isinstance(rollout, TensorDictBase) else type(rollout).__name__
        raise ObservationError(f"{what}: rollout has batch {found}, expected [N, T]: robots and control steps")
    for key in keys:
        if rollout.get(key, None) is None:
            raise ObservationError(f"{what}: no entry {key!r} in the rollout")


def check_policy(policy: object, what: str) -> None:
    """Raise an error for a policy that cannot act: it cannot be called, or writes no ``action``.

    Args:
        policy: a TensorDict module, or a function from a TensorDict to one.
        what: is given it; begins the message.

    Raises:
        ConfigError: saying what would be right.

    >>> check_policy(nn.ParameterList(), "rollouts")
    Traceback (most recent call last):
    ...
    plat.errors.ConfigError: rollouts: policy is a ParameterList, expected a module of a TensorDict that writes 'action'
    """
    expected = "expected a module of a TensorDict that writes 'action'"
    if isinstance(policy, TensorDictModuleBase):
        if "action" not in policy.out_keys:
            raise ConfigError(f"{what}: policy writes {', '.join(map(repr, policy.out_keys))}, {expected}")
    elif not callable(policy) or (isinstance(policy, nn.Module) and type(policy).forward is nn.Module.forward):
        views = [name for name in ("deployed", "actor", "sampled") if hasattr(policy, name)]
        hint = f", as its {' and '.join(f'{name}()' for name in views)} do" if views else ""
        raise ConfigError(f"{what}: policy is a {type(policy).__name__}, {expected}{hint}")


def expects(module: M, shapes: Mapping[NestedKey, Shape], what: str, *, double: bool = False) -> M:
    """Let a TensorDict module check its entries when it is called, see :func:`check_entries`; return it.

    Calls with tensors in the place of a TensorDict are not checked.

    Args:
        module: the module.
        shapes: trailing dimensions of the entries that it reads.
        what: name of the module in messages.
        double: take float64 whatever the module's precision, as one without weights does.

    >>> from tensordict import TensorDict
    >>> from tensordict.nn import TensorDictModule
    >>> layer = TensorDictModule(nn.Linear(3, 2), in_keys=["x"], out_keys=["y"])
    >>> expects(layer, {"x": (3,)}, "layer")(TensorDict({"z": torch.zeros(3)}))
    Traceback (most recent call last):
    ...
    plat.errors.ObservationError: layer: no entry 'x', expected one of shape [*B, 3]
    """
    module.register_forward_pre_hook(_Expected(dict(shapes), what, double))
    return module


@dataclass(frozen=True)
class _Expected:
    """Hook that checks what a module is called with."""

    shapes: dict[NestedKey, Shape]
    what: str
    double: bool

    def __call__(self, module: nn.Module, args: tuple[Any, ...]) -> None:
        if args and isinstance(args[0], TensorDictBase):
            check_entries(args[0], self.shapes, self.what, double=self.double or _is_double(module))


def _is_double(module: nn.Module) -> bool:
    first = next(chain(module.parameters(), module.buffers()), None)
    return first is None or first.dtype == torch.float64


def _fits(expected: int | str, found: int) -> bool:
    if isinstance(expected, int):
        return expected == found
    factor = expected.split()[0]
    return not factor.isdigit() or found % int(factor) == 0


def _text(shape: Shape) -> str:
    return f"[{', '.join(map(str, ('*B', *shape)))}]"


def _dtype(value: Tensor) -> str:
    return str(value.dtype).removeprefix("torch.")
