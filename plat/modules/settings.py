"""Shapes of the networks, apart from them so that a command line can show them without torch."""

from dataclasses import dataclass
from typing import Annotated, Literal, TypeAlias

from plat.bounds import Bounded, Count, Layers, NonNegative, NotEmpty, Positive, Range
from plat.errors import ConfigError
from plat.spec.timing import Timing

__all__ = [
    "DynamicsConfig",
    "ExpertConfig",
    "LatentPolicyConfig",
    "NormalizerConfig",
    "PlainPolicyConfig",
    "RefinementConfig",
]

Width: TypeAlias = Annotated[int, Range(1, 65_536)]
"""Number of features."""


@dataclass(frozen=True)
class NormalizerConfig(Bounded):
    """Constants of :class:`ObservationNormalizer`."""

    eps: Positive = 0.01
    """added to the standard deviation, so that nearly constant features are not blown up"""
    clip: Positive = 10.0
    """bound on the normalized features"""


@dataclass(frozen=True)
class ExpertConfig(Bounded):
    """Shape of the expert."""

    hidden: Layers = (512, 256, 128)
    """hidden layers"""
    action: Literal["reference_residual", "reference_velocity", "default_offset"] = "reference_residual"
    """base of the action: goal joint angles, those with velocity feed-forward, or default pose"""
    ahead: Annotated[tuple[Count, ...], NotEmpty()] = (1,)
    """reference frames in the observation, counted from the current one"""
    residual_limit: Positive = 5.0
    """bound on the network's output where it is added to the reference"""
    lead: NonNegative = 0.0
    """velocity feed-forward (s) of the reference; needs two frames in ahead"""
    catch_up: NonNegative = 0.0
    """proportional gain on the position error: the reference is shown displaced by gain * error"""
    catch_up_limit: NonNegative = 0.3
    """longest position error that the gain is applied to (m)"""
    symmetric: bool = False
    """acts by the mean of its action and the mirrored one"""
    init_std: Positive = 0.6
    """exploration noise at the start, in units of action"""
    min_std: Positive = 0.02
    """lower bound on the exploration noise"""
    normalizer: NormalizerConfig = NormalizerConfig()
    """normalization of the observation"""
    timing: Timing = Timing()
    """control step that it acts at, and the commands that it is given"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if list(self.ahead) != sorted(set(self.ahead)):  # a frame twice would be seen once, without a word
            raise ConfigError(f"ExpertConfig: ahead is {self.ahead}, expected frames in ascending order, each once")
        if len(self.ahead) < 2 and self.action == "reference_velocity":
            raise ConfigError(
                f"ExpertConfig: ahead is {self.ahead}, expected two frames for the action 'reference_velocity'"
            )
        if len(self.ahead) < 2 and self.lead:
            raise ConfigError(f"ExpertConfig: ahead is {self.ahead}, expected two frames for a lead of {self.lead:g} s")


@dataclass(frozen=True)
class WalkingReach(Bounded):
    """Reach of a walk, beyond which keyframes are shown nearer."""

    acceleration: NonNegative = 3.0
    """with which a robot gains speed (m/s^2)"""
    speed: Positive = 1.5
    """that it gains at most (m/s); one that is faster keeps its own"""
    margin: NonNegative = 0.2
    """added to the way (m)"""


@dataclass(frozen=True)
class PlainPolicyConfig(Bounded):
    """Shape of the student without a latent."""

    backbone: Layers = (512,)
    """hidden layers of the backbone"""
    hidden_size: Width = 256
    """size of h"""
    decoder: Layers = (256, 128)
    """hidden layers of the decoder"""
    normalizer: NormalizerConfig = NormalizerConfig()
    """normalization of the observation"""
    timing: Timing = Timing()
    """control step that it acts at, and the commands that it is given"""
    also: tuple[Literal["parts", "clock"], ...] = ()
    """observed beside robot, goal and command: parts (partial keyframes), clock (the last 0.2 s)"""
    reach: WalkingReach | None = None
    """shows keyframes beyond it nearer; none shows them where they are"""
    symmetric: bool = False
    """acts by the mean of its action and the mirrored one; with a latent: when deployed"""


@dataclass(frozen=True)
class LatentPolicyConfig(PlainPolicyConfig):
    """Shape of the student. A plain one has neither latent, prior nor posterior."""

    latent_size: Width = 32
    """size of z"""
    prior: Layers = (256,)
    """hidden layers of the prior"""
    posterior: Layers = (256,)
    """hidden layers of the posterior"""
    encoder_size: Width = 128
    """size of the goal-sequence code e"""
    min_std: Positive = 0.01
    """lower bound on the standard deviations of prior and posterior; bounds the divergence"""


@dataclass(frozen=True)
class RefinementConfig(Bounded):
    """Size of the residual and exploration around the student."""

    hidden: Layers = (256, 128)
    """hidden layers of the residual"""
    alpha: NonNegative = 0.5
    """scale of the residual"""
    init_std: Positive = 0.2
    """exploration noise at the start, in units of what it is added to"""
    lead: NonNegative = 0.0
    """feed-forward (s): shifts the keyframe along the way to it, against arriving late"""
    shortest_lead: Positive = 0.1
    """shortest time to a keyframe that the feed-forward divides by (s)"""
    min_std: Positive = 0.02
    """lower bound on the exploration noise"""


@dataclass(frozen=True)
class DynamicsConfig(Bounded):
    """Shape of the model of the robot."""

    hidden: Annotated[Layers, NotEmpty()] = (512, 512, 512)
    """hidden layers"""
