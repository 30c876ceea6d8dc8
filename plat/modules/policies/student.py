"""Students of stage 2: behavior cloning with a privileged latent, or without."""

from collections.abc import Callable, Sequence

import torch
from tensordict import NestedKey, TensorDictBase
from tensordict.nn import TensorDictModule, TensorDictModuleBase, TensorDictSequential
from torch import Tensor, nn

from plat.bounds import Fraction, check_value
from plat.modules.backbone import Backbone
from plat.modules.decoder import ActionDecoder
from plat.modules.deployed import DeployedPolicy, timed
from plat.modules.goal_encoder import GoalSequenceEncoder
from plat.modules.keyframe_reach import KeyframeReach
from plat.modules.latent import LatentPosterior, LatentPrior, sample_latent
from plat.modules.lead import led
from plat.modules.normalizer import ObservationNormalizer
from plat.modules.settings import LatentPolicyConfig, PlainPolicyConfig
from plat.modules.symmetry import BothSides, MeanOfSides
from plat.robots.robot import Robot
from plat.spec.observation import STUDENT_KEYS, goal_keys, observation_size, observation_widths, student_keys, table
from plat.spec.timing import Timing

__all__ = ["STUDENT_KEYS", "LatentPolicy", "LatentPolicyConfig", "PlainPolicy", "PlainPolicyConfig"]

Shown = tuple[list[TensorDictModuleBase], list[NestedKey]]
"""What comes before a student, and where its observation then is."""


