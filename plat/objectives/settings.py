"""Hyperparameters, apart from the updates so that a command line can show them without torch."""

from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple, TypeAlias

from plat.bounds import Bounded, Count, Fraction, Layers, Natural, NonNegative, Positive, Range
from plat.errors import ConfigError
from plat.precision import Precision

__all__ = ["ImaginationConfig", "MotorGradientConfig", "PPOConfig", "Rates"]

Steps: TypeAlias = Annotated[int, Range(1, 1000)]
"""Control steps of a rollout of the model."""


@dataclass(frozen=True)
class PPOConfig(Bounded):
    """Hyperparameters of PPO. Defaults are those of rsl_rl for whole-body tracking unless stated otherwise."""

    gamma: Fraction = 0.99
    """discount per control step"""
    lmbda: Fraction = 0.95
    """lambda of GAE: trades bias against variance"""
    clip: Positive = 0.2
    """clipping range of the probability ratio"""
    epochs: Count = 5
    """epochs over a rollout"""
    minibatches: Count = 4
    """minibatches per epoch"""
    entropy: NonNegative = 0.005
    """weight of the entropy bonus"""
    grad_norm: Positive = 1.0
    """largest norm of the gradient, for policy and critic each"""
    lr: Positive = 1e-3
    """learning rate of the policy at the start"""
    min_lr: Positive = 3e-4
    """lower end of the adaptive learning rate; without it one bad batch stops learning for good"""
    max_lr: Positive = 1e-2
    """upper end"""
    critic_lr: Positive = 1e-3
    """fixed learning rate of the critic, independent of the policy's adaptive one"""
    precision: Precision = "auto"
    """precision of the networks' hidden layers in updates"""
    truncated: Literal["state", "mean"] = "state"
    """bootstrap value at truncation: of the last state, or the mean of the rollout"""
    target_kl: Positive = 0.02
    """KL divergence (nats) the adaptive rate aims at; plat's first value, rsl_rl has 0.01"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.min_lr > self.max_lr:
            raise ConfigError(f"PPOConfig: min_lr is {self.min_lr:g}, expected at most max_lr, {self.max_lr:g}")

    def batch_size(self, states: int) -> int:
        """Return the number of states in a minibatch of a rollout.

        Raises:
            ConfigError: when there are fewer states than minibatches.
        """
        if states < self.minibatches:
            raise ConfigError(
                f"PPOConfig: minibatches is {self.minibatches}, expected at most the {states} states of a rollout"
            )
        return states // self.minibatches


@dataclass(frozen=True)
class MotorGradientConfig(Bounded):
    """Settings of the motor gradient."""

    weight: NonNegative = 0.15
    """weight of the gradient; 0 leaves PPO alone"""
    legs: NonNegative = 0.2
    """further factor on the leg joints, whose errors may serve balance"""
    steps: Count = 4
    """control steps from an action to the joint error that it causes"""


class Rates(NamedTuple):
    """Learning rates and warm-up, as :class:`ImaginationConfig` explains them."""

    lr: float
    policy_muon: float
    muon_lr: float
    warmup: int


@dataclass(frozen=True)
class ImaginationConfig(Bounded):
    """Settings of learning by imagination."""

    model_updates: Count = 8
    """updates of the model per iteration"""
    model_batch: Count = 512
    """windows per update of the model"""
    window: Steps = 8
    """control steps that the model predicts autoregressively"""
    model_lr: Positive = 1e-3
    """Adam's learning rate for the model's last layer and biases"""
    muon_lr: Positive | None = None
    """Muon's learning rate for its other matrices; None for 0.015, of a trained model 0.004"""
    policy_updates: Count = 4
    """updates of the policy per iteration"""
    policy_batch: Count = 512
    """imagined rollouts per update of the policy"""
    steps: Steps = 24
    """control steps of an imagined rollout"""
    recent: Count = 200
    """imagined rollouts start in one of the last this many control steps"""
    discount: Fraction = 0.98
    """discount per imagined step"""
    critic: Layers = ()
    """hidden layers of a critic for the cost after the imagined steps; none: no critic"""
    lost_cost: NonNegative = 3.0
    """cost of a step of a lost robot, to the critic"""
    effort: NonNegative = 0.01
    """weight of the squared action, or of an expert's squared residual"""
    rate: NonNegative = 0.02
    """weight of its squared change"""
    lr: Positive | None = None
    """Adam's learning rate for policy and critic; None for 0.002, of a trained policy 0.001"""
    policy_muon: NonNegative | None = None
    """Muon's rate for its hidden matrices, in Adam's; None for 10, of a trained policy 0 (Adam)"""
    grad_norm: Positive = 1.0
    """largest norm of the gradient, for model and policy each"""
    average: Annotated[float, Range(0, 1, below=True)] = 0.99  # 1 would save the weights of the start
    """decay of the moving average of the policy's weights, which is saved; less at first"""
    warmup: Natural | None = None
    """warm-up iterations, in which only the model learns; None for 20, of a trained model 8"""
    settle: Natural = 400
    """iterations before normalizers are frozen; those of a loaded model count"""
    constant: Fraction = 0.5
    """fraction of the budget after which learning rates fall"""
    final_lr: Fraction = 0.1
    """fraction of the learning rates that is left at the end of the budget"""
    precision: Precision = "auto"
    """precision of the networks' hidden layers"""

    def rates(self, *, model: bool = False, policy: bool = False) -> Rates:
        """Return the rates and the warm-up: those that are given, and for None what suits a new model and policy.

        Args:
            model: the model is trained already.
            policy: the policy is.

        >>> ImaginationConfig(lr=5e-4).rates(model=True)
        Rates(lr=0.0005, policy_muon=10.0, muon_lr=0.004, warmup=8)
        """
        # a trained model knows the robot, and needs to see only what the new task brings
        usual = Rates(
            lr=1e-3 if policy else 2e-3,
            policy_muon=0.0 if policy else 10.0,
            muon_lr=4e-3 if model else 1.5e-2,
            warmup=8 if model else 20,
        )
        given = {name: getattr(self, name) for name in Rates._fields if getattr(self, name) is not None}
        return usual._replace(**given)
