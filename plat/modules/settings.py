"""Shapes of the networks, apart from them so that a command line can show them without torch."""

from dataclasses import dataclass
from typing import Literal

from plat.spec.timing import Timing

__all__ = [
    "DynamicsConfig",
    "ExpertConfig",
    "LatentPolicyConfig",
    "NormalizerConfig",
    "PlainPolicyConfig",
    "RefinementConfig",
]


@dataclass(frozen=True)
class NormalizerConfig:
    """Constants of :class:`ObservationNormalizer`."""

    eps: float = 0.01
    """added to the standard deviation; keeps nearly constant features from being blown up"""
    clip: float = 10.0
    """bound on the normalized features"""


@dataclass(frozen=True)
class ExpertConfig:
    """Shape of the expert."""

    hidden: tuple[int, ...] = (512, 256, 128)
    """hidden layers"""
    action: Literal["reference_residual", "reference_velocity", "default_offset"] = "reference_residual"
    """base of the action: goal joint angles, those with velocity feed-forward, or default pose"""
    ahead: tuple[int, ...] = (1,)
    """reference frames in the observation, counted from the current one"""
    residual_limit: float = 5.0
    """bound on the network's output where it is added to the reference"""
    lead: float = 0.0
    """velocity feed-forward (s) of the reference; needs two frames in ahead"""
    catch_up: float = 0.0
    """proportional gain on the position error: the reference is shown displaced by gain * error"""
    catch_up_limit: float = 0.3
    """longest position error that the gain is applied to (m)"""
    init_std: float = 0.6
    """exploration noise at the start, in units of action"""
    min_std: float = 0.02
    """lower bound on the exploration noise"""
    normalizer: NormalizerConfig = NormalizerConfig()
    """normalization of the observation"""
    timing: Timing = Timing()
    """control step that it acts at, and the commands that it is given"""


@dataclass(frozen=True)
class PlainPolicyConfig:
    """Shape of the student without a latent."""

    backbone: tuple[int, ...] = (512,)
    """hidden layers of the backbone"""
    hidden_size: int = 256
    """size of h"""
    decoder: tuple[int, ...] = (256, 128)
    """hidden layers of the decoder"""
    normalizer: NormalizerConfig = NormalizerConfig()
    """normalization of the observation"""
    timing: Timing = Timing()
    """control step that it acts at, and the commands that it is given"""


@dataclass(frozen=True)
class LatentPolicyConfig(PlainPolicyConfig):
    """Shape of the student with a privileged latent."""

    latent_size: int = 32
    """size of z"""
    prior: tuple[int, ...] = (256,)
    """hidden layers of the prior"""
    posterior: tuple[int, ...] = (256,)
    """hidden layers of the posterior"""
    encoder_size: int = 128
    """size of the goal-sequence code e"""
    min_std: float = 0.01
    """lower bound on the standard deviations of prior and posterior; bounds the divergence"""


@dataclass(frozen=True)
class RefinementConfig:
    """Size of the residual and exploration around the student."""

    hidden: tuple[int, ...] = (256, 128)
    """hidden layers of the residual"""
    alpha: float = 0.5
    """scale of the residual"""
    init_std: float = 0.2
    """exploration noise at the start, in units of what it is added to"""
    lead: float = 0.0
    """feed-forward (s): shifts the keyframe along the way to it, against arriving late"""
    shortest_lead: float = 0.1
    """shortest time to a keyframe that the feed-forward divides by (s)"""
    min_std: float = 0.02
    """lower bound on the exploration noise"""


@dataclass(frozen=True)
class DynamicsConfig:
    """Shape of the model of the robot."""

    hidden: tuple[int, ...] = (512, 512, 512)
    """hidden layers"""
