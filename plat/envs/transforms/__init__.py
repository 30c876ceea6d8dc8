"""Transforms that turn the simulated robot into a task. They communicate through TensorDict entries only."""

from typing import TYPE_CHECKING

from plat.lazy import lazy

if TYPE_CHECKING:
    from plat.envs.transforms.base import ObservationTransform, Statistics, pop_statistics
    from plat.envs.transforms.command import (
        HORIZONS,
        PAPER_HORIZONS,
        CommandSchedule,
        Horizon,
        KeyframeClock,
        KeyframeCommand,
        horizon_named,
    )
    from plat.envs.transforms.goals import NEXT_DENSE_FRAME, NEXT_FRAME, DenseGoal
    from plat.envs.transforms.noise import ObservationNoise
    from plat.envs.transforms.privileged import PrivilegedState
    from plat.envs.transforms.randomization import DomainRandomization
    from plat.envs.transforms.reference import ReferenceMotion, align_to_anchor
    from plat.envs.transforms.rewards import Reward, RewardGroup, Rewards
    from plat.envs.transforms.schedule import ScheduledStarts
    from plat.envs.transforms.settings import NoiseLevels, RandomizationRanges, TerminationLimits, TrackingLimits
    from plat.envs.transforms.starts import FailureWeightedStarts, FirstFrames
    from plat.envs.transforms.terminations import KeyframeTermination, TrackingTermination
    from plat.envs.transforms.tracking_errors import METRIC_KEYS, KeyframeMetrics, TrackingError
    from plat.envs.transforms.tracking_rewards import DenseRewards, KeyframeRewards, Regularization, TrackingTerm
else:
    lazy(__name__)

__all__ = [
    "HORIZONS",
    "METRIC_KEYS",
    "NEXT_DENSE_FRAME",
    "NEXT_FRAME",
    "PAPER_HORIZONS",
    "CommandSchedule",
    "DenseGoal",
    "DenseRewards",
    "DomainRandomization",
    "FailureWeightedStarts",
    "FirstFrames",
    "Horizon",
    "KeyframeClock",
    "KeyframeCommand",
    "KeyframeMetrics",
    "KeyframeRewards",
    "KeyframeTermination",
    "NoiseLevels",
    "ObservationNoise",
    "ObservationTransform",
    "PrivilegedState",
    "RandomizationRanges",
    "ReferenceMotion",
    "Regularization",
    "Reward",
    "RewardGroup",
    "Rewards",
    "ScheduledStarts",
    "Statistics",
    "TerminationLimits",
    "TrackingError",
    "TrackingLimits",
    "TrackingTerm",
    "TrackingTermination",
    "align_to_anchor",
    "horizon_named",
    "pop_statistics",
]
