"""Settings of the recipes, apart from what runs so that help texts need no torch."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

from plat.bounds import Bounded, Count, Fraction, Layers, Natural, NonNegative, NotEmpty, Positive, Range, Robots, Seed
from plat.cli.options import ScoringConfig
from plat.envs import DistillationTaskConfig, KeyframeTaskConfig, TrackingTaskConfig
from plat.errors import ConfigError
from plat.modules import DynamicsConfig, ExpertConfig, LatentPolicyConfig, PlainPolicyConfig, RefinementConfig
from plat.objectives import ImaginationConfig, MotorGradientConfig, PPOConfig
from plat.objectives.settings import Rates
from plat.precision import Precision
from plat.recipes.presets import BEST, PRESETS
from plat.runs import RecipeConfig
from plat.spec.timing import Timing
from plat.tasks import TimedKeyframesConfig, TrackingCosts

__all__ = [
    "AblationsRecipe",
    "DemoRecipe",
    "DistillRecipe",
    "ExpertModelRecipe",
    "ExpertRecipe",
    "ImaginationRecipe",
    "ImagineRecipe",
    "RefineModelRecipe",
    "RefineRecipe",
    "Training",
    "check_distant",
    "check_partial",
]

Rollout: TypeAlias = Annotated[int, Range(1, 4096)]
"""Control steps of a rollout."""
Share: TypeAlias = Annotated[float, Range(0, 1, above=True)]
"""Share of the budget."""


def check_motor(recipe: "ExpertRecipe | RefineRecipe", motor: MotorGradientConfig) -> None:
    """Raise an error for a motor gradient over more steps than a rollout has: it would be 0."""
    if motor.weight and motor.steps >= recipe.rollout:
        raise ConfigError(
            f"{type(recipe).__name__}: motor.steps is {motor.steps}, expected less than {recipe.rollout}, the rollout; "
            "a weight of 0 switches it off"
        )


def check_motor_idle(recipe: "ExpertRecipe | RefineRecipe") -> None:
    """Raise an error for settings of a motor gradient whose weight is 0."""
    if not recipe.motor.weight:
        check_idle(recipe, "motor", ("legs", "steps"), "and motor.weight is 0, which switches it off")


def check_reference(recipe: "ExpertRecipe | ExpertModelRecipe") -> None:
    """Raise an error for settings of an expert that its other settings leave without effect."""
    if not recipe.policy.catch_up:
        check_idle(recipe, "policy", ("catch_up_limit",), "without policy.catch_up nothing is limited")
    if recipe.policy.action == "default_offset":
        told = "and policy.action 'default_offset' adds nothing to the reference"
        check_idle(recipe, "policy", ("residual_limit",), told)


def check_refinement(recipe: "RefineRecipe | RefineModelRecipe") -> None:
    """Raise an error for settings of a refinement that its other settings leave without effect."""
    if not recipe.policy.lead:
        check_idle(recipe, "policy", ("shortest_lead",), "without policy.lead nothing is shifted")


def check_minibatches(recipe: "ExpertRecipe | RefineRecipe", ppo: PPOConfig) -> None:
    """Raise an error for more minibatches than a rollout has states."""
    states = recipe.num_envs * recipe.rollout
    if ppo.minibatches > states:
        raise ConfigError(
            f"{type(recipe).__name__}: ppo.minibatches is {ppo.minibatches}, expected at most {states:,}, "
            "the states of a rollout (num_envs times rollout)"
        )


_OF_LATENT = [each.name for each in fields(LatentPolicyConfig)][len(fields(PlainPolicyConfig)) :]
_NO_LATENT = "and a plain student has no latent: set --student latent"


def check_idle(recipe: RecipeConfig, group: str, names: Sequence[str], told: str) -> None:
    """Raise an error for settings that were given and have no effect. Runs that were begun with them can be resumed.

    Args:
        recipe: of the run.
        group: of the settings, such as ``"policy"`` or ``"task.tracking"``; ``""`` for those of the recipe.
        names: of the settings.
        told: ends the message.
    """
    settings = attrgetter(group)(recipe) if group else recipe
    for name in () if recipe.resume else names:
        value = getattr(settings, name)
        if value != getattr(type(settings), name):
            raise ConfigError(f"{type(recipe).__name__}: {f'{group}.' * bool(group)}{name} is {value}, {told}")


@dataclass(kw_only=True)
class ExpertRecipe(RecipeConfig):
    """Train a dense motion-tracking expert."""

    name = "expert"
    presets = {name: preset["expert"] for name, preset in PRESETS.items()}

    init: Path | None = None
    """run whose expert to start from, in its shape or in the larger one of --policy"""
    init_lr: Positive = 3e-5
    """with --init: upper bound on the initial and the minimum learning rate"""
    rollout: Rollout = 24
    """control steps of each robot between updates"""
    critic_warmup: Natural = 10
    """with --init: rollouts that train only the critic, before the policy is updated"""
    critic: Layers = (512, 256, 128)
    """hidden layers of the critic"""
    policy: ExpertConfig = BEST["expert"]["policy"]
    task: TrackingTaskConfig = BEST["expert"]["task"]
    ppo: PPOConfig = field(default_factory=PPOConfig)
    motor: MotorGradientConfig = field(default_factory=MotorGradientConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.init:
            check_idle(self, "", ("init_lr", "critic_warmup"), "and without --init nothing is trained already")
        check_reference(self)
        check_motor_idle(self)
        check_minibatches(self, self.ppo)
        if self.motor.weight and self.motor.steps < self.policy.ahead[0]:
            raise ConfigError(
                f"ExpertRecipe: motor.steps is {self.motor.steps}, expected from {self.policy.ahead[0]}, the "
                f"first of policy.ahead, to less than {self.rollout}, the rollout; a weight of 0 switches it off"
            )
        check_motor(self, self.motor)


@dataclass(kw_only=True)
class DistillRecipe(RecipeConfig):
    """Teach a student by DAgger with a privileged latent."""

    name = "distill"

    expert: Path
    """run of stage 1, or of another teacher"""
    student: Literal["latent", "plain"] = "latent"
    """with the privileged latent, or the ablation without"""
    init: Path | None = None
    """run whose student to start from, in its shape or in the larger one of --policy"""
    policy: LatentPolicyConfig = field(default_factory=LatentPolicyConfig)
    task: DistillationTaskConfig = field(default_factory=DistillationTaskConfig)
    horizon: Literal["single", "short", "medium", "long", "mixed", "distant", "all"] = "mixed"
    """lengths of the commands; "all" that the timing allows"""
    rollout: Rollout = 8
    """control steps of each robot between updates"""
    updates: Count = 8
    """gradient steps after each rollout"""
    batch_size: Count = 2048
    """states a gradient step"""
    buffer_size: Count = 200_000
    """states in the replay buffer"""
    save_buffer: bool = True
    """keep these states in checkpoints; otherwise a resumed run collects new ones and differs"""
    stride: Count = 5
    """keep every n-th frame of the privileged goal sequence"""
    prior_weight: NonNegative = 1.0
    """lambda_p: weight of imitation through the prior"""
    beta: NonNegative = 0.01
    """weight of the divergence"""
    beta_warmup: Share = 0.2
    """share of the budget over which beta rises from 0"""
    free_bits: NonNegative = 0.0
    """divergence of each latent dimension that is free (nats)"""
    expert_share: Fraction = 0.5
    """share of the steps in which the expert acts, at the start"""
    expert_until: Share = 0.2
    """share of the budget over which that falls to 0"""
    lr: Positive = 1e-3
    """learning rate at the start; it falls to a tenth along a cosine"""
    grad_norm: Positive = 5.0
    """gradients are scaled down to this norm"""
    precision: Precision = "auto"
    """precision of the networks' hidden layers"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.buffer_size < self.batch_size:
            raise ConfigError(
                f"DistillRecipe: buffer_size is {self.buffer_size}, expected at least batch_size, {self.batch_size}"
            )
        if not self.beta:
            check_idle(self, "", ("beta_warmup", "free_bits"), "and beta is 0: no divergence counts")
        if not self.expert_share:
            check_idle(self, "", ("expert_until",), "and expert_share is 0: the expert takes no step")
        if self.student == "plain":
            check_idle(self, "", ("stride", "prior_weight", "beta", "beta_warmup", "free_bits"), _NO_LATENT)
            check_idle(self, "policy", _OF_LATENT, _NO_LATENT)