class LatentPolicy(nn.Module):
    """PLAT's student: backbone, prior and decoder, and for training a posterior over a privileged goal encoder.

    The parts are TensorDict modules that meet in entries. A part that is not given is built from ``config``.

    Args:
        robot: the robot.
        config: timing, and sizes of the parts that are not given.
        normalizer: normalizes the student's observation.
        backbone: from ``observation`` to ``hidden``.
        prior: from ``hidden`` to the parameters of the prior, in the group ``"prior"``.
        goal_normalizer: normalizes the frames of the privileged goal sequence.
        encoder: from ``("privileged_goal", "normalized")`` ``[B, L, F]`` and ``("privileged_goal", "length")`` ``[B]``
            to ``goal_code``.
        posterior: from ``hidden`` and ``goal_code`` to the parameters of the posterior, in the group ``"posterior"``.
        decoder: from ``hidden`` and a latent to the action.
        sample: returns for a group the module that draws ``(group, "latent")``.
        mode: entry of the prior that is decoded when the policy acts deterministically.

    >>> from plat.robots import G1
    >>> policy = LatentPolicy(G1)
    >>> all(key[0] in ("robot", "goal", "command") for key in policy.deployed().in_keys)
    True

    With a wider prior; to be saved by a run, that is a subclass (``examples/registered_policy.py``):

    >>> policy = LatentPolicy(G1, prior=LatentPrior(256, 32, hidden=(512, 512)))
    >>> policy.features().out_keys[-1]
    ('prior', 'scale')
    """

    def __init__(
        self,
        robot: Robot,
        config: LatentPolicyConfig | None = None,
        *,
        normalizer: ObservationNormalizer | None = None,
        backbone: TensorDictModuleBase | None = None,
        prior: TensorDictModuleBase | None = None,
        goal_normalizer: ObservationNormalizer | None = None,
        encoder: TensorDictModuleBase | None = None,
        posterior: TensorDictModuleBase | None = None,
        decoder: ActionDecoder | None = None,
        sample: Callable[[str], TensorDictModuleBase] = sample_latent,
        mode: NestedKey = ("prior", "loc"),
    ):
        super().__init__()
        self.robot = robot
        self.config = config = config or LatentPolicyConfig()
        self.mode = mode
        self._sample = sample
        hidden, code, latent = config.hidden_size, config.encoder_size, config.latent_size
        goal_size = observation_size(goal_keys(), robot)
        self.normalizer = normalizer or _observation_normalizer(robot, config)
        self.backbone = backbone or _backbone(robot, config)
        self.prior = prior or LatentPrior(hidden, latent, config.prior, min_std=config.min_std)
        self.goal_normalizer = goal_normalizer or ObservationNormalizer(
            goal_keys(), goal_size, config.normalizer, observation_widths(goal_keys(), robot)
        )
        self.encoder = encoder or GoalSequenceEncoder(goal_size, code)
        self.posterior = posterior or LatentPosterior(hidden, code, latent, config.posterior, min_std=config.min_std)
        self.decoder = decoder or ActionDecoder(hidden, latent, robot.num_joints, config.decoder)

    @classmethod
    def build(cls, robot: Robot, config: LatentPolicyConfig) -> "LatentPolicy":
        """Return the policy that a saved ``config`` describes.

        A subclass with parts of its own hands them over here, so that runs can be loaded.
        """
        return cls(robot, config)

    @property
    def timing(self) -> Timing:
        """Return the time constants that the policy is trained with."""
        return self.config.timing

    def training_graph(self) -> TensorDictSequential:
        """Return everything that the imitation loss asks for.

        Reads the student's observation and ``("privileged_goal", "frames")``, ``("privileged_goal", "length")``;
        writes the parameters, ``latent`` and ``action`` in the groups ``"prior"`` and ``"posterior"``.
        """
        normalize_goals = self.goal_normalizer.using(
            [("privileged_goal", "frames")], out_key=("privileged_goal", "normalized")
        )
        return TensorDictSequential(
            *self.features(),
            normalize_goals,
            self.encoder,
            self.posterior,
            self._sample("prior"),
            self._sample("posterior"),
            self.decoder.using("hidden", ("prior", "latent"), out_key=("prior", "action")),
            self.decoder.using("hidden", ("posterior", "latent"), out_key=("posterior", "action")),
        )

    def imagined(self, share: float = 0.5) -> TensorDictSequential:
        """Return the policy for learning by imagination, which acts through samples of both latents.

        Reads what :meth:`training_graph` reads; writes ``action`` and what prior and posterior write.

        Args:
            share: of the robots, the first ones of a batch, that act through the posterior; the others act through
                the prior.
        """
        check_value("imagined: share", share, Fraction)
        graph = self.training_graph()
        mixed = TensorDictModule(
            _Mixed(share), in_keys=[("posterior", "latent"), ("prior", "latent")], out_keys=["latent"]
        )
        decode = self.decoder.using("hidden", "latent")
        kept = ["action", *self.posterior.out_keys, *self.prior.out_keys]
        return timed(TensorDictSequential(*graph[:-2], mixed, decode, selected_out_keys=kept), self.timing)

    def features(self, keys: Sequence[NestedKey] | None = None) -> TensorDictSequential:
        """Return the deployed part below the decoder: writes ``hidden`` and the parameters of the prior.

        Args:
            keys: where the student's observation is, moved as :meth:`shown` says; None for where
                :func:`plat.spec.observation.student_keys` says.
        """
        before, own = self.shown() if keys is None else ([], keys)
        return TensorDictSequential(*before, self.normalizer.using(own), self.backbone, self.prior)

    def shown(self) -> Shown:
        """Return what moves the keyframe before the student sees it, and where its observation then is."""
        return _shown(self.config)

    def sampled(self) -> TensorDictSequential:
        """Return the policy that acts through a sample of the prior; its mode under deterministic exploration."""
        decode = self.decoder.using("hidden", ("prior", "latent"))
        sampled = TensorDictSequential(self.features(), self._sample("prior"), decode, selected_out_keys=["action"])
        return timed(sampled, self.timing)

    def deployed(self) -> DeployedPolicy:
        """Return the deterministic policy ``a = pi(h, mu_p)``, of both sides if it is symmetric.

        It holds no privileged part.
        """
        before, keys, after = on_both_sides(self.robot, self.config, self.shown())
        decode = self.decoder.using("hidden", self.mode)
        return DeployedPolicy(*before, self.features(keys), decode, *after, timing=self.timing)

    def update_normalizers(self, tensordict: TensorDictBase) -> None:
        """Take a batch of visited states into the statistics.

        Those of the goal sequence are of whole keyframes, as its frames are, where the batch has any.
        """
        self.normalizer.update(tensordict)
        if "parts" in self.config.also:  # zeros of what a keyframe leaves open are no goals
            commanded = torch.cat([tensordict.get(key) for key in table().keys("parts")], -1)
            whole = (commanded > 0).all(-1)
            tensordict = tensordict.select(*goal_keys())
            tensordict = tensordict[whole] if whole.any() else tensordict
        self.goal_normalizer.update(tensordict)


