"""Benchmark of each layer's cost over bare physics, as ratios in one run.

python benchmarks/run.py            # the table
python benchmarks/run.py --check    # has anything become slower?

Every layer is timed in turn, several rounds over, and each round's rate is divided by the bare physics of the same
round: what else the machine does at the time hits both. Medians over rounds are printed; docs/speed.md says what
each row is. ``--json benchmarks/expected/amx.json`` writes what ``--check`` compares with, on CPUs with AMX.
"""

import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import torch
import tyro
from beyond import in_workers, large_library, on_warp
from costs import Cost, costs
from guard import TOLERANCE, Figures, compared, figure, read_figures, write_figures
from rounds import bfloat16_unit, in_rounds, machine
from torch import Tensor
from torchrl.envs import TransformedEnv

from plat.collectors import ExpertLabels, dagger_buffer, rollouts, simulation_threads
from plat.envs import (
    BatchedPhysics,
    DistillationTaskConfig,
    KeyframeTaskConfig,
    SimulationConfig,
    TrackingTaskConfig,
    make_keyframe_env,
    make_tracking_env,
)
from plat.envs.transforms import NoiseLevels, RandomizationRanges
from plat.errors import PlatError
from plat.modules import STUDENT_KEYS, Critic, Expert, LatentPolicy
from plat.motions import MotionLibrary
from plat.objectives import PPO, LatentImitationLoss, autocast, motor_gradient
from plat.robots import G1
from plat.runs import report_errors

STEPS = 24
BARE = "bare physics"
EXPECTED = Path(__file__).parent / "expected" / f"{bfloat16_unit()}.json"
"""Updates are so much faster with some CPUs than with others, beside physics, that each kind has its own."""


@dataclass(kw_only=True)
class BenchmarkConfig:
    """Settings of the benchmark of each layer over bare physics."""

    motions: tuple[str, ...] = ("generated:train",)
    """motion files, folders or globs"""
    num_envs: int = 1024
    """robots simulated in parallel"""
    rounds: int = 5
    """rounds of measurement"""
    costs: bool = True
    """measure a loss step, the deployed policy, imports and the motion library as well"""
    library_seconds: float = 10_000.0
    """length of that library (s)"""
    beyond: bool = True
    """measure robots in one and two workers, MuJoCo Warp on the CPU, and a large library as well"""
    large_clips: int = 20_000
    """clips of the large library"""
    large_hours: float = 3.0
    """its length, a kilobyte a frame on disk"""
    json: Path | None = None
    """file to write the results to"""
    check: bool = False
    """compare with results of this kind of CPU in benchmarks/expected; fail when one is more than 15 %
    worse"""


def reference_targets(library: MotionLibrary, frame: Tensor) -> Tensor:
    """Joint targets on the reference, with the noise of a policy that explores."""
    target = library.poses((frame + 1).minimum(library.last_of(frame)))["joint_pos"]
    return target + 0.35 * G1.action_scale * torch.randn_like(target)


class Timer:
    """Timer of the relevant part of a measurement, and of the physics in it."""

    def start(self) -> None:
        self.physics = 0.0
        self._began = time.perf_counter()

    def stop(self) -> None:
        self.seconds = time.perf_counter() - self._began


TIMER = Timer()


class TimedPhysics(BatchedPhysics):
    """Physics that reports the time of its steps to a timer."""

    def step(self, ctrl: Tensor, nstep: int) -> None:
        """Hold the joint targets for some physics steps."""
        began = time.perf_counter()
        super().step(ctrl, nstep)
        TIMER.physics += time.perf_counter() - began


def bare_physics(library: MotionLibrary, count: int) -> Callable[[], None]:
    """Return a run of bare ``mujoco.batch``: robots are reset onto the reference, then driven along it."""
    physics = TimedPhysics(G1.model(), count)

    def measure() -> None:
        frame = torch.randint(len(library), (count,))
        still = torch.zeros(count, 6 + G1.num_joints)
        physics.set_state(torch.arange(count), library.qpos(frame).double(), still)
        targets = [reference_targets(library, (frame + step).minimum(library.last_of(frame))) for step in range(STEPS)]
        with simulation_threads(count):
            TIMER.start()
            for target in targets:
                physics.step(target, nstep=4)
            TIMER.stop()

    return measure


def environment(make: Callable, config: SimulationConfig, library: MotionLibrary, count: int) -> Callable[[], None]:
    """Return a run of the environment with all training transforms."""
    env = make(library, count, config, physics=TimedPhysics)
    state = [env.reset()]

    def measure() -> None:
        noise = [0.35 * torch.randn(count, G1.num_joints) for _ in range(STEPS)]
        current = state[0]
        with simulation_threads(count):
            TIMER.start()
            for extra in noise:
                frame = current["motion", "frame"]
                target = library.poses((frame + 1).minimum(library.last_of(frame)))["joint_pos"]
                current["action"] = (target - G1.default_joint_pos) / G1.action_scale + extra
                _, current = env.step_and_maybe_reset(current)
            TIMER.stop()
        state[0] = current

    return measure


