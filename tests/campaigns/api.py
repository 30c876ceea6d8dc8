"""Misuses of the API: each raises a PlatError of one line that names what is wrong.

python -m tests.campaigns.api            # all, in a minute
python -m tests.campaigns.api --verbose  # with the message of each

Four kinds. Settings: every field of every public configuration, given values without sense. Entries: every entry of
every module and objective, missing, too wide, or whole numbers. Calls: a list, of arguments without sense. Arguments:
each one of public functions, in turn of another kind, see tests/campaigns/arguments.py; what a function can do with it
may take.
"""

import argparse
import dataclasses
import functools
import sys
import tempfile
import typing
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict, TensorDictBase
from torch import nn

from plat.collectors import MixedPolicy, PrivilegedGoals, RolloutReplay, dagger_buffer, rollouts, strided_offsets
from plat.control import Chase, Feasibility, PolicyController, Simulator
from plat.control.shoves import Shoves
from plat.deploy import RobotState
from plat.envs import (
    KeyframeTaskConfig,
    MotionTrackingEnv,
    TrackingTaskConfig,
    joint_target,
    make_keyframe_env,
    make_tracking_env,
)
from plat.envs.settings import ResetNoise
from plat.envs.transforms import CommandSchedule, Horizon, Reward, horizon_named
from plat.envs.transforms.settings import (
    NoiseLevels,
    RandomizationRanges,
    TerminationLimits,
    TrackingLimits,
    TrackingTerm,
)
from plat.envs.transforms.tracking_rewards import DenseRewards, KeyframeRewards, Regularization
from plat.errors import PlatError
from plat.evaluation import Disturbance, EvaluationSetting, evaluate, report
from plat.keyframes import Keyframe, KeyframeQueue, KeyframeSequence, interpolate, standing
from plat.modules import (
    Critic,
    DynamicsConfig,
    DynamicsModel,
    Expert,
    ExpertConfig,
    GaussianNoise,
    KeyframeReach,
    LatentPolicy,
    LatentPolicyConfig,
    NormalizerConfig,
    ObservationNormalizer,
    PlainPolicy,
    PlainPolicyConfig,
    RefinementConfig,
    ResidualActionPolicy,
    ResidualLatentPolicy,
    WalkingReach,
)
from plat.motions import (
    MotionClip,
    MotionLibrary,
    clip_to_limits,
    cut_motion,
    generate_motions,
    ground_feet,
    joint_steps,
    level_feet,
    mend_motion,
    mirror_motion,
    save_csv,
    save_motions,
    smooth_steps,
    trim_motion,
    validate_motion,
)
from plat.motions.checks.settings import ValidationLimits
from plat.motions.retargeting.options import SolverOptions
from plat.objectives import (
    PPO,
    ImaginationConfig,
    ImitationLoss,
    LatentImitationLoss,
    MotorGradientConfig,
    PPOConfig,
    exploring,
    motor_gradient,
)
from plat.robots import G1, ForwardKinematics, describe_robot, get_robot
from plat.runs import Budget, SavedRun, load_policy
from plat.spec.observation import student_keys
from plat.spec.timing import Timing
from plat.tasks.settings import AuthoredCosts, TimedKeyframesConfig, TrackingCosts
from tests.campaigns.arguments import misplaced, trips
from tests.conftest import standing_clip
from tests.modules.policies.test_student import SMALL

CONFIGS: tuple[type, ...] = (
    AuthoredCosts,
    DenseRewards,
    DynamicsConfig,
    EvaluationSetting,
    ExpertConfig,
    ImaginationConfig,
    KeyframeRewards,
    KeyframeTaskConfig,
    LatentPolicyConfig,
    MotorGradientConfig,
    NoiseLevels,
    NormalizerConfig,
    PPOConfig,
    PlainPolicyConfig,
    RandomizationRanges,
    RefinementConfig,
    Regularization,
    ResetNoise,
    SolverOptions,
    TerminationLimits,
    TimedKeyframesConfig,
    Timing,
    TrackingCosts,
    TrackingLimits,
    TrackingTaskConfig,
    TrackingTerm,
    ValidationLimits,
)


@dataclass(frozen=True)
class Misuse:
    """A misuse: what it is called, what the message has to name, and the call."""

    name: str
    says: str
    call: Callable[[], object]


