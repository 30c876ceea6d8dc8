"""Rollout loop of an evaluation, and the environment that issues scheduled commands."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor
from torchrl.envs import Compose, EnvBase, Transform, TransformedEnv
from torchrl.envs.utils import ExplorationType, set_exploration_type

from plat.bounds import check_value
from plat.envs.tracking import MotionTrackingEnv
from plat.envs.transforms import (
    CommandSchedule,
    KeyframeClock,
    KeyframeCommand,
    KeyframeMetrics,
    KeyframeTermination,
    ReferenceMotion,
    ScheduledStarts,
)
from plat.evaluation.clip_draws import ClipSeeds
from plat.evaluation.disturbance import disturbing, loaded_physics, observing_noise
from plat.evaluation.finite import check_actions
from plat.evaluation.setting import EvaluationSetting, ReferenceView
from plat.motions.library import MotionLibrary
from plat.spec.timing import Timing

__all__ = ["EvaluationEnv", "make_evaluation_env", "policy_steps", "simulated_robots"]


@dataclass(frozen=True)
class EvaluationEnv:
    """Evaluation environment that issues every command of a schedule once.

    Attributes:
        env: of ``N`` robots.
        schedule: the commands.
        starts: the transform that puts robots on their motions; it knows which are active and when all is done.
    """

    env: TransformedEnv
    schedule: CommandSchedule
    starts: ScheduledStarts

    @property
    def active(self) -> Tensor:
        """Return the mask ``[N]`` of robots with a command of the schedule; the others are finished."""
        return self.starts.active

    def steps(self, policy: TensorDictModuleBase) -> Iterator[TensorDictBase]:
        """Yield the steps of :func:`policy_steps` until every command has ended.

        :attr:`active` holds for the step that was yielded last.

        Raises:
            ActionError: for an action of an active robot that is not finite.
        """

        def checked(tensordict: TensorDictBase) -> TensorDictBase:
            tensordict = policy(tensordict)
            check_actions(tensordict["action"], self.active)
            return tensordict

        return policy_steps(checked, self.env, lambda: self.starts.finished)

    def close(self) -> None:
        """Release the physics."""
        self.env.close()


def make_evaluation_env(
    library: MotionLibrary,
    schedule: CommandSchedule,
    num_envs: int,
    view: ReferenceView | None = None,
    setting: EvaluationSetting | None = None,
    clips: Sequence[int] | None = None,
) -> EvaluationEnv:
    """Return the environment of :func:`plat.evaluation.evaluate`: no reward, and sensor noise only by ``setting``.

    Args:
        library: motions, on the device of ``setting``.
        schedule: commands for them.
        num_envs: number of robots; takes the place of ``setting.num_envs``.
        view: how the policy is shown its reference.
        setting: conditions.
        clips: numbers of the motions among all, which tell what is drawn for each; None where these are all.
    """
    for name, given, kind in (
        ("library", library, MotionLibrary),
        ("schedule", schedule, CommandSchedule),
        ("view", view, ReferenceView | None),
        ("setting", setting, EvaluationSetting | None),
    ):
        check_value(f"make_evaluation_env: {name}", given, kind)
    view, setting = view or ReferenceView(), setting or EvaluationSetting()
    timing = setting.timing or Timing(control_dt=library.dt)
    env = simulated_robots(library, num_envs, setting)
    starts = ScheduledStarts(env.library, schedule, num_envs)
    seeds = ClipSeeds(setting.seed, range(library.num_clips) if clips is None else clips)
    transforms: list[Transform] = [
        *disturbing(env, setting.randomization, setting.disturbance, seeds),
        ReferenceMotion(env.library),
        KeyframeClock(timing.window, 0 if schedule.parts is None else schedule.parts.shape[1]),
        KeyframeTermination(env.robot, setting.limits),
        KeyframeMetrics(env.library, setting.limits),
        starts,
        KeyframeCommand(env.library, schedule.horizon, schedule, view.command_group, timing),
        *view.transforms(env.library),
        *observing_noise(env.library, setting.disturbance, seeds),
    ]
    return EvaluationEnv(TransformedEnv(env, Compose(*transforms)), schedule, starts)


def simulated_robots(library: MotionLibrary, num_envs: int, setting: EvaluationSetting) -> MotionTrackingEnv:
    """Return the robots of an evaluation, with the load of its disturbance.

    Args:
        library: motions, on the device of ``setting``.
        num_envs: number of robots; takes the place of ``setting.num_envs``.
        setting: conditions.
    """
    return MotionTrackingEnv(
        library,
        num_envs,
        decimation=setting.decimation,
        feet=setting.feet,
        num_threads=setting.num_threads,
        device=setting.device,
        physics=loaded_physics(library.robot, setting.disturbance),
    )


def policy_steps(
    policy: Callable[[TensorDictBase], TensorDictBase], env: EnvBase, finished: Callable[[], bool] = lambda: False
) -> Iterator[TensorDictBase]:
    """Step a deterministic policy through an environment; yield each step before robots are reset after it.

    Args:
        policy: writes ``action``.
        env: reset at the beginning, and its finished episodes after each step.
        finished: asked after each reset whether to stop; by default the loop never ends.

    Yields:
        The entries before the step ``[N]``, with ``action``, and the entries after it under ``"next"``.

    >>> from itertools import islice
    >>> from plat.envs import make_keyframe_env
    >>> from plat.modules import Expert
    >>> from plat.motions import generate_motions
    >>> from plat.robots import G1
    >>> library = MotionLibrary.from_clips(generate_motions("val", seconds=8))
    >>> steps = policy_steps(Expert(G1).deployed(), make_keyframe_env(library, num_envs=2))
    >>> [step["next", "robot", "joint_pos"].shape for step in islice(steps, 1)]
    [torch.Size([2, 29])]
    """
    tensordict = env.reset()
    while not finished():
        # a generator must not leave its caller in another mode, so each step enters and leaves it
        with torch.no_grad(), set_exploration_type(ExplorationType.DETERMINISTIC):
            tensordict = env.step(policy(tensordict))
        yield tensordict
        with torch.no_grad():
            tensordict = env.maybe_reset(env.step_mdp(tensordict))
