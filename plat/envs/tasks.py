"""Environments put together: dense tracking (stage 1) and sparse timed keyframes (stages 2 and 3)."""

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torchrl.envs import Compose, ExcludeTransform, Transform, TransformedEnv

from plat.envs.physics import BatchedPhysics, PhysicsFactory
from plat.envs.tracking import MotionTrackingEnv, ResetNoise
from plat.envs.transforms import (
    HORIZONS,
    NEXT_DENSE_FRAME,
    NEXT_FRAME,
    DenseGoal,
    DenseRewards,
    DenseTrackingReward,
    DomainRandomization,
    FailureWeightedStarts,
    Horizon,
    KeyframeClock,
    KeyframeCommand,
    KeyframeReward,
    KeyframeRewards,
    KeyframeTermination,
    NoiseLevels,
    ObservationNoise,
    PrivilegedState,
    RandomizationRanges,
    ReferenceMotion,
    Regularisation,
    RegularisationReward,
    TerminationLimits,
    TrackingTermination,
)
from plat.motions.library import MotionLibrary
from plat.robots.robot import FootContacts
from plat.spec.observation import is_goal

__all__ = ["TaskConfig", "make_keyframe_env", "make_tracking_env"]

# What the policy, the critic or a collector may read. The rest is there for other transforms only; storing it would
# fill most of a rollout.
_KEPT_GROUPS = ("robot", "command", "privileged", "motion")
_KEPT_STATE = (("state", "root_pos_w"), ("state", "root_quat_w"))


@dataclass(frozen=True)
class TaskConfig:
    """Everything about a training environment that is not its motions or its size."""

    decimation: int = 4
    """physics steps a control step"""
    feet: FootContacts = "spheres"
    """contact geometry of the soles"""
    reset_noise: ResetNoise = ResetNoise()
    """noise on the starting state"""
    dense: DenseRewards = DenseRewards()
    """terms of the dense reward"""
    sparse: KeyframeRewards = KeyframeRewards()
    """terms of the keyframe reward"""
    regularisation: Regularisation = Regularisation()
    """penalties"""
    dense_weight: float = 1.0
    """factor on the dense reward, w_dense"""
    sparse_weight: float = 5.0
    """factor on the keyframe reward, w_sparse"""
    regularisation_weight: float = 1.0
    """factor on the penalties, w_reg"""
    limits: TerminationLimits = TerminationLimits()
    """when an episode has failed"""
    max_displacement: float | None = 0.5
    """horizontal error of the root that ends a training episode (m); None for no such end"""
    uniform_starts: float = 0.5
    """share of the episodes that start anywhere; the others start where failures are"""
    observation_noise: bool = False
    """add noise to what the robot measures"""
    noise: NoiseLevels = NoiseLevels()
    """how much"""
    domain_randomization: bool = False
    """draw robot, motors and ground anew at each reset, and push the robots"""
    randomization: RandomizationRanges = RandomizationRanges()
    """from which ranges"""


def _simulation(
    library: MotionLibrary,
    num_envs: int,
    config: TaskConfig,
    min_frames_left: int,
    num_threads: int | None,
    device: torch.device | str,
    physics: PhysicsFactory,
) -> MotionTrackingEnv:
    return MotionTrackingEnv(
        library,
        num_envs,
        decimation=config.decimation,
        feet=config.feet,
        reset_noise=config.reset_noise,
        min_frames_left=min_frames_left,
        num_threads=num_threads,
        device=device,
        physics=physics,
    )


def _assemble(
    env: MotionTrackingEnv, config: TaskConfig, task: list[Transform], after: list[Transform]
) -> TransformedEnv:
    transforms: list[Transform] = [ReferenceMotion(env.library, at_resets=False), *task]
    transforms.append(
        FailureWeightedStarts(
            env.library, env.num_envs, uniform=config.uniform_starts, min_frames_left=env.min_frames_left
        )
    )
    transforms += after
    if config.domain_randomization:
        transforms.append(DomainRandomization(env, config.randomization))
    if config.observation_noise:
        transforms.append(ObservationNoise(env.robot, config.noise))
    task_env = TransformedEnv(env, Compose(*transforms))
    entries = task_env.observation_spec.keys(True, True)
    task_env.append_transform(ExcludeTransform(*(key for key in entries if not _kept(key))))
    return task_env