def settings() -> Iterator[Misuse]:
    """Yield every field of every configuration, with values without sense."""
    for kind in CONFIGS:
        required = {"weight": 1.0, "scale": 1.0} if kind is TrackingTerm else {}
        hints = typing.get_type_hints(kind)
        for field in dataclasses.fields(kind):
            if hints[field.name] in (Any, object) or "Mapping" in str(hints[field.name]):
                continue
            for value in (float("nan"), "wide", -1.5, (0, -1), object()):
                if isinstance(value, str) and (hints[field.name] is str or "str |" in str(hints[field.name])):
                    continue
                if value == -1.5 and kind is Regularization:
                    value = 1.5
                if isinstance(value, str) and "torch.device" in str(hints[field.name]):
                    continue
                call = functools.partial(kind, **{**required, field.name: value})
                yield Misuse(f"{kind.__name__}({field.name}={value!r:.20})", field.name, call)


def modules() -> Iterator[tuple[str, Any, TensorDictBase]]:
    """Yield TensorDict modules and objectives with entries that are right for them."""
    library = MotionLibrary.from_clips([standing_clip(frames=121)])
    env = make_keyframe_env(library, 2)
    state = env.reset()
    expert = Expert(G1, ExpertConfig(hidden=(8,), ahead=(1, 2), action="reference_velocity", lead=0.1))
    latent, plain = LatentPolicy(G1, SMALL), PlainPolicy(G1, SMALL)
    tracking = make_tracking_env(library, 2, goals=expert.goals)
    dense = tracking.reset()
    critic = Critic(G1, student_keys(), (8,))
    privileged = state.clone()
    privileged["privileged_goal"] = {"frames": torch.zeros(2, 3, 80), "length": torch.tensor([3, 2])}
    privileged["expert_action"] = torch.zeros(2, 29)
    refined = (ResidualLatentPolicy(latent), ResidualActionPolicy(latent, RefinementConfig(lead=0.1)))
    yield "expert.deployed", expert.deployed(tuple(expert.goals)), dense
    yield "expert.actor", expert.actor(), dense
    yield "latent.deployed", latent.deployed(), state
    yield "latent.sampled", latent.sampled(), state
    yield "latent.training_graph", latent.training_graph(), privileged
    yield "plain.deployed", plain.deployed(), state
    for policy in refined:
        yield f"{type(policy).__name__}.deployed", policy.deployed(), state
        yield f"{type(policy).__name__}.actor", policy.actor(), state
    yield "critic.observe", critic.observe(), make_privileged(library)
    yield "critic.head", critic.head(), critic.observe()(make_privileged(library))
    yield "imitation loss", ImitationLoss(plain.training_graph()), privileged
    yield "latent imitation loss", LatentImitationLoss(latent.training_graph()), privileged
    yield "environment step", _Step(env), state.clone().set("action", torch.zeros(2, 29))


def make_privileged(library: MotionLibrary) -> TensorDictBase:
    """Return a state with the privileged entries of a critic."""
    return make_keyframe_env(library, 2).reset()


class _Step(nn.Module):
    """A step of an environment, as a module."""

    in_keys = ("action",)

    def __init__(self, env: Any):
        super().__init__()
        self.env = env

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        return self.env.step(tensordict)


def entries() -> Iterator[Misuse]:
    """Yield every entry of every module and objective: missing, too wide, and whole numbers."""
    for name, module, right in modules():
        module(right.clone())
        for key in dict.fromkeys(module.in_keys):
            value = right[key]
            told = key if isinstance(key, str) else key[-1]
            if told == "length":
                continue
            wide = torch.cat((value, value[..., :1]), -1)
            misuses: list[tuple[str, torch.Tensor | None]] = [
                ("too wide", wide),
                ("whole", value.long()),
                ("gone", None),
            ]
            if told not in ("action", "expert_action"):  # float64 will do for those
                misuses.append(("double", value.double()))
            for what, wrong in misuses:
                bad = right.clone()
                bad = bad.exclude(key) if wrong is None else bad.set(key, wrong)
                yield Misuse(f"{name} with {key} {what}", told, functools.partial(module, bad))


