"""Hyperparameters, apart from the updates so that a command line can show them without torch."""

from dataclasses import dataclass
from typing import Literal

from plat.precision import Precision

__all__ = ["ImaginationConfig", "MotorGradientConfig", "PPOConfig"]


@dataclass(frozen=True)
class PPOConfig:
    """Hyperparameters of PPO. Defaults are those of rsl_rl for whole-body tracking unless stated otherwise."""

    gamma: float = 0.99
    """discount per control step"""
    lmbda: float = 0.95
    """lambda of GAE: trades bias against variance"""
    clip: float = 0.2
    """clipping range of the probability ratio"""
    epochs: int = 5
    """epochs over a rollout"""
    minibatches: int = 4
    """minibatches per epoch"""
    entropy: float = 0.005
    """weight of the entropy bonus"""
    grad_norm: float = 1.0
    """largest norm of the gradient, for policy and critic each"""
    lr: float = 1e-3
    """learning rate of the policy at the start"""
    min_lr: float = 3e-4
    """lower end of the adaptive learning rate; without it one bad batch stops learning for good"""
    max_lr: float = 1e-2
    """upper end"""
    critic_lr: float = 1e-3
    """fixed learning rate of the critic, independent of the policy's adaptive one"""
    precision: Precision = "auto"
    """precision of the networks' hidden layers in updates"""
    truncated: Literal["state", "mean"] = "state"
    """bootstrap value at truncation: of the last state, or the mean of the rollout"""
    target_kl: float = 0.02
    """KL divergence (nats) per update that the adaptive learning rate aims at"""


@dataclass(frozen=True)
class MotorGradientConfig:
    """Settings of the motor gradient."""

    weight: float = 0.15
    """weight of the gradient; 0 leaves PPO alone"""
    legs: float = 0.2
    """further factor on the leg joints, whose errors may serve balance"""
    steps: int = 4
    """control steps from an action to the joint error that it causes"""


@dataclass(frozen=True)
class ImaginationConfig:
    """Settings of learning by imagination."""

    model_updates: int = 8
    """updates of the model per iteration"""
    model_batch: int = 512
    """windows per update of the model"""
    window: int = 8
    """control steps that the model predicts autoregressively"""
    model_lr: float = 1e-3
    """Adam's learning rate for the model's last layer and biases"""
    muon_lr: float = 4e-3
    """Muon's learning rate for the model's other matrices"""
    policy_updates: int = 4
    """updates of the policy per iteration"""
    policy_batch: int = 512
    """imagined rollouts per update of the policy"""
    steps: int = 24
    """control steps of an imagined rollout"""
    recent: int = 200
    """imagined rollouts start in one of this many last control steps"""
    discount: float = 0.98
    """discount per imagined step"""
    effort: float = 0.01
    """weight of the squared action, or of an expert's squared residual"""
    rate: float = 0.02
    """weight of its squared change"""
    lr: float = 1e-3
    """Adam's learning rate for the policy"""
    grad_norm: float = 1.0
    """largest norm of the gradient, for model and policy each"""
    average: float = 0.99
    """decay of the moving average of the policy's weights, which is what is saved"""
    warmup: int = 40
    """warm-up iterations, in which only the model learns"""
    settle: int = 400
    """iterations before normalizers are frozen; those of a loaded model count"""
    constant: float = 0.5
    """fraction of the budget after which learning rates fall"""
    final_lr: float = 0.1
    """fraction of the learning rates that is left at the end of the budget"""
    precision: Precision = "auto"
    """precision of the networks' hidden layers"""