class PlainPolicy(nn.Module):
    """Student without a latent, the ablation: ``a = pi(B(o))``.

    Args:
        robot: the robot.
        config: timing, and sizes of the parts that are not given.
        normalizer: normalizes the student's observation.
        backbone: from ``observation`` to ``hidden``.
        decoder: from ``hidden`` to the action.

    >>> from plat.robots import G1
    >>> PlainPolicy(G1).training_graph().out_keys[-1]
    'action'
    """

    def __init__(
        self,
        robot: Robot,
        config: PlainPolicyConfig | None = None,
        *,
        normalizer: ObservationNormalizer | None = None,
        backbone: TensorDictModuleBase | None = None,
        decoder: ActionDecoder | None = None,
    ):
        super().__init__()
        self.robot = robot
        self.config = config = config or PlainPolicyConfig()
        self.normalizer = normalizer or _observation_normalizer(robot, config)
        self.backbone = backbone or _backbone(robot, config)
        self.decoder = decoder or ActionDecoder(config.hidden_size, 0, robot.num_joints, config.decoder)

    @classmethod
    def build(cls, robot: Robot, config: PlainPolicyConfig) -> "PlainPolicy":
        """Return the policy that a saved ``config`` describes."""
        return cls(robot, config)

    @property
    def timing(self) -> Timing:
        """Return the time constants that the policy is trained with."""
        return self.config.timing

    def deployed(self) -> DeployedPolicy:
        """Return the deterministic policy."""
        return DeployedPolicy(*self.training_graph(), timing=self.timing)

    def training_graph(self) -> TensorDictSequential:
        """Return everything that the imitation loss asks for: writes ``action``."""
        before, keys, after = on_both_sides(self.robot, self.config, _shown(self.config))
        decode = self.decoder.using("hidden")
        return TensorDictSequential(*before, self.normalizer.using(keys), self.backbone, decode, *after)

    def sampled(self) -> TensorDictSequential:
        """Return the policy that collects: there is nothing to sample."""
        return self.deployed()

    def update_normalizers(self, tensordict: TensorDictBase) -> None:
        """Take a batch of visited states into the statistics."""
        self.normalizer.update(tensordict)


def on_both_sides(
    robot: Robot, config: PlainPolicyConfig, shown: Shown
) -> tuple[list[TensorDictModuleBase], list[NestedKey], list[TensorDictModuleBase]]:
    """Return what comes before a student, where its observation then is, and what follows its action.

    Args:
        robot: the robot.
        config: of the student; nothing is added to one that is not symmetric.
        shown: the first two for a student that answers one side.
    """
    before, keys = shown
    if not config.symmetric:
        return before, keys, []
    both = BothSides(robot, student_keys(config.also), keys)
    return [*before, both], list(both.out_keys), [MeanOfSides(robot, in_key="action")]


class _Mixed(nn.Module):
    """Takes the first share of the rows ``[B, n]`` from the first argument, the others from the second."""

    def __init__(self, share: float):
        super().__init__()
        self.share = share

    def forward(self, first: Tensor, second: Tensor) -> Tensor:
        count = round(self.share * len(first))
        return torch.cat((first[:count], second[count:]))


def _shown(config: PlainPolicyConfig) -> Shown:
    """What moves the keyframe before a student sees it, and where the student then finds its observation."""
    keys = list(student_keys(config.also))
    if config.reach is None:
        return [], keys
    reach = KeyframeReach(config.reach, config.timing.longest, parts="parts" in config.also)
    return [reach], led(keys, reach)


def _observation_normalizer(robot: Robot, config: PlainPolicyConfig) -> ObservationNormalizer:
    keys = student_keys(config.also)
    widths = observation_widths(keys, robot)
    return ObservationNormalizer(keys, sum(widths), config.normalizer, widths)


def _backbone(robot: Robot, config: PlainPolicyConfig) -> Backbone:
    return Backbone(observation_size(student_keys(config.also), robot), config.backbone, config.hidden_size)