def calls(folder: Path) -> Iterator[Misuse]:
    """Yield calls with arguments without sense."""
    clip = standing_clip(frames=121)
    library = MotionLibrary.from_clips([clip])
    expert, latent = Expert(G1, ExpertConfig(hidden=(8,))), LatentPolicy(G1, SMALL)
    env = make_keyframe_env(library, 2)
    simulator = Simulator(G1.model())
    simulator.reset(standing(G1))
    state, pose = simulator.state(), standing(G1)
    controller = PolicyController(latent.deployed(), G1)
    sequence = KeyframeSequence(G1, pose, (pose.at(0.1),))
    short = dataclasses.replace(pose, joint_pos=pose.joint_pos[:-1])
    noisy = TensorDict({"x": torch.zeros(2, 5), "next": {"done": torch.zeros(2, 5, 1).bool()}}, [2, 5])
    replay = RolloutReplay(2, 10, ["x"])
    tracking = make_tracking_env(library, 2, goals=expert.goals)
    rollout = next(rollouts(tracking, expert.actor(), 8))
    critic = Critic(G1, expert.normalizer.in_keys, (8,))
    ppo = PPO(expert.head(), critic.head(), critic.observe())

    def state_with(**changed: object) -> RobotState:
        return dataclasses.replace(state, **changed)

    def listed(says: str, **several: Callable[[], object]) -> Iterator[Misuse]:
        for name, call in several.items():
            yield Misuse(name.replace("_", " "), says, call)

    yield from listed(
        "steps",
        controller_with_0_steps_left=lambda: controller(state, pose, 0),
        controller_with_minus_1_step_left=lambda: controller(state, pose, -1),
        controller_with_nan_steps_left=lambda: controller(state, pose, float("nan")),
        controller_with_1000_steps_left=lambda: controller(state, pose, 1000),
        rollouts_of_0_steps=lambda: rollouts(env, latent.sampled(), 0),
        rollouts_of_half_a_step=lambda: rollouts(env, latent.sampled(), 0.5),
        budget_of_0_steps=lambda: Budget(steps=0),
        budget_of_nan_minutes=lambda: Budget(minutes=float("nan")),
        budget_of_endless_minutes=lambda: Budget(minutes=float("inf")),
        budget_of_nothing=lambda: Budget(),
    )
    yield from listed(
        "joint_pos",
        controller_with_a_joint_less=lambda: controller(state_with(joint_pos=state.joint_pos[:-1]), pose, 5),
        controller_with_nan_joints=lambda: controller(state_with(joint_pos=state.joint_pos * np.nan), pose, 5),
        controller_with_a_keyframe_of_less_joints=lambda: controller(state, short, 5),
        sequence_with_a_short_start=lambda: KeyframeSequence(G1, short, (pose.at(0.1),)),
        sequence_with_a_short_keyframe=lambda: KeyframeSequence(G1, pose, (short.at(0.1),)),
        keyframe_of_a_short_vector=lambda: Keyframe.from_qpos(0.0, G1.default_qpos[:-1]).checked(G1),
        simulator_in_a_short_pose=lambda: simulator.reset(short),
    )
    yield from listed(
        "root_quat",
        controller_with_a_long_quaternion=lambda: controller(state_with(root_quat_w=np.ones(4)), pose, 5),
        controller_with_a_short_quaternion=lambda: controller(state_with(root_quat_w=np.ones(3)), pose, 5),
        keyframe_with_a_long_quaternion=lambda: dataclasses.replace(pose, root_quat=np.ones(4)).checked(G1),
    )
    yield from listed(
        "joint_target",
        controller_reset_to_too_few=lambda: controller.reset(np.zeros(3)),
        controller_reset_to_nan=lambda: controller.reset(np.full(29, np.nan)),
    )
    yield from listed(
        "clip",
        library_clip_minus_1=lambda: library.clip(-1),
        library_clip_1=lambda: library.clip(1),
        library_clip_half=lambda: library.clip(0.5),
        library_only_minus_1=lambda: library.only(-1),
        library_only_none=lambda: library.only(),
        library_only_7=lambda: library.only(0, 7),
        library_of_no_clips=lambda: MotionLibrary.from_clips([]),
    )
    yield from listed(
        "dt",
        library_at_dt_0=lambda: MotionLibrary.from_clips([clip], dt=0.0),
        library_at_dt_nan=lambda: MotionLibrary.from_clips([clip], dt=float("nan")),
        library_at_dt_minus=lambda: MotionLibrary.from_clips([clip], dt=-0.02),
        simulator_at_dt_0=lambda: Simulator(G1.model(), 0.0),
        simulator_at_dt_nan=lambda: Simulator(G1.model(), float("nan")),
    )
    yield from listed(
        "motion",
        clip_of_0_fps=lambda: MotionClip("a", clip.qpos, 0.0).checked(G1),
        clip_of_nan=lambda: MotionClip("a", clip.qpos * np.nan, 30.0).checked(G1),
        clip_of_one_frame=lambda: MotionClip("a", clip.qpos[:1], 30.0).checked(G1),
        clip_of_less_columns=lambda: MotionClip("a", clip.qpos[:, :30], 30.0).checked(G1),
        clip_of_words=lambda: MotionClip("a", np.array([["x"]]), 30.0).checked(G1),
        motions_for_nan_seconds=lambda: generate_motions("val", float("nan")),
        motions_for_minus_a_second=lambda: generate_motions("val", -1),
        motions_of_no_split=lambda: generate_motions("vall"),
        motions_of_no_family=lambda: generate_motions("val", 8, ("juggle",)),
        saved_no_clips=lambda: save_motions(folder / "none.npz", []),
        loaded_nowhere=lambda: MotionLibrary.load(str(folder / "nowhere.npz")),
        loaded_nothing=lambda: MotionLibrary.load(()),
    )
    yield from listed(
        "horizon",
        horizon_0_to_5=lambda: Horizon(0, 5),
        horizon_backward=lambda: Horizon(9, 5),
        horizon_of_halves=lambda: Horizon(0.5, 1.5),
        horizon_of_words=lambda: Horizon("a", "b"),
        horizon_of_no_name=lambda: horizon_named("never", Timing()),
        horizon_too_long=lambda: horizon_named("distant", Timing()),
        evaluated_at_no_horizon=lambda: evaluate(latent.deployed(), library, "never"),
    )
    yield from listed(
        "num_envs",
        tracking_0_robots=lambda: make_tracking_env(library, 0),
        tracking_minus_1_robots=lambda: make_tracking_env(library, -1),
        tracking_half_a_robot=lambda: make_tracking_env(library, 2.5),
        keyframes_0_robots=lambda: make_keyframe_env(library, 0),
        motions_0_robots=lambda: MotionTrackingEnv(library, 0),
        replay_of_0_robots=lambda: RolloutReplay(0, 10, ["x"]),
    )
    yield from listed(
        "decimation",
        motions_decimation_0=lambda: MotionTrackingEnv(library, 1, decimation=0),
        motions_decimation_half=lambda: MotionTrackingEnv(library, 1, decimation=0.5),
    )
    yield from listed(
        "capacity",
        replay_of_nothing=lambda: RolloutReplay(2, 0, ["x"]),
        replay_that_wraps=lambda: RolloutReplay(2, 7, ["x"]).extend(noisy),
        buffer_of_nothing=lambda: dagger_buffer(library, 0, 8),
    )
    yield from listed("batch_size", batches_of_nothing=lambda: dagger_buffer(library, 8, 0))
    yield from listed(
        "stride", stride_0=lambda: PrivilegedGoals(library, 0), stride_half=lambda: PrivilegedGoals(library, 0.5)
    )
    yield from listed(
        "expert_share",
        share_2=lambda: MixedPolicy(latent.sampled(), expert.labels(), 2.0),
        share_nan=lambda: MixedPolicy(latent.sampled(), expert.labels(), float("nan")),
    )
    yield from listed(
        "rollout",
        replay_of_a_flat_rollout=lambda: replay.extend(noisy[:, 0]),
        replay_of_other_robots=lambda: replay.extend(TensorDict.cat([noisy, noisy])),
        ppo_on_a_flat_rollout=lambda: ppo.step(rollout[:, 0]),
        motor_gradient_of_a_flat_rollout=lambda: motor_gradient(rollout[:, 0], G1),
    )
    yield from listed("'x'", replay_without_its_entry=lambda: replay.extend(noisy.exclude("x")))
    for key in (
        "loc",
        "scale",
        "action",
        "action_log_prob",
        ("next", "reward"),
        ("next", "done"),
        ("next", "truncated"),
    ):
        told = key if isinstance(key, str) else key[-1]
        yield Misuse(f"ppo without {key}", told, functools.partial(ppo.step, rollout.exclude(key)))
    for key in (("robot", "joint_pos"), ("goal", "joint_pos"), ("next", "done")):
        yield Misuse(
            f"motor gradient without {key}", key[-1], functools.partial(motor_gradient, rollout.exclude(key), G1)
        )
    yield from listed(
        "minibatches",
        more_minibatches_than_states=lambda: PPO(
            expert.head(), critic.head(), critic.observe(), PPOConfig(minibatches=1000)
        ).step(rollout),
    )
    yield from listed(
        "gradient",
        a_gradient_of_another_shape=lambda: ppo.step(rollout, gradient=torch.zeros(2, 8, 3)),
    )
    yield from listed(
        "init_std", noise_of_0=lambda: GaussianNoise(29, 0.0), noise_of_nan=lambda: GaussianNoise(29, float("nan"))
    )
    yield from listed("beta", beta_minus_1=lambda: LatentImitationLoss(latent.training_graph(), beta=-1.0))
    yield from listed(
        "prior_weight", prior_nan=lambda: LatentImitationLoss(latent.training_graph(), prior_weight=float("nan"))
    )
    yield from listed("free_bits", bits_minus_1=lambda: LatentImitationLoss(latent.training_graph(), free_bits=-1.0))
    yield from listed("widths", widths_that_do_not_fit=lambda: ObservationNormalizer(["a", "b"], 3, widths=(1, 1)))
    yield from listed("decoder", decoder_of_one_entry=lambda: latent.decoder.using("hidden"))
    yield from listed("weight", reward_of_nan=lambda: Reward("a", float("nan"), lambda before, after: 0))
    yield from listed("name", reward_without_a_name=lambda: Reward("", 1.0, lambda before, after: 0))
    yield from listed(
        "hold",
        chase_that_holds_nan=lambda: Chase(controller, sequence, simulator, hold=float("nan")),
        chase_that_holds_minus_1=lambda: Chase(controller, sequence, simulator, hold=-1.0),
    )
    yield from listed(
        "push",
        shoves_of_nan=lambda: Shoves(float("nan"), 1.0, 0, 0.02),
        shoves_every_0=lambda: Shoves(1.0, 0.0, 0, 0.02),
    )
    yield from listed(
        "robot",
        no_robot=lambda: get_robot("r2d2"),
        a_robot_of_nothing=lambda: get_robot(""),
    )
    yield from listed(
        "no such",
        no_run=lambda: SavedRun(folder / "nowhere"),
        no_policy=lambda: load_policy("nowhere"),
    )
    yield from listed(
        "keyframe",
        sequence_out_of_order=lambda: KeyframeSequence(G1, pose, (pose.at(0.5), pose.at(0.1))),
        sequence_at_nan=lambda: KeyframeSequence(G1, pose, (pose.at(float("nan")),)),
        sequence_of_nothing=lambda: KeyframeSequence(G1, pose, ()),
        sequence_with_a_long_way=lambda: KeyframeSequence(G1, pose, (pose.at(100.0),)),
    )
    yield from of_motions(clip, listed)
    yield from listed("later", a_move_back_in_time=lambda: Feasibility(G1)(pose.at(1.0), pose.at(0.5)))
    yield from listed(
        "joint_pos",
        feasibility_of_a_short_pose=lambda: Feasibility(G1)(pose, dataclasses.replace(short, time=1.0)),
        kinematics_of_less_joints=lambda: ForwardKinematics(G1)(torch.zeros(3), torch.ones(4), torch.zeros(28)),
    )
    yield from listed(
        "root_quat_w",
        kinematics_of_a_short_quaternion=lambda: ForwardKinematics(G1)(torch.zeros(3), torch.ones(3), torch.zeros(29)),
    )
    yield from listed("nobody", kinematics_of_no_body=lambda: ForwardKinematics(G1, ("nobody",)))
    yield from listed("joint_target", simulator_of_3_targets=lambda: simulator.step(np.zeros(3)))
    yield from listed("action", targets_of_28_joints=lambda: joint_target(G1, torch.zeros(2, 28)))
    yield from listed(
        "time",
        a_pose_at_nan=lambda: interpolate(pose, pose.at(1.0), float("nan")),
        a_pose_between_equal_times=lambda: interpolate(pose, pose, 0.5),
        queued_at_nan=lambda: KeyframeQueue(G1).put(pose.at(0.5), float("nan")),
    )
    yield from listed(
        "push",
        a_negative_push=lambda: Disturbance(push=-1.0),
        a_push_of_words=lambda: Disturbance("push"),
    )
    yield from listed("noise", noise_that_is_nan=lambda: Disturbance(noise=float("nan")))
    yield from listed(
        "dt",
        model_at_dt_0=lambda: DynamicsModel(G1, dt=0.0),
        model_at_dt_nan=lambda: DynamicsModel(G1, dt=float("nan")),
    )
    yield from listed("num_parameters", model_of_less_than_nothing=lambda: DynamicsModel(G1, num_parameters=-1))
    yield from listed("control_dt", description_at_dt_0=lambda: describe_robot(G1, 0.0))
    yield from listed("std", exploring_by_nan=lambda: exploring(latent.deployed(), float("nan")))
    yield from listed("horizon", a_reach_of_nothing=lambda: KeyframeReach(WalkingReach(), 0.0))
    yield from listed("stride", offsets_of_stride_0=lambda: strided_offsets(torch.tensor([3]), 0))
    yield from listed("records", report_of_nothing=lambda: report([]))
    yield from listed("seed", schedule_of_seed_minus_1=lambda: CommandSchedule(library, Horizon(1, 5), -1))
    yield from listed("network", critic_of_a_network=lambda: PPO(expert.head(), nn.Linear(3, 1), critic.observe()))


