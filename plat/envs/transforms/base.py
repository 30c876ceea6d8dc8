"""Base classes of transforms: running statistics, checks of entries, derived observations."""

from collections.abc import Iterable, Mapping, Sequence

import torch
from tensordict import NestedKey, TensorDictBase
from torch import Tensor
from torchrl.data import Composite, Unbounded
from torchrl.envs import EnvBase, Transform, TransformedEnv

from plat.envs.broken import BrokenRobots
from plat.errors import TaskError

__all__ = ["ObservationTransform", "Statistics", "check_entries", "check_step_entries", "pop_statistics"]

# Which transform writes a group, for messages.
_WRITERS = {"reference": "ReferenceMotion", "command": "KeyframeClock", "goal": "KeyframeCommand or DenseGoal"}


class Statistics:
    """Running means of named quantities, gathered inside transforms and collected once an iteration.

    >>> statistics = Statistics()
    >>> statistics.add("speed", torch.tensor([1.0, 3.0]))
    >>> statistics.pop()
    {'speed': 2.0}
    """

    def __init__(self) -> None:
        self._sums: dict[str, Tensor] = {}
        self._counts: dict[str, float] = {}

    def add(self, name: str, values: Tensor) -> None:
        """Add the average over all elements of ``values``."""
        self._sums[name] = self._sums.get(name, 0.0) + values.detach().sum(dtype=torch.float64)
        self._counts[name] = self._counts.get(name, 0) + values.numel()

    def pop(self) -> dict[str, float]:
        """Return the means since the last call."""
        means = {name: float(total) / self._counts[name] for name, total in self._sums.items() if self._counts[name]}
        self._sums.clear()
        self._counts.clear()
        return means


def pop_statistics(env: TransformedEnv) -> dict[str, float]:
    """Return the means that an environment's transforms gathered since the last call.

    ``broken`` counts the robots that were terminated for an absurd action or a diverged simulation, if there were any.
    """
    means: dict[str, float] = {}
    inner: EnvBase = env
    while isinstance(inner, TransformedEnv):
        for transform in inner.transform.modules():
            statistics = getattr(transform, "statistics", None)
            if isinstance(statistics, Statistics):
                means.update(statistics.pop())
        inner = inner.base_env
    broken = vars(inner).get("broken")
    if isinstance(broken, BrokenRobots) and (count := broken.pop()):
        means["broken"] = float(count)
    return means


def check_entries(name: str, needs: Iterable[NestedKey], observation_spec: Composite) -> None:
    """Check that earlier transforms write the entries that one reads.

    Args:
        name: of the transform that reads.
        needs: entries that it reads.
        observation_spec: entries that are there when its turn comes.

    Raises:
        TaskError: naming the first entry that is missing, and who writes it.
    """
    known = set(observation_spec.keys(True, True))
    for key in needs:
        if key not in known:
            writer = _WRITERS.get(key[0] if isinstance(key, tuple) else key)
            hint = f"; put {writer} before it" if writer else ""
            raise TaskError(f"{name} reads {key!r}, which no transform before it writes{hint}")


def check_step_entries(name: str, needs: Iterable[NestedKey], observation_spec: Composite) -> None:
    """Check the entries of a transform that judges a step; it must see the command that the step belonged to.

    Raises:
        TaskError: also when the next command has been issued by then.
    """
    check_entries(name, needs, observation_spec)
    if ("command", "horizon") in observation_spec.keys(True, True):
        raise TaskError(f"{name} judges a step, but the next command has been issued: put it before KeyframeCommand")


class ObservationTransform(Transform):
    """Transform that derives entries from those of the same time step.

    A subclass names what it reads and writes and overrides :meth:`compute`. After a partial reset only the robots
    that were reset are computed.

    Args:
        in_keys: entries that :meth:`compute` reads.
        out_shapes: for every entry that it writes, its shape without the batch.
        out_dtypes: dtype of those that are not float32.
    """

    def __init__(
        self,
        in_keys: Sequence[NestedKey],
        out_shapes: Mapping[NestedKey, tuple[int, ...]],
        out_dtypes: Mapping[NestedKey, torch.dtype] | None = None,
    ):
        super().__init__(in_keys=list(in_keys), out_keys=list(out_shapes))
        self._out_shapes = dict(out_shapes)
        self._out_dtypes = dict(out_dtypes or {})
        self.statistics = Statistics()

    def compute(self, tensordict: TensorDictBase) -> dict[NestedKey, Tensor]:
        """Compute the new entries ``[n, ...]`` for a batch ``[n]`` of robots."""
        raise NotImplementedError

    def _call(self, next_tensordict: TensorDictBase) -> TensorDictBase:
        for key, value in self.compute(next_tensordict).items():
            next_tensordict.set(key, value)
        return next_tensordict

    def _reset(self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase) -> TensorDictBase:
        mask = tensordict.get("_reset", None)
        if mask is None:
            return self._call(tensordict_reset)
        rows = mask.view(-1).nonzero()[:, 0]
        part = tensordict_reset.select(*self.in_keys)[rows]
        try:
            computed = self.compute(part)
        except KeyError as error:  # after a step it finds the other entries as well
            told = f"{type(self).__name__} reads an entry that its in_keys do not name: {error.args[0]}"
            raise TaskError(told) from error
        for key, value in computed.items():
            # the other rows are never looked at: the caller merges by the mask
            full = value.new_empty(len(mask), *value.shape[1:])
            tensordict_reset.set(key, full.index_copy_(0, rows, value))
        return tensordict_reset

    def transform_observation_spec(self, observation_spec: Composite) -> Composite:
        """Add the new entries.

        Raises:
            TaskError: when an entry that it reads is not there.
        """
        check_entries(type(self).__name__, self.in_keys, observation_spec)
        count = observation_spec.shape
        for key, shape in self._out_shapes.items():
            dtype = self._out_dtypes.get(key, torch.float32)
            spec = Unbounded((*count, *shape), dtype=dtype, device=observation_spec.device)
            groups = key[:-1] if isinstance(key, tuple) else ()
            for depth in range(1, len(groups) + 1):
                if groups[:depth] not in observation_spec.keys(True):
                    observation_spec[groups[:depth]] = Composite(shape=count, device=observation_spec.device)
            observation_spec[key] = spec
        return observation_spec