@dataclass(kw_only=True)
class RefineRecipe(RecipeConfig):
    """Refine a student with PPO."""

    name = "refine"
    presets = {name: preset["refine"] for name, preset in PRESETS.items()}

    student: Path
    """run to start from: of stage 2, or of its student fine-tuned"""
    variant: Literal["latent", "latent-noise", "action", "finetune"] = "latent"
    """latent: PLAT; latent-noise: exploration in the latent; action, finetune: ablations"""
    policy: RefinementConfig = BEST["refine"]["policy"]
    task: KeyframeTaskConfig = BEST["refine"]["task"]
    ppo: PPOConfig = BEST["refine"]["ppo"]
    motor: MotorGradientConfig = field(default_factory=MotorGradientConfig)
    horizon: Literal["single", "short", "medium", "long", "mixed", "distant", "all"] = "mixed"
    """lengths of the commands; "all" that the timing allows"""
    rollout: Rollout = 24
    """control steps of each robot between updates"""
    critic: Layers = (512, 256, 128)
    """hidden layers of the critic"""
    critic_warmup: Natural = 10
    """rollouts that train only the critic, before the policy is updated"""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_minibatches(self, self.ppo)
        check_refinement(self)
        check_motor_idle(self)
        if self.variant != "latent-noise":
            check_motor(self, self.motor)
        elif self.motor.weight:
            names = [each.name for each in fields(MotorGradientConfig)]
            check_idle(self, "motor", names, "and the gradient is of actions: --variant latent-noise samples latents")