def of_motions(clip: MotionClip, listed: Callable[..., Iterator[Misuse]]) -> Iterator[Misuse]:
    """Yield broken clips for all that takes clips."""
    takers: dict[str, Callable[[MotionClip], object]] = {
        "mirror": mirror_motion,
        "limits": clip_to_limits,
        "ground": ground_feet,
        "level": level_feet,
        "cut": cut_motion,
        "steps": joint_steps,
        "smooth": smooth_steps,
        "mend": mend_motion,
        "validate": validate_motion,
        "save": lambda clip: save_motions("nowhere/a.npz", [clip]),
        "csv": lambda clip: save_csv("nowhere", clip),
    }
    broken = {
        "less_columns": dataclasses.replace(clip, qpos=clip.qpos[:, :30]),
        "nan": dataclasses.replace(clip, qpos=clip.qpos * np.nan),
        "one_frame": dataclasses.replace(clip, qpos=clip.qpos[:1]),
        "no_rate": dataclasses.replace(clip, fps=0.0),
        "a_long_quaternion": dataclasses.replace(clip, qpos=clip.qpos * 2),
    }
    for name, take in takers.items():
        calls = {f"{name}_of_{what}": functools.partial(take, wrong) for what, wrong in broken.items()}
        calls.pop("mirror_of_one_frame", None)  # a pose has a mirror image
        yield from listed(f"motion {clip.name!r}", **calls)
    yield from listed(
        "cannot lose",
        trim_by_nan=lambda: trim_motion(clip, float("nan")),
        trim_by_minus_1=lambda: trim_motion(clip, -1.0),
        trim_of_all=lambda: trim_motion(clip, 100.0, 100.0),
    )
    yield from listed("grounded", grounded_by_magic=lambda: ground_feet(clip, "magic"))  # type: ignore[arg-type]
    yield from listed("speed", steps_faster_than_nan=lambda: joint_steps(clip, float("nan")))


