"""Data collection: rollouts, and DAgger on TorchRL's replay buffers."""

from typing import TYPE_CHECKING

from plat.lazy import lazy

if TYPE_CHECKING:
    from plat.collectors.dagger import LOOKUP_KEYS, ExpertLabels, MixedPolicy, dagger_buffer
    from plat.collectors.goals import PrivilegedGoals, strided_offsets
    from plat.collectors.hosts import EnvFactory
    from plat.collectors.replay import RolloutReplay
    from plat.collectors.rollouts import Rollouts, rollouts, simulation_threads
    from plat.collectors.workers import WorkerRollouts, collect
else:
    lazy(__name__)

__all__ = [
    "LOOKUP_KEYS",
    "EnvFactory",
    "ExpertLabels",
    "MixedPolicy",
    "PrivilegedGoals",
    "RolloutReplay",
    "Rollouts",
    "WorkerRollouts",
    "collect",
    "dagger_buffer",
    "rollouts",
    "simulation_threads",
    "strided_offsets",
]
