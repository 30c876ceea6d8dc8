"""Deployed policy: deterministic, with its timing."""

from collections.abc import Iterable
from typing import TypeVar

from tensordict import NestedKey
from tensordict.nn import TensorDictModuleBase, TensorDictSequential

from plat.spec.timing import Timing

__all__ = ["DeployedPolicy", "timed"]

M = TypeVar("M", bound=TensorDictModuleBase)


def timed(module: M, timing: Timing) -> M:
    """Let a module carry the timing that it was trained with, see :func:`plat.spec.timing.timing_of`; return it."""
    module.timing = timing
    return module


class DeployedPolicy(TensorDictSequential):
    """Deterministic policy that knows the timing that it was trained with.

    Environments and controllers that are given it scale the time to a keyframe by this timing.

    Args:
        modules: run one after the other.
        timing: of the policy.
        out_key: entry that holds the action.

    >>> from plat.robots import G1
    >>> from plat.modules import LatentPolicy
    >>> LatentPolicy(G1).deployed().timing.max_steps
    50
    """

    def __init__(self, *modules: TensorDictModuleBase, timing: Timing, out_key: str = "action"):
        super().__init__(*modules, selected_out_keys=[out_key])
        self.timing = timing

    def __getitem__(self, index: int | slice | str) -> TensorDictModuleBase:
        """Return one of the modules, or some of them as a sequence: a part of a policy is none."""
        return TensorDictSequential(*self.module)[index]

    def select_subsequence(
        self, in_keys: Iterable[NestedKey] | None = None, out_keys: Iterable[NestedKey] | None = None
    ) -> TensorDictSequential:
        """Return the modules that lead from some entries to others as a sequence."""
        out_keys = self.out_keys if out_keys is None else out_keys
        return TensorDictSequential(*self.module).select_subsequence(in_keys, out_keys)