def faults(misuse: Misuse) -> tuple[str, str]:
    """Return what is wrong with the way in which a misuse is refused, empty if nothing is, and its message."""
    try:
        misuse.call()
    except PlatError as error:
        message = f"{type(error).__name__}: {error}"
        if "\n" in str(error):
            return "more than one line", message
        return ("" if misuse.says in str(error) else f"does not name {misuse.says!r}"), message
    except Exception as error:
        return f"raises {type(error).__name__}", str(error).partition("\n")[0][:200]
    return "was not refused", ""


def main() -> None:
    """Run the campaign; print what did not hold, and the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--verbose", action="store_true", help="print the message of every misuse")
    parser.add_argument("--kind", choices=("settings", "entries", "calls", "arguments"), help="only these")
    chosen = parser.parse_args()
    total = failed = 0
    with tempfile.TemporaryDirectory() as folder:
        kinds = {"settings": settings, "entries": entries, "calls": functools.partial(calls, Path(folder))}
        for kind, make in kinds.items():
            if chosen.kind not in (None, kind):
                continue
            results = [(misuse, *faults(misuse)) for misuse in make()]
            held = sum(not fault for _, fault, _ in results)
            for misuse, fault, message in results:
                if fault or chosen.verbose:
                    print(f"{fault or 'held'}: {misuse.name}\n    {message}")
            print(f"{kind}: {len(results)} misuses, {held} held", flush=True)
            total, failed = total + len(results), failed + len(results) - held
        if chosen.kind in (None, "arguments"):
            found = [(name, trips(call)) for name, call in misplaced(Path(folder))]
            tripped = [f"{fault}: {name}" for name, fault in found if fault]
            print(*tripped, f"arguments: {len(found)} misuses, {len(found) - len(tripped)} held", sep="\n", flush=True)
            total, failed = total + len(found), failed + len(tripped)
    print(f"{total} misuses of the API, {total - failed} held")
    sys.exit(failed > 0)


if __name__ == "__main__":
    main()
