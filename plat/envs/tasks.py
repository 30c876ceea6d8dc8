"""Task environments: dense tracking (stage 1) and sparse timed keyframes (stages 2 and 3)."""

from collections.abc import Mapping, Sequence

import torch
from torchrl.envs import Compose, ExcludeTransform, RemoveEmptySpecs, Transform, TransformedEnv

from plat.bounds import check_value
from plat.envs.configs import (
    DistillationTaskConfig,
    KeyframeTaskConfig,
    SimulationConfig,
    TrackingTaskConfig,
)
from plat.envs.physics import BatchedPhysics, PhysicsFactory
from plat.envs.tracking import MotionTrackingEnv
from plat.envs.transforms import (
    NEXT_DENSE_FRAME,
    NEXT_FRAME,
    DenseGoal,
    DomainRandomization,
    FailureWeightedStarts,
    Horizon,
    KeyframeClock,
    KeyframeCommand,
    KeyframeTermination,
    ObservationNoise,
    ObservationTransform,
    PrivilegedState,
    ReferenceMotion,
    Reward,
    RewardGroup,
    Rewards,
    TrackingError,
    TrackingTermination,
)
from plat.envs.transforms.command import check_timing
from plat.errors import TaskError
from plat.motions.library import MotionLibrary
from plat.spec.timing import Timing

__all__ = ["make_keyframe_env", "make_tracking_env"]

# Entries for transforms only; storing them would fill most of a rollout.
_WORKING_GROUPS = ("reference", "state")
_KEPT_STATE = (("state", "root_pos_w"), ("state", "root_quat_w"))


def make_tracking_env(
    library: MotionLibrary,
    num_envs: int,
    config: TrackingTaskConfig | None = None,
    *,
    goals: Mapping[str, int] = NEXT_FRAME,
    rewards: Sequence[Reward | RewardGroup] | None = None,
    transforms: Sequence[Transform] = (),
    num_threads: int | None = None,
    device: torch.device | str = "cpu",
    physics: PhysicsFactory = BatchedPhysics,
) -> TransformedEnv:
    """Make the environment of stage 1: frame-by-frame motion tracking.

    Observations are ``("robot", ...)``, ``("goal", ...)`` (the next reference frame) and ``("privileged", ...)``.

    Args:
        library: motions.
        num_envs: number of robots N.
        config: settings.
        goals: groups of the reference with their numbers of frames ahead, as :attr:`plat.modules.Expert.goals`.
        rewards: in place of those of the config, ``config.rewards(library.robot)``.
        transforms: more transforms. Those that judge a step come after the rewards; each
            :class:`plat.envs.transforms.ObservationTransform` comes after the goals, and what it writes is kept.
        num_threads: threads of the physics pool; None takes all CPUs.
        device: where tensors live.
        physics: makes the physics.

    Raises:
        TaskError: when a reward or transform is none, or reads what no transform before it writes.
        ConfigError: for an argument of another type.

    >>> from plat.motions import generate_motions
    >>> env = make_tracking_env(MotionLibrary.from_clips(generate_motions("train", seconds=8)), num_envs=2)
    >>> env.rollout(2, break_when_any_done=False)["next", "reward"].shape
    torch.Size([2, 2, 1])
    """
    config = config or TrackingTaskConfig()
    check_value("library", library, MotionLibrary)
    check_value("config", config, TrackingTaskConfig)
    check_value("goals", goals, Mapping)
    env = _simulation(library, num_envs, config, 1, num_threads, device, physics)
    rewards = config.rewards(env.robot) if rewards is None else rewards
    termination = TrackingTermination(env.robot, config.limits, max_displacement=config.max_displacement)
    judges = [*_reward_transforms(env, rewards), TrackingError(), termination]
    observations = [*DenseGoal.of_groups(env.library, goals), PrivilegedState(env.library)]
    return _assemble(env, config, judges, observations, transforms)


