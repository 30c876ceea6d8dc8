"""Rollout collection: TorchRL's collector, set up for robots that are simulated in this process."""

import copy
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import TracebackType
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torchrl.collectors import Collector
from torchrl.envs import EnvBase, TransformedEnv
from torchrl.envs.batched_envs import BatchedEnvBase

from plat.bounds import Count, check_value
from plat.collectors.packing import as_bytes, unpacked
from plat.entries import check_policy
from plat.envs.transforms import pop_statistics
from plat.errors import ConfigError, PlatError, StateError
from plat.precision import Precision, autocast
from plat.spec.timing import timing_of

__all__ = [
    "ActingPolicy",
    "Rollouts",
    "check_timings",
    "gathered",
    "restore",
    "rollouts",
    "simulation_threads",
    "state_of",
]

# Below this many robots a second PyTorch thread costs the physics pool more than it gains the transforms: its
# threads spin while they wait, on cores that the pool needs.
_ROBOTS_PER_THREAD = 1024


class Rollouts(Iterator[TensorDictBase]):
    """Iterator over rollouts ``[N, steps]`` of a policy without end, each continuing the last one.

    Those of environments side by side, in TorchRL's ``SerialEnv`` or ``ParallelEnv``, are ``[E, N, steps]``: flatten
    the first two for what takes ``[N, steps]``, and :meth:`close` them, or use the rollouts in ``with``.

    During simulation PyTorch uses few threads; between rollouts, where the caller learns, as many as before. Its state
    holds the robots: a run that is restored goes on with the very next step.

    Args:
        env: N robots. They are reset here.
        policy: writes ``action``.
        steps: control steps of each robot in a rollout.
        precision: of the networks' hidden layers, see :func:`plat.objectives.autocast`. With the precision of the
            updates, the loss computes the same probability of an action as the acting policy.

    Raises:
        ConfigError: for a policy that writes no ``action``, or is made for another timing than the environment's.

    >>> from plat.envs import make_tracking_env
    >>> from plat.modules import Expert
    >>> from plat.motions import MotionLibrary, generate_motions
    >>> from plat.robots import G1
    >>> env = make_tracking_env(MotionLibrary.from_clips(generate_motions("train", seconds=8)), num_envs=2)
    >>> next(Rollouts(env, Expert(G1).actor(), steps=3)).shape
    torch.Size([2, 3])
    """

    def __init__(self, env: EnvBase, policy: TensorDictModuleBase, steps: int, precision: Precision = "auto"):
        check_value("rollouts: steps", steps, Count)
        check_policy(policy, "rollouts")
        check_timings(env, policy)
        self.env = env
        self._collector = Collector(
            env,
            ActingPolicy(policy, env.device, precision),
            frames_per_batch=env.numel() * steps,
            track_traj_ids=False,
            trust_policy=True,
            auto_register_policy_transforms=False,
        )
        self._batches = iter(self._collector)

    def __next__(self) -> TensorDictBase:
        with simulation_threads(self.env.numel()):
            return next(self._batches)

    def statistics(self) -> dict[str, float]:
        """Return the means that the environment gathered since the last call, see :func:`pop_statistics`."""
        return gathered(self.env)

    def state_dict(self) -> dict[str, Any]:
        """Return the state from which the next rollout is the same: robots, transforms and the last observation."""
        return state_of(self._collector)

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore a state of :meth:`state_dict`, or that of one worker.

        Raises:
            StateError: when it is of another number of robots, of another model, or of several worker processes.
        """
        of_workers = state.get("workers", ())
        restore(self._collector, unpacked(as_bytes(of_workers[0])) if len(of_workers) == 1 else state)

    def close(self) -> None:
        """Close environments side by side: a program does not end before the processes of a ``ParallelEnv`` have.

        One of robots in this process stays open; nothing of it has to end.
        """
        if isinstance(_inner(self.env), BatchedEnvBase):
            self.env.close(raise_if_closed=False)

    def __enter__(self) -> "Rollouts":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def check_timings(env: EnvBase, policy: TensorDictModuleBase) -> None:
    """Raise an error for a policy that would take the times of an environment's commands for others.

    Of one that does not read them, as an expert beside a student, the control step counts alone.

    Raises:
        ConfigError: saying which timing is expected.
    """
    if isinstance(_inner(env), BatchedEnvBase):  # whose parts are out of reach
        return
    try:
        ours, theirs = timing_of(policy), timing_of(env)
    except PlatError:  # a mixture of policies with several
        return
    if ours is None or theirs is None:
        return
    reads = any(key[0] in ("command", "clock") for key in policy.in_keys if isinstance(key, tuple))
    if ours != theirs if reads else ours.control_dt != theirs.control_dt:
        raise ConfigError(f"rollouts: {ours} of the policy, expected the environment's {theirs} (timing=policy.timing)")


def gathered(env: EnvBase) -> dict[str, float]:
    """Return the means that an environment's transforms gathered since the last call; none of one without transforms.

    See :func:`plat.envs.transforms.pop_statistics`.
    """
    return pop_statistics(env) if isinstance(env, TransformedEnv) else {}


def state_of(collector: Collector) -> dict[str, Any]:
    """Return a copy of the state of a collector's robots, transforms and last observation.

    Raises:
        StateError: for environments side by side, whose robots' states are out of reach.
    """
    layers, base = _layers(collector.env), _base_of(collector.env)
    state: dict[str, Any] = {
        "observation": collector._carrier.to_dict(),
        "transforms": layers[0].state_dict() if layers else {},
        "robots": base.state_dict(),
    }
    if layers[1:]:
        state["inner_transforms"] = [layer.state_dict() for layer in layers[1:]]
    return copy.deepcopy(state)  # transforms go on writing into their tensors


def restore(collector: Collector, state: Mapping[str, Any]) -> None:
    """Restore a state of :func:`state_of`.

    Raises:
        StateError: for environments side by side; when it is of another number of robots, of another model, of worker
            processes, or of another version of plat, whose observations have other entries.
    """
    env, base, carrier = collector.env, _base_of(collector.env), collector._carrier
    if "robots" not in state:
        raise StateError("rollouts: a state of worker processes; go on with as many workers as before")
    absent = set(env.observation_spec.keys(True, True)) - set(TensorDict(state["observation"]).keys(True, True))
    if absent:
        names = sorted(name if isinstance(name, str) else ".".join(name) for name in absent)
        raise StateError(f"rollouts: a state without {', '.join(names[:5])}, by another version of plat")
    base.load_state_dict(state["robots"])
    for layer, values in zip(_layers(env), [state["transforms"], *state.get("inner_transforms", ())], strict=False):
        layer.load_state_dict(values)
    # numbers of its own, which a collector in a worker has and one in this process has not
    own = carrier.get("collector", None)
    seen = {"collector": own, **state["observation"]}
    if own is None:
        del seen["collector"]
    observation = TensorDict(seen, env.batch_size, device=env.device)
    collector._carrier = observation if carrier.device is not None else observation.clear_device_()


def _layers(env: EnvBase) -> list[TransformedEnv]:
    """Return the environments of transforms around one, the outermost first; TorchRL may leave them nested."""
    layers: list[TransformedEnv] = []
    while isinstance(env, TransformedEnv):
        layers.append(env)
        env = env.base_env
    return layers


def _inner(env: EnvBase) -> EnvBase:
    layers = _layers(env)
    base: EnvBase = layers[-1].base_env if layers else env
    return base


def _base_of(env: EnvBase) -> EnvBase:
    base = _inner(env)
    if isinstance(base, BatchedEnvBase):
        raise StateError(
            f"rollouts: a {type(base).__name__} has no state to go on from; simulate all robots in one environment, or "
            "with workers (plat.collectors.collect)"
        )
    return base


def rollouts(env: EnvBase, policy: TensorDictModuleBase, steps: int, precision: Precision = "auto") -> Rollouts:
    """Return :class:`Rollouts` of a policy: ``for rollout in rollouts(env, policy, steps=24): ...``."""
    return Rollouts(env, policy, steps, precision)


@contextmanager
def simulation_threads(num_envs: int) -> Iterator[None]:
    """Limit PyTorch, as a context, to the threads that pay off beside the simulation of ``num_envs`` robots."""
    threads = torch.get_num_threads()
    torch.set_num_threads(min(threads, max(1, num_envs // _ROBOTS_PER_THREAD)))
    try:
        yield
    finally:
        torch.set_num_threads(threads)


class ActingPolicy(TensorDictModuleBase):
    """Policy whose networks run at a precision; the environment's own arithmetic is unaffected."""

    def __init__(self, policy: TensorDictModuleBase, device: torch.device | None, precision: Precision):
        super().__init__()
        self.policy = policy
        self.in_keys, self.out_keys = policy.in_keys, policy.out_keys
        self._device, self._precision = device, precision

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        with autocast(self._device, self._precision):
            return self.policy(tensordict)