def collection(env: TransformedEnv, learn: bool, steps: int = STEPS) -> Callable[[], None]:
    """Return a run of TorchRL's collector with the expert acting; with ``learn`` a whole PPO iteration."""
    expert = Expert(G1)
    critic = Critic(G1, expert.normalizer.in_keys)
    ppo = PPO(expert.head(), critic.head(), critic.observe())
    batches = rollouts(env, expert.actor(), steps)

    def measure() -> None:
        TIMER.start()
        rollout = next(batches)
        if learn:
            ppo.step(rollout, gradient=motor_gradient(rollout, G1))
            expert.normalizer.update(rollout)
            critic.normalizer.update(rollout)
        TIMER.stop()

    return measure


def distillation(env: TransformedEnv) -> Callable[[], None]:
    """Return a run of stage 2: states labeled, with four gradient steps of 2048 for every 4096 of them."""
    expert = Expert(G1).deployed("dense_goal", out_key="expert_action")
    student = LatentPolicy(G1)
    loss = LatentImitationLoss(student.training_graph())
    optimizer = torch.optim.Adam(student.parameters(), lr=1e-3, fused=True)
    buffer = dagger_buffer(env.library, 100_000, 2048, stride=5)
    batches = rollouts(env, student.sampled(), STEPS)
    labeled = ExpertLabels(expert, STUDENT_KEYS)

    def measure() -> None:
        TIMER.start()
        states = labeled(next(batches))
        buffer.extend(states)
        student.update_normalizers(states)
        for _ in range(env.num_envs * STEPS // 1024):
            with autocast("cpu", "auto"):
                losses = loss(buffer.sample())
            optimizer.zero_grad()
            (losses["loss_posterior"] + losses["loss_prior"] + losses["loss_kl"]).backward()
            optimizer.step()
        TIMER.stop()

    return measure


def steps_per_second(measure: Callable[[], None], steps: int) -> float:
    """Return the steps per second of a layer."""
    measure()
    return steps / TIMER.seconds


def physics_share() -> float:
    """Return the fraction of its time that the last measured layer spent in physics."""
    return TIMER.physics / TIMER.seconds


def main(config: BenchmarkConfig) -> None:
    """Measure and print.

    Raises:
        PlatError: when there is nothing to check against.
    """
    if config.check and not EXPECTED.exists():
        raise PlatError(f"--check: no figures of a CPU like this one yet; --json {EXPECTED} writes them")
    committed = read_figures(EXPECTED) if config.check else None
    torch.manual_seed(0)
    library = MotionLibrary.load(config.motions)
    count = config.num_envs
    tracking = TrackingTaskConfig(noise=NoiseLevels(), randomization=RandomizationRanges())
    keyframes = KeyframeTaskConfig(noise=NoiseLevels(), randomization=RandomizationRanges())
    make_env = partial(make_tracking_env, library, count, tracking, physics=TimedPhysics)
    stage_2 = make_keyframe_env(library, count, DistillationTaskConfig(), physics=TimedPhysics)
    layers = {
        BARE: bare_physics(library, count),
        "environment, dense tracking": environment(make_tracking_env, tracking, library, count),
        "environment, timed keyframes": environment(make_keyframe_env, keyframes, library, count),
        "+ policy and collector": collection(make_env(), learn=False),
        "whole PPO iteration": collection(make_env(), learn=True),
        "whole DAgger iteration": distillation(stage_2),
    }
    with TemporaryDirectory() as folder, ExitStack() as stack:
        steps = count * STEPS
        rows = {name: Cost("steps/s", partial(steps_per_second, layer, steps)) for name, layer in layers.items()}
        if config.costs:
            rows |= costs(library, Path(folder), config.library_seconds)
        if config.beyond:
            rows |= in_workers(library, count, tracking, STEPS, stack)
            rows |= on_warp(library, STEPS)
            rows |= large_library(Path(folder), config.large_clips, config.large_hours)
        measures: dict[str, Callable[[], float]] = {}
        for name, cost in rows.items():
            measures[name] = cost.measure
            if name in layers:
                measures[f"{name}/physics"] = physics_share  # right after it, while the timer is still its own
        values = in_rounds(measures, config.rounds)
    figures = {
        name: figure(values[name], row.unit, values[BARE], values.get(f"{name}/physics", ()))
        for name, row in rows.items()
    }
    measured = Figures(torch.get_num_threads(), count, figures)
    print(f"{machine()}, {count} robots")
    for name, row in figures.items():
        print(f"{name:<52}{row}")
    if config.json is not None:
        write_figures(config.json, measured)
    if committed is not None:
        regressions, remarks = compared(measured, committed)
        print("\n".join(["", *remarks]))
        if regressions:
            sys.exit("\n".join(["slower than committed:", *regressions]))
        print(f"nothing is more than {TOLERANCE:.0%} worse than committed")


if __name__ == "__main__":
    with report_errors():
        main(tyro.cli(BenchmarkConfig))
