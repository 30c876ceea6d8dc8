"""Stage 2: the student, with a privileged latent or without."""

from collections.abc import Sequence
from dataclasses import dataclass

from tensordict import NestedKey, TensorDictBase
from tensordict.nn import TensorDictSequential
from torch import nn

from plat.modules.backbone import Backbone
from plat.modules.decoder import ActionDecoder
from plat.modules.goal_encoder import GoalSequenceEncoder
from plat.modules.latent import LatentPosterior, LatentPrior, sample_latent
from plat.modules.normalizer import ObservationNormalizer
from plat.robots.robot import Robot
from plat.spec.observation import STUDENT_KEYS, goal_keys, observation_size, student_keys
from plat.spec.timing import Timing

__all__ = ["STUDENT_KEYS", "LatentPolicy", "LatentPolicyConfig", "PlainPolicy", "PlainPolicyConfig"]


@dataclass(frozen=True)
class PlainPolicyConfig:
    """Shape of the student without a latent."""

    backbone: tuple[int, ...] = (512,)
    """hidden layers of the backbone"""
    hidden_size: int = 256
    """size of h"""
    decoder: tuple[int, ...] = (256, 128)
    """hidden layers of the decoder"""
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


class LatentPolicy(nn.Module):
    """PLAT's stage-2 policy: backbone, prior, decoder; and posterior and goal encoder, which only training uses.

    Args:
        robot: the robot.
        config: sizes.

    >>> from plat.robots import G1
    >>> policy = LatentPolicy(G1)
    >>> all(key[0] in ("robot", "goal", "command") for key in policy.deployed().in_keys)
    True
    """

    def __init__(self, robot: Robot, config: LatentPolicyConfig | None = None):
        super().__init__()
        self.robot = robot
        self.config = config = config or LatentPolicyConfig()
        size, goal_size = observation_size(student_keys(), robot), observation_size(goal_keys(), robot)
        self.normalizer = ObservationNormalizer(student_keys(), size)
        self.backbone = Backbone(size, config.backbone, config.hidden_size)
        self.prior = LatentPrior(config.hidden_size, config.latent_size, config.prior)
        self.goal_normalizer = ObservationNormalizer(goal_keys(), goal_size)
        self.encoder = GoalSequenceEncoder(goal_size, config.encoder_size)
        self.posterior = LatentPosterior(config.hidden_size, config.encoder_size, config.latent_size, config.posterior)
        self.decoder = ActionDecoder(config.hidden_size, config.latent_size, robot.num_joints, config.decoder)

    @property
    def timing(self) -> Timing:
        """Time constants that the policy is trained with."""
        return self.config.timing

    def training_graph(self) -> TensorDictSequential:
        """Everything that the imitation loss asks for.

        Reads the student's observation and ``("privileged_goal", "frames")``, ``("privileged_goal", "length")``;
        writes ``loc``, ``scale``, ``latent`` and ``action`` in the groups ``"prior"`` and ``"posterior"``.
        """
        frames = ("privileged_goal", "frames")
        return TensorDictSequential(
            self.normalizer.using(),
            self.backbone,
            self.prior,
            self.goal_normalizer.using([frames], out_key=frames),
            self.encoder,
            self.posterior,
            sample_latent("prior"),
            sample_latent("posterior"),
            self.decoder.using("hidden", ("prior", "latent"), out_key=("prior", "action")),
            self.decoder.using("hidden", ("posterior", "latent"), out_key=("posterior", "action")),
        )

    def features(self, keys: Sequence[NestedKey] | None = None) -> TensorDictSequential:
        """The part below the decoder that is deployed: writes ``hidden``, ``("prior", "loc")`` and its scale.

        Args:
            keys: where the student's observation is; None for where :func:`plat.spec.observation.student_keys` says.
        """
        return TensorDictSequential(self.normalizer.using(keys), self.backbone, self.prior)

    def sampled(self) -> TensorDictSequential:
        """The policy that acts through a sample of the prior; its mean under deterministic exploration."""
        decode = self.decoder.using("hidden", ("prior", "latent"))
        return TensorDictSequential(self.features(), sample_latent("prior"), decode, selected_out_keys=["action"])

    def deployed(self) -> TensorDictSequential:
        """The policy that is shipped: ``a = pi(h, mu_p)``. It holds no privileged part."""
        decode = self.decoder.using("hidden", ("prior", "loc"))
        return TensorDictSequential(self.features(), decode, selected_out_keys=["action"])

    def update_normalizers(self, tensordict: TensorDictBase) -> None:
        """Take a batch of visited states into the statistics."""
        self.normalizer.update(tensordict)
        self.goal_normalizer.update(tensordict)


class PlainPolicy(nn.Module):
    """The ablation without a privileged latent: ``a = pi(B(o))``.

    Args:
        robot: the robot.
        config: sizes.
    """

    def __init__(self, robot: Robot, config: PlainPolicyConfig | None = None):
        super().__init__()
        self.robot = robot
        self.config = config = config or PlainPolicyConfig()
        size = observation_size(student_keys(), robot)
        self.normalizer = ObservationNormalizer(student_keys(), size)
        self.backbone = Backbone(size, config.backbone, config.hidden_size)
        self.decoder = ActionDecoder(config.hidden_size, 0, robot.num_joints, config.decoder)

    @property
    def timing(self) -> Timing:
        """Time constants that the policy is trained with."""
        return self.config.timing

    def deployed(self) -> TensorDictSequential:
        """The policy: the same in training and after."""
        parts = (self.normalizer.using(), self.backbone, self.decoder.using("hidden"))
        return TensorDictSequential(*parts, selected_out_keys=["action"])

    def training_graph(self) -> TensorDictSequential:
        """What the imitation loss asks for: writes the action to ``expert_action``, where the label is."""
        decode = self.decoder.using("hidden", out_key="expert_action")
        return TensorDictSequential(self.normalizer.using(), self.backbone, decode)

    def sampled(self) -> TensorDictSequential:
        """The policy that collects: there is nothing to sample."""
        return self.deployed()

    def update_normalizers(self, tensordict: TensorDictBase) -> None:
        """Take a batch of visited states into the statistics."""
        self.normalizer.update(tensordict)