def _kept(key: tuple[str, ...]) -> bool:
    return key[0] in _KEPT_GROUPS or is_goal(key[0]) or key in _KEPT_STATE


def _rewards(env: MotionTrackingEnv, config: TaskConfig) -> list[Transform]:
    """The rewards of stage 3; one whose factor is 0 is left out."""
    robot, dt = env.robot, env.library.dt
    rewards = (
        (config.dense_weight, lambda weight: DenseTrackingReward(robot, dt, config.dense, weight)),
        (config.sparse_weight, lambda weight: KeyframeReward(robot, dt, config.sparse, weight)),
        (config.regularisation_weight, lambda weight: RegularisationReward(robot, dt, config.regularisation, weight)),
    )
    return [build(weight) for weight, build in rewards if weight]


def make_tracking_env(
    library: MotionLibrary,
    num_envs: int,
    config: TaskConfig | None = None,
    *,
    goals: Mapping[str, int] = NEXT_FRAME,
    num_threads: int | None = None,
    device: torch.device | str = "cpu",
    physics: PhysicsFactory = BatchedPhysics,
) -> TransformedEnv:
    """Stage 1: follow the reference frame by frame.

    Observations are ``("robot", ...)``, ``("goal", ...)`` (the next reference frame) and ``("privileged", ...)``;
    other ``goals`` are those of a :class:`plat.modules.Expert` that sees several frames.

    >>> from plat.motions import generate_motions
    >>> env = make_tracking_env(MotionLibrary.from_clips(generate_motions("train", seconds=8)), num_envs=2)
    >>> env.rollout(2)["next", "reward"].shape
    torch.Size([2, 2, 1])
    """
    config = config or TaskConfig()
    env = _simulation(library, num_envs, config, 1, num_threads, device, physics)
    robot, dt = env.robot, library.dt
    task = [
        DenseTrackingReward(robot, dt, config.dense),
        RegularisationReward(robot, dt, config.regularisation, config.regularisation_weight),
        TrackingTermination(robot, config.limits, max_displacement=config.max_displacement),
    ]
    return _assemble(env, config, task, [*DenseGoal.of_groups(env.library, goals), PrivilegedState(env.library)])


def make_keyframe_env(
    library: MotionLibrary,
    num_envs: int,
    config: TaskConfig | None = None,
    *,
    horizon: Horizon = HORIZONS["mixed"],
    dense_goals: Mapping[str, int] = NEXT_DENSE_FRAME,
    num_threads: int | None = None,
    device: torch.device | str = "cpu",
    physics: PhysicsFactory = BatchedPhysics,
) -> TransformedEnv:
    """Stages 2 and 3: be at one future keyframe on time, then at the next.

    Observations are ``("robot", ...)``, ``("goal", ...)`` (the commanded keyframe), ``("command", ...)``,
    ``("privileged", ...)`` and, for the expert that labels, ``("dense_goal", ...)`` (the next reference frame) or
    whatever :attr:`plat.modules.Expert.dense_goals` says.

    >>> from plat.motions import generate_motions
    >>> env = make_keyframe_env(MotionLibrary.from_clips(generate_motions("train", seconds=8)), num_envs=2)
    >>> env.rollout(2)["command", "horizon"].shape
    torch.Size([2, 2, 1])
    """
    config = config or TaskConfig()
    env = _simulation(library, num_envs, config, horizon.shortest, num_threads, device, physics)
    task: list[Transform] = [
        KeyframeClock(),
        *_rewards(env, config),
        KeyframeTermination(env.robot, config.limits, max_displacement=config.max_displacement),
    ]
    references = DenseGoal.of_groups(env.library, dense_goals)
    return _assemble(
        env, config, task, [KeyframeCommand(env.library, horizon), *references, PrivilegedState(env.library)]
    )
