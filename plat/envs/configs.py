"""Settings of the tasks: simulation, rewards and terminations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from plat.bounds import Bounded, Count, Fraction, NonNegative, Positive
from plat.envs.settings import ResetNoise
from plat.envs.transforms.settings import NoiseLevels, RandomizationRanges, TerminationLimits, TrackingLimits
from plat.envs.transforms.tracking_rewards import DenseRewards, KeyframeRewards, Regularization
from plat.robots.contacts import FootContacts

if TYPE_CHECKING:
    from plat.envs.transforms.rewards import Reward, RewardGroup
    from plat.robots.robot import Robot

__all__ = ["DistillationTaskConfig", "KeyframeTaskConfig", "RewardTerms", "SimulationConfig", "TrackingTaskConfig"]

RewardTerms: TypeAlias = "tuple[Reward | RewardGroup, ...]"
"""Rewards of a task: terms, and groups of terms."""


@dataclass(frozen=True)
class SimulationConfig(Bounded):
    """Settings of every training environment, whatever its task."""

    decimation: Count = 4
    """physics steps per control step"""
    feet: FootContacts = "spheres"
    """contact geometry of the soles"""
    reset_noise: ResetNoise = ResetNoise()
    """noise on the starting state"""
    max_displacement: Positive | None = 0.5
    """horizontal root error (m) that terminates a training episode; None for no such limit"""
    uniform_starts: Fraction = 0.5
    """fraction of the episodes that start anywhere; the others start where failures are frequent"""
    noise: NoiseLevels | None = None
    """observation noise; None for none"""
    randomization: RandomizationRanges | None = None
    """domain randomization at each reset, and pushes; None for none"""


@dataclass(frozen=True)
class TrackingTaskConfig(SimulationConfig):
    """Settings of stage 1: dense motion tracking."""

    dense: DenseRewards = DenseRewards()
    """terms of the tracking reward"""
    regularization: Regularization = Regularization()
    """penalties"""
    regularization_weight: NonNegative = 1.0
    """factor on the penalties, w_reg"""
    limits: TrackingLimits = TrackingLimits()
    """termination thresholds of tracking"""

    def rewards(self, robot: Robot) -> RewardTerms:
        """Return the rewards of a robot: tracking and penalties."""
        return (_group(1.0, self.dense.rewards(robot)), _penalties(self, robot))


@dataclass(frozen=True)
class DistillationTaskConfig(SimulationConfig):
    """Settings of stage 2: timed keyframes without rewards."""

    limits: TerminationLimits = TerminationLimits()
    """termination thresholds of a command"""
    partial: Fraction = 0.0
    """share of the partial keyframes; needs a policy that sees "parts" (--policy.also)"""

    def rewards(self, robot: Robot) -> RewardTerms:
        """Return no rewards."""
        return ()


@dataclass(frozen=True)
class KeyframeTaskConfig(DistillationTaskConfig):
    """Settings of stage 3: timed keyframes with rewards ``w_dense r_dense + w_sparse r_sparse + w_reg r_reg``."""

    dense: DenseRewards = DenseRewards()
    """terms of the dense reward"""
    sparse: KeyframeRewards = KeyframeRewards()
    """terms of the keyframe reward"""
    regularization: Regularization = Regularization()
    """penalties"""
    dense_weight: NonNegative = 1.0
    """factor on the dense reward, w_dense"""
    sparse_weight: NonNegative = 5.0
    """factor on the keyframe reward, w_sparse"""
    regularization_weight: NonNegative = 1.0
    """factor on the penalties, w_reg"""

    def rewards(self, robot: Robot) -> RewardTerms:
        """Return the rewards of a robot: tracking, keyframes and penalties."""
        return (
            _group(self.dense_weight, self.dense.rewards(robot)),
            _group(self.sparse_weight, self.sparse.rewards(robot)),
            _penalties(self, robot),
        )


def _penalties(config: TrackingTaskConfig | KeyframeTaskConfig, robot: Robot) -> RewardGroup:
    penalties = config.regularization
    return _group(config.regularization_weight, penalties.rewards(robot), penalties.floor)


def _group(weight: float, rewards: tuple[Reward, ...], floor: float | None = None) -> RewardGroup:
    from plat.envs.transforms.rewards import RewardGroup  # torch: a help text has no use for it

    return RewardGroup(weight, rewards, floor)