@dataclass(kw_only=True)
class ImaginationRecipe(RecipeConfig):
    """What both recipes of imagination have."""

    init_model: Path | None = None
    """run whose model of the robot to start from"""
    rollout: Rollout = 8
    """control steps of each robot between updates"""
    noise: NonNegative = 0.25
    """standard deviation of the exploration noise, in units of action"""
    replay: Count = 600
    """control steps of each robot in the replay buffer"""
    save_replay: bool = True
    """keep these steps in checkpoints; otherwise a resumed run collects new ones and differs"""
    overlap: bool = False
    """simulate, and learn the model, in processes beside the policy's (on a CPU)"""
    disturbed: Fraction = 0.0
    """strength of randomized physics, delays, pushes, noise, estimator errors; 1 for all of it"""
    unseen: tuple[str, ...] = ("generated:val@120",)
    """motions on which the model's error is reported"""
    model: DynamicsConfig = field(default_factory=DynamicsConfig)
    imagination: ImaginationConfig = field(default_factory=ImaginationConfig)

    def goes_on(self) -> bool:
        """Whether it goes on from a policy that is trained already."""
        return getattr(self, "init", None) is not None

    def with_rates(self, saved: Mapping[str, Any] | None = None) -> ImaginationConfig:
        """Return the settings of learning with all their rates, which depend on what is trained already.

        Args:
            saved: settings of the run that is resumed, whose rates are those that are not given; None for a new run.
        """
        before = {} if saved is None else self.as_written_now(saved).get("imagination")
        rates = self._rates_of(before if isinstance(before, Mapping) else {})
        given = {name: value for name in Rates._fields if (value := getattr(self.imagination, name)) is not None}
        return replace(self.imagination, **rates._asdict() | given)

    def as_written_now(self, saved: Mapping[str, Any]) -> dict[str, Any]:
        """Return the settings of a run with the rates that it learned with: an older plat did not write them so."""
        was = saved.get("imagination")
        if not isinstance(was, Mapping):
            return dict(saved)
        others: dict[str, Any] = {}  # than what was used, where something was trained already
        if "policy_muon" not in was:
            was = {**was, "policy_muon": 0.0}
            others = {"warmup": 40} if self.init_model else {}
        elif "overlap" not in saved:
            others = {"lr": 2e-3, "policy_muon": 10.0, "muon_lr": 1.5e-2, "warmup": 20}
        used = {name: value for name, value in was.items() if value != others.get(name)}
        return {**saved, "imagination": {**was, **self._rates_of(used)._asdict()}}

    def _rates_of(self, settings: Mapping[str, Any]) -> Rates:
        """Return all rates, of which some are among settings of learning."""
        given = {name: settings[name] for name in Rates._fields if name in settings}
        return ImaginationConfig(**given).rates(model=self.init_model is not None, policy=self.goes_on())

    @property
    def kept_steps(self) -> int:
        """Return the control steps of each robot that the replay buffer holds: whole rollouts, at least ``replay``."""
        return -(-self.replay // self.rollout) * self.rollout

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.overlap and self.physics == "warp":
            what = f"{type(self).__name__}: overlap is True, and physics 'warp' is on one device"
            raise ConfigError(f"{what}: expected overlap to be False")
        settings = self.imagination
        kept = self.kept_steps
        if settings.window >= kept:  # a window begins with a state more
            what = f"{type(self).__name__}: imagination.window is {settings.window}"
            raise ConfigError(f"{what}, expected less than the {kept} steps of replay")
        if not settings.critic:
            check_idle(self, "imagination", ("lost_cost",), "without imagination.critic nobody is told of it")
        if settings.constant == 1:
            check_idle(self, "imagination", ("final_lr",), "and imagination.constant is 1: learning rates never fall")
        if settings.final_lr == 1:
            check_idle(self, "imagination", ("constant",), "and imagination.final_lr is 1: learning rates never fall")


@dataclass(kw_only=True)
class ExpertModelRecipe(ImaginationRecipe):
    """Learn a model of the robot, and a dense motion-tracking expert by imagined rollouts of it."""

    name = "expert-model"

    init: Path | None = None
    """run whose expert to start from, in its shape or in the larger one of --policy"""
    policy: ExpertConfig = ExpertConfig(action="reference_velocity", ahead=(1, 2, 5, 10))
    costs: TrackingCosts = TrackingCosts()
    """weights of the distances from the reference"""
    uniform_starts: Fraction = 0.3
    """share of the episodes that start anywhere; the others start where failures are"""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_reference(self)
        self.costs.check_dense(f"{type(self).__name__}: costs")


@dataclass(kw_only=True)
class ImagineRecipe(ImaginationRecipe):
    """Learn a keyframe policy by imagined rollouts of a learned model of the robot, without an expert."""

    name = "imagine"

    student: Literal["plain", "latent"] = "plain"
    """without a latent, or through the prior's mean"""
    init: Path | None = None
    """run whose student to start from, in its shape or in the larger one of --policy"""
    posterior: Fraction = 0.0
    """share of the imagined robots that act through the privileged posterior (--student latent)"""
    beta: NonNegative = 0.002
    """weight of the divergence of that posterior from the prior"""
    policy: LatentPolicyConfig = field(default_factory=LatentPolicyConfig)
    task: TimedKeyframesConfig = field(default_factory=TimedKeyframesConfig)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.posterior and self.student != "latent":
            raise ConfigError(
                f"ImagineRecipe: posterior is {self.posterior:g}, and a plain student has none: set --student latent"
            )
        if not self.posterior:
            check_idle(self, "", ("beta",), "without --posterior there is no divergence")
            check_idle(self, "task", ("stride",), "without --posterior nothing sees these frames")
        if self.student == "plain":
            check_idle(self, "policy", _OF_LATENT, _NO_LATENT)


@dataclass(kw_only=True)
class RefineModelRecipe(ImaginationRecipe):
    """Refine a student by imagined rollouts of a learned model of the robot."""

    name = "refine-model"

    student: Path
    """run to start from: of stage 2, or of its student fine-tuned"""
    variant: Literal["latent", "action", "finetune"] = "latent"
    """latent: residual in the latent; action: residual on the action; finetune: all weights"""
    policy: RefinementConfig = field(default_factory=RefinementConfig)
    task: TimedKeyframesConfig = field(default_factory=TimedKeyframesConfig)

    def goes_on(self) -> bool:
        """Whether it goes on from a policy that is trained already: its student is."""
        return True

    def __post_init__(self) -> None:
        super().__post_init__()
        check_refinement(self)
        check_idle(self, "task", ("stride",), "and no posterior learns that sees these frames")
        told = "and robots of imagination explore by --noise"
        check_idle(self, "policy", ("init_std", "min_std"), told)


@dataclass(frozen=True, kw_only=True)
class Training(Bounded):
    """How rows are trained: the same steps and settings for all rows of a stage."""

    motions: tuple[str, ...] = ()
    """motion files, folders or globs to train on"""
    mirror: bool = False
    """train on the mirror image of every motion as well"""
    drop_bad: bool = False
    """leave out motions of files that plat motions inspect would drop"""
    expert_steps: Count = 12_000_000
    """environment steps of each tracker (stage 1)"""
    student_steps: Count = 3_000_000
    """environment steps of each student (stage 2)"""
    refine_steps: Count = 3_000_000
    """environment steps of each refined policy (stage 3)"""
    imagine_steps: Count = 1_500_000
    """environment steps of each imagined policy, which trains longer on each step"""
    seeds: Annotated[tuple[Seed, ...], NotEmpty()] = (0, 1, 2)
    """training seeds of the refined policies; the others are trained with the first"""
    num_envs: Robots = 512
    """robots simulated at a time"""
    cpus: Count = 2
    """with --ray: CPUs of each training"""


@dataclass(kw_only=True)
class AblationsRecipe(ScoringConfig):
    """Score every row of the ablation, and train it first if asked."""

    runs: Path
    """folder with one run a row"""
    out: Path
    """folder for tables, figures and records"""
    train: bool = False
    """train the rows that RUNS lacks or that are unfinished"""
    ray: bool = False
    """train and score rows all at once, as tasks of a Ray cluster (extra: ray)"""
    training: Training = field(default_factory=Training)


@dataclass(kw_only=True)
class DemoRecipe(Bounded):
    """All three stages and the evaluation at a small scale."""

    out: Path = Path("runs/demo")
    """folder to write to"""
    expert_minutes: Positive = 5.5
    """training time of stage 1"""
    distill_minutes: Positive = 2.0
    """training time of stage 2"""
    refine_minutes: Positive = 1.3
    """training time of stage 3"""
    num_envs: Robots = 512
    """robots simulated at a time"""
    seed: Seed = 0
    """seeds everything that is drawn"""


def check_distant(recipe: ImagineRecipe | RefineModelRecipe, timing: Timing) -> None:
    """Raise an error for a share of commands of more than a second, where no command is."""
    if timing.max_steps <= timing.steps(1.0):
        told = f"and commands take {timing.longest:g} s at most: --policy.timing.max-steps says so, or the student"
        check_idle(recipe, "task", ("distant",), told)


def check_partial(partial: float, also: Sequence[str]) -> None:
    """Raise an error when keyframes are partial and a policy does not see which parts are commanded.

    Args:
        partial: share of the commands that are partial keyframes.
        also: groups that the policy observes beside robot, goal and command.

    Raises:
        ConfigError: naming the flags.
    """
    if partial > 0 and "parts" not in also:
        raise ConfigError(
            f"task.partial: {partial:g} of the keyframes are partial, but the policy does not see which parts are "
            "commanded: train one with --policy.also parts clock, or set --task.partial 0"
        )