def make_keyframe_env(
    library: MotionLibrary,
    num_envs: int,
    config: DistillationTaskConfig | None = None,
    *,
    horizon: Horizon | None = None,
    timing: Timing | None = None,
    dense_goals: Mapping[str, int] = NEXT_DENSE_FRAME,
    rewards: Sequence[Reward | RewardGroup] | None = None,
    transforms: Sequence[Transform] = (),
    num_threads: int | None = None,
    device: torch.device | str = "cpu",
    physics: PhysicsFactory = BatchedPhysics,
) -> TransformedEnv:
    """Make the environment of stages 2 and 3: reaching one timed keyframe after another.

    Observations are ``("robot", ...)``, ``("goal", ...)`` (the commanded keyframe), ``("command", ...)``,
    ``("parts", ...)`` (what is commanded), ``("clock", ...)``, ``("privileged", ...)`` and, for the expert that labels,
    ``("dense_goal", ...)`` (the next reference frame).

    Args:
        library: motions.
        num_envs: number of robots N.
        config: settings; by default those of a :class:`KeyframeTaskConfig`. A :class:`DistillationTaskConfig` has no
            rewards.
        horizon: lengths of the commands; None for every length that the timing allows.
        timing: of the policy; None for the default at the control step of the motions.
        dense_goals: groups of the reference, as :attr:`plat.modules.Expert.dense_goals`.
        rewards, transforms, num_threads, device, physics: as for :func:`make_tracking_env`.

    Raises:
        TaskError: when a reward or transform is none, or reads what no transform before it writes.
        ConfigError: for an argument of another type.
        MotionError: when a clip is too short for a command.
        PlatError: when motions or horizon do not fit the timing.

    >>> from plat.motions import generate_motions
    >>> env = make_keyframe_env(MotionLibrary.from_clips(generate_motions("train", seconds=8)), num_envs=2)
    >>> env.rollout(2)["command", "horizon"].shape
    torch.Size([2, 2, 1])
    """
    config = config or KeyframeTaskConfig()
    check_value("library", library, MotionLibrary)
    check_value("config", config, KeyframeTaskConfig | DistillationTaskConfig)
    check_value("timing", timing, Timing | None)
    check_value("dense_goals", dense_goals, Mapping)
    timing = timing or Timing(control_dt=library.dt)
    horizon = horizon or Horizon(1, timing.max_steps)
    check_timing(library, horizon, timing)
    env = _simulation(library, num_envs, config, horizon.shortest, num_threads, device, physics)
    rewards = config.rewards(env.robot) if rewards is None else rewards
    termination = KeyframeTermination(env.robot, config.limits, max_displacement=config.max_displacement)
    num_parts = KeyframeCommand.num_parts(env.robot) if config.partial else 0
    judges: list[Transform] = [KeyframeClock(timing.window, num_parts), *_reward_transforms(env, rewards), termination]
    if rewards:
        judges.append(TrackingError())
    observations = [
        KeyframeCommand(env.library, horizon, timing=timing, partial=config.partial),
        *DenseGoal.of_groups(env.library, dense_goals),
        PrivilegedState(env.library),
    ]
    return _assemble(env, config, judges, observations, transforms)


def _simulation(
    library: MotionLibrary,
    num_envs: int,
    config: SimulationConfig,
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


def _reward_transforms(env: MotionTrackingEnv, rewards: Sequence[Reward | RewardGroup]) -> list[Transform]:
    return [Rewards(rewards, env.library.dt)] if rewards else []


def _assemble(
    env: MotionTrackingEnv,
    config: SimulationConfig,
    judges: Sequence[Transform],
    observations: Sequence[Transform],
    own: Sequence[Transform],
) -> TransformedEnv:
    """Order the transforms: those that judge a step, then starts of the next episodes, then observations."""
    if isinstance(own, Transform) and not isinstance(own, Compose):
        raise TaskError(f"transforms is a single {type(own).__name__}, expected several in a tuple")
    if strange := [transform for transform in own if not isinstance(transform, Transform)]:
        raise TaskError(f"transforms hold {strange[0]!r}, expected each to be a Transform of TorchRL")
    starts = FailureWeightedStarts(
        env.library, env.num_envs, uniform=config.uniform_starts, min_frames_left=env.min_frames_left
    )
    transforms = [
        ReferenceMotion(env.library, at_resets=False),
        *judges,
        *(transform for transform in own if not isinstance(transform, ObservationTransform)),
        starts,
        *observations,
        *(transform for transform in own if isinstance(transform, ObservationTransform)),
    ]
    if config.randomization is not None:
        transforms.append(DomainRandomization(env, config.randomization))
    if config.noise is not None:
        transforms.append(ObservationNoise(env.robot, config.noise))
    task_env = TransformedEnv(env, Compose(*transforms))
    entries = task_env.observation_spec.keys(True, True)
    working = [key for key in entries if key[0] in _WORKING_GROUPS and key not in _KEPT_STATE]
    task_env.append_transform(ExcludeTransform(*working))
    task_env.append_transform(RemoveEmptySpecs())  # environments of several processes stack no empty group
    return task_env
