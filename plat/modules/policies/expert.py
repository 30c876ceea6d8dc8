"""Stage 1: the dense motion-tracking expert."""

import operator
from collections.abc import Sequence

import torch
from tensordict import NestedKey
from tensordict.nn import (
    ProbabilisticTensorDictSequential,
    TensorDictModule,
    TensorDictModuleBase,
    TensorDictSequential,
)
from torch import Tensor, nn
from torchrl.envs import Transform

from plat.envs.transforms.goals import DenseGoal
from plat.errors import ConfigError
from plat.modules.deployed import DeployedPolicy, timed
from plat.modules.heads import GaussianNoise, ReferenceOffset, gaussian_action
from plat.modules.lead import GoalLead, led
from plat.modules.networks import mlp
from plat.modules.normalizer import ObservationNormalizer
from plat.modules.settings import ExpertConfig
from plat.modules.symmetry import BothSides, MeanOfSides
from plat.modules.widening import check_parts, widened
from plat.motions.library import MotionLibrary
from plat.robots.robot import Robot
from plat.spec.observation import goal_keys, observation_size, observation_widths, robot_keys
from plat.spec.timing import Timing

__all__ = ["Expert", "ExpertConfig"]


class Expert(nn.Module):
    """Dense tracker ``a = pi_E(s_t, g_{t+1})``.

    Given a keyframe in place of the next reference frame, the same policy is the paper's Scratch RL baseline.

    Args:
        robot: the robot.
        config: what it sees, and sizes of the parts that are not given.
        network: from the normalized ``observation`` ``[*B, F]`` to the residual ``[*B, J]``, or to the action.
        noise: exploration noise, from ``loc`` to ``loc`` and ``scale``; None for one with a learned scale.

    Attributes:
        goals: the groups that hold the reference, and how many frames ahead each is; the first one is ``"goal"``.
        dense_goals: the same for labels in another task, where ``"goal"`` is a keyframe.

    Raises:
        ConfigError: when ``config`` asks for the reference's velocity, or for a lead along it, and sees one frame.

    >>> from plat.robots import G1
    >>> expert = Expert(G1, ExpertConfig(hidden=(32,)))
    >>> expert.deployed().out_keys
    ['action']
    """

    def __init__(
        self,
        robot: Robot,
        config: ExpertConfig | None = None,
        *,
        network: nn.Module | None = None,
        noise: TensorDictModule | None = None,
    ):
        super().__init__()
        self.robot = robot
        self.config = config = config or ExpertConfig()
        self.goals = {"goal" if number == 0 else f"goal_{ahead}": ahead for number, ahead in enumerate(config.ahead)}
        self.dense_goals = {f"dense_{group}": ahead for group, ahead in self.goals.items()}
        keys = self._keys(tuple(self.goals))
        widths = observation_widths(keys, robot)
        size = sum(widths)
        self.normalizer = ObservationNormalizer(keys, size, config.normalizer, widths)
        self.network = network or mlp(size, config.hidden, robot.num_joints, out_scale=0.1)
        self.noise = noise or GaussianNoise(robot.num_joints, config.init_std, config.min_std)

    @classmethod
    def build(cls, robot: Robot, config: ExpertConfig) -> "Expert":
        """Return the expert that a saved ``config`` describes. A subclass hands parts of its own over here."""
        return cls(robot, config)

    @property
    def timing(self) -> Timing:
        """Return the time constants that the policy is trained with."""
        return self.config.timing

    @staticmethod
    def _keys(goals: Sequence[str]) -> tuple[tuple[str, str], ...]:
        return sum((goal_keys(goal) for goal in goals), robot_keys())

    @property
    def _interval(self) -> float:
        """Time from the first frame that it sees to the second (s)."""
        first, second = (*self.config.ahead, self.config.ahead[0] + 1)[:2]
        return (second - first) * self.timing.control_dt

    def _observe(self, goals: Sequence[str]) -> list[TensorDictModule]:
        """Return what leads to the normalized observation. Its statistics are those of the goals as they are."""
        config, keys = self.config, self._keys(goals)
        before: list[TensorDictModule] = []
        shown: list[NestedKey] = list(keys)
        if config.lead or config.catch_up:
            before = [GoalLead(goals, config.lead, config.catch_up, self._interval, config.catch_up_limit)]
            shown = led(keys, before[0])
        if config.symmetric:
            before.append(BothSides(self.robot, keys, shown))
            shown = before[-1].out_keys
        return [*before, self.normalizer.using(shown)]

    def _mean(self, goals: Sequence[str], out_key: str) -> list[TensorDictModule]:
        """Return what leads from the normalized observation to the mean action."""
        if self.config.action == "default_offset":
            return self._output(out_key)
        in_keys: list[NestedKey] = ["residual", (goals[0], "joint_pos")]
        if self.config.action == "reference_velocity":
            in_keys.append((goals[1], "joint_pos"))
        offset = ReferenceOffset(self.robot, in_keys, out_key, self._interval, self.config.residual_limit)
        return [*self._output("residual"), offset]

    def _output(self, out_key: str) -> list[TensorDictModule]:
        """Return what leads from the normalized observation to what the network adds."""
        if not self.config.symmetric:
            return [TensorDictModule(self.network, in_keys=["observation"], out_keys=[out_key])]
        mean = MeanOfSides(self.robot, out_key=out_key)
        return [TensorDictModule(self.network, in_keys=["observation"], out_keys=mean.in_keys), mean]

    @torch.no_grad()
    def start_from(self, trained: "Expert") -> None:
        """Take over the weights of an expert with as many hidden layers, as wide or narrower, that sees these frames.

        It may see the first of these frames alone. The further ones count for nothing at first, and their statistics
        are those of the last frame that both see. At first this expert acts like the trained one, where the meaning of
        its actions and the settings beside layers and frames are the same.

        Raises:
            ConfigError: saying what differs.
        """
        check_parts(trained.robot, self.robot)
        frames, hidden = trained.config.ahead, trained.config.hidden
        narrower = len(hidden) == len(self.config.hidden) and all(map(operator.le, hidden, self.config.hidden))
        if self.config.ahead[: len(frames)] != frames or not narrower:
            raise ConfigError(
                f"it sees frames {frames} with hidden layers {hidden}; an expert that goes on from it has as many "
                f"layers, as wide or wider, and sees these frames first, not {self.config.ahead} with "
                f"{self.config.hidden}"
            )
        weights = trained.state_dict()
        if further := len(self.config.ahead) - len(frames):
            self._see_more(weights, further)
        self.load_state_dict({name: widened(name, weights[name], ours) for name, ours in self.state_dict().items()})

    def _see_more(self, weights: dict[str, Tensor], further: int) -> None:
        """Widen a trained expert's first layer and normalizer by further frames."""
        frame_size = observation_size(goal_keys(), self.robot)
        first_layer = weights.get("network.0.weight", torch.empty(0))
        if first_layer.shape[1:] != weights["normalizer.mean"].shape:
            raise ConfigError("its network is its own: expected the same frames")
        new = first_layer.new_zeros(len(first_layer), further * frame_size)
        weights["network.0.weight"] = torch.cat((first_layer, new), 1)
        for name in ("normalizer.mean", "normalizer.var"):
            weights[name] = torch.cat((weights[name], weights[name][-frame_size:].repeat(further)))

    stateful = False

    def references(self, library: MotionLibrary) -> list[Transform]:
        """Return the transforms that show it its reference in :attr:`dense_goals`, beside a student's keyframe.

        Args:
            library: motions of the environment, on its device.
        """
        return DenseGoal.of_groups(library, self.dense_goals)

    def labels(self) -> TensorDictModuleBase:
        """Return the module that writes its action to ``expert_action``, see :class:`plat.modules.Teacher`."""
        return self.deployed(tuple(self.dense_goals), out_key="expert_action")

    def head(self) -> ProbabilisticTensorDictSequential:
        """Return the part that learns, for PPO: reads the normalized observation that :meth:`actor` wrote."""
        return ProbabilisticTensorDictSequential(*self._mean(tuple(self.goals), "loc"), self.noise, gaussian_action())

    def actor(self) -> TensorDictSequential:
        """Return the stochastic policy that collects; the rollout holds all that :meth:`head` reads."""
        kept = ["observation", "loc", "scale", "action", "action_log_prob"]
        actor = TensorDictSequential(*self._observe(tuple(self.goals)), self.head(), selected_out_keys=kept)
        return timed(actor, self.timing)

    def deployed(self, goal: str | Sequence[str] = "goal", out_key: str = "action") -> DeployedPolicy:
        """Return the deterministic policy: writes its mean action to ``out_key``.

        Args:
            goal: the group that holds the goal: ``"goal"``, or ``"dense_goal"`` to label states of another task. For
                an expert that sees several frames it stands in the place of each, as a keyframe does; the names in
                ``goals`` give it the reference.
            out_key: where the action goes.
        """
        goals = [goal] * len(self.goals) if isinstance(goal, str) else list(goal)
        return DeployedPolicy(*self._observe(goals), *self._mean(goals, out_key), timing=self.timing, out_key=out_key)
