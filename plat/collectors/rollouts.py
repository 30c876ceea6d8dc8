"""Rollout collection: TorchRL's collector, set up for robots that are simulated in this process."""

from collections.abc import Iterator
from contextlib import contextmanager

import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torchrl.collectors import Collector
from torchrl.envs import EnvBase

from plat.precision import Precision, autocast

__all__ = ["rollouts", "simulation_threads"]

# Below this many robots a second PyTorch thread costs the physics pool more than it gains the transforms: its
# threads spin while they wait, on cores that the pool needs.
_ROBOTS_PER_THREAD = 1024


def rollouts(
    env: EnvBase, policy: TensorDictModuleBase, steps: int, precision: Precision = "auto"
) -> Iterator[TensorDictBase]:
    """Yield rollouts ``[N, steps]`` of a policy without end, each continuing the last one.

    During simulation PyTorch uses few threads; between rollouts, where the caller learns, as many as before.

    Args:
        env: N robots.
        policy: writes ``action``.
        steps: control steps of each robot in a rollout.
        precision: of the networks' hidden layers, see :func:`plat.objectives.autocast`. With the precision of the
            updates, the loss computes the same probability of an action as the acting policy.

    >>> from plat.envs import make_tracking_env
    >>> from plat.motions import MotionLibrary
    >>> from plat.robots import G1
    >>> from plat.motions import generate_motions
    >>> from plat.modules import Expert
    >>> env = make_tracking_env(MotionLibrary.from_clips(generate_motions("train", seconds=8)), num_envs=2)
    >>> next(rollouts(env, Expert(G1).actor(), steps=3)).shape
    torch.Size([2, 3])
    """
    num_envs = env.batch_size[0]
    collector = Collector(
        env,
        _AtPrecision(policy, env.device, precision),
        frames_per_batch=num_envs * steps,
        track_traj_ids=False,
        trust_policy=True,
        auto_register_policy_transforms=False,
    )
    batches = iter(collector)
    try:
        while True:
            with simulation_threads(num_envs):
                rollout = next(batches)
            yield rollout
    finally:
        collector.shutdown()


@contextmanager
def simulation_threads(num_envs: int) -> Iterator[None]:
    """Limit PyTorch, as a context, to the threads that pay off beside the simulation of ``num_envs`` robots."""
    threads = torch.get_num_threads()
    torch.set_num_threads(min(threads, max(1, num_envs // _ROBOTS_PER_THREAD)))
    try:
        yield
    finally:
        torch.set_num_threads(threads)


class _AtPrecision(TensorDictModuleBase):
    """Policy whose networks run at a precision; the environment's own arithmetic is unaffected."""

    def __init__(self, policy: TensorDictModuleBase, device: torch.device | None, precision: Precision):
        super().__init__()
        self.policy = policy
        self.in_keys, self.out_keys = policy.in_keys, policy.out_keys
        self._device, self._precision = device, precision

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        with autocast(self._device, self._precision):
            return self.policy(tensordict)
