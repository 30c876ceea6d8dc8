"""Cost of each layer over bare physics, as ratios in one run.

python benchmarks/run.py

Every layer is timed in turn, several rounds over, and each round's rate is divided by the bare physics of the same
round: what else the machine does at the time hits both. Medians over rounds are printed.
"""

import json
import platform
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch
import tyro
from torch import Tensor

from plat.collectors import ExpertLabels, dagger_buffer, rollouts, simulation_threads
from plat.envs import G1, BatchedPhysics, MotionLibrary, TaskConfig, make_keyframe_env, make_tracking_env
from plat.modules import STUDENT_KEYS, Critic, Expert, LatentPolicy
from plat.objectives import PPO, LatentImitationLoss, autocast

STEPS = 24


@dataclass(kw_only=True)
class BenchmarkConfig:
    """Cost of each layer over bare physics."""

    motions: tuple[str, ...] = ("generated:train",)
    """motion files, folders or globs"""
    num_envs: int = 1024
    """robots that are simulated at a time"""
    rounds: int = 5
    """times that everything is measured"""
    json: Path | None = None
    """file to write the figures to"""


def reference_targets(library: MotionLibrary, frame: Tensor) -> Tensor:
    """Joint targets on the reference, with the noise of a policy that explores."""
    target = library.poses((frame + 1).minimum(library.last_frame[frame]))["joint_pos"]
    return target + 0.35 * G1.action_scale * torch.randn_like(target)


def bare_physics(library: MotionLibrary, count: int) -> Callable[[], None]:
    """Nothing but ``mujoco.batch``: robots put on the reference, then driven along it."""
    physics = BatchedPhysics(G1.model(), count)

    def measure() -> None:
        frame = torch.randint(len(library), (count,))
        pose = library.poses(frame)
        qpos = torch.cat((pose["keypoint_pos"][:, 0], pose["keypoint_quat"][:, 0], pose["joint_pos"]), -1)
        physics.set_state(torch.arange(count), qpos.double(), torch.zeros(count, 35, dtype=torch.float64))
        targets = [
            reference_targets(library, (frame + step).minimum(library.last_frame[frame])) for step in range(STEPS)
        ]
        with simulation_threads(count):
            TIMER.start()
            for target in targets:
                physics.step(target, nstep=4)
            TIMER.stop()

    return measure


class Timer:
    """Times the part of a measurement that counts."""

    def start(self) -> None:
        self._began = time.perf_counter()

    def stop(self) -> None:
        self.seconds = time.perf_counter() - self._began


TIMER = Timer()


def environment(make: Callable, library: MotionLibrary, count: int) -> Callable[[], None]:
    """All training transforms: rewards, terminations, resets, goals, critic's entries, noise, randomisation."""
    env = make(library, count, TaskConfig(observation_noise=True, domain_randomization=True))
    state = [env.reset()]

    def measure() -> None:
        noise = [0.35 * torch.randn(count, 29) for _ in range(STEPS)]
        current = state[0]
        with simulation_threads(count):
            TIMER.start()
            for extra in noise:
                frame = current["motion", "frame"]
                target = library.poses((frame + 1).minimum(library.last_frame[frame]))["joint_pos"]
                current["action"] = (target - G1.default_joint_pos) / G1.action_scale + extra
                _, current = env.step_and_maybe_reset(current)
            TIMER.stop()
        state[0] = current

    return measure


def collection(library: MotionLibrary, count: int, learn: bool) -> Callable[[], None]:
    """TorchRL's collector with the expert acting; and with ``learn`` a whole PPO iteration."""
    env = make_tracking_env(library, count, TaskConfig(observation_noise=True, domain_randomization=True))
    expert = Expert(G1)
    critic = Critic(G1, expert.normalizer.in_keys)
    ppo = PPO(expert.head(), critic.head(), critic.observe())
    batches = rollouts(env, expert.actor(), STEPS)

    def measure() -> None:
        TIMER.start()
        rollout = next(batches)
        if learn:
            ppo.step(rollout)
            expert.normalizer.update(rollout)
            critic.normalizer.update(rollout)
        TIMER.stop()

    return measure


def distillation(library: MotionLibrary, count: int) -> Callable[[], None]:
    """Stage 2: states collected and labelled, and four gradient steps of 2048 for every 4096 of them."""
    expert = Expert(G1).deployed("dense_goal", out_key="expert_action")
    student = LatentPolicy(G1)
    loss = LatentImitationLoss(student.training_graph())
    optimizer = torch.optim.Adam(student.parameters(), lr=1e-3, fused=True)
    buffer = dagger_buffer(library, 100_000, 2048, stride=5)
    task = TaskConfig(dense_weight=0, sparse_weight=0, regularisation_weight=0)
    batches = rollouts(make_keyframe_env(library, count, task), student.sampled(), STEPS)
    labelled = ExpertLabels(expert, STUDENT_KEYS)

    def measure() -> None:
        TIMER.start()
        states = labelled(next(batches))
        buffer.extend(states)
        student.update_normalizers(states)
        for _ in range(count * STEPS // 1024):
            with autocast("cpu", "auto"):
                losses = loss(buffer.sample())
            optimizer.zero_grad()
            (losses["loss_posterior"] + losses["loss_prior"] + losses["loss_kl"]).backward()
            optimizer.step()
        TIMER.stop()

    return measure


def main(config: BenchmarkConfig) -> None:
    """Measure and print."""
    torch.manual_seed(0)
    library = MotionLibrary.load(config.motions)
    count = config.num_envs
    layers = {
        "bare physics": bare_physics(library, count),
        "environment, dense tracking": environment(make_tracking_env, library, count),
        "environment, timed keyframes": environment(make_keyframe_env, library, count),
        "+ policy and collector": collection(library, count, learn=False),
        "whole PPO iteration": collection(library, count, learn=True),
        "whole DAgger iteration": distillation(library, count),
    }
    rates: dict[str, list[float]] = {name: [] for name in layers}
    for number in range(config.rounds + 1):
        for name, measure in layers.items():
            measure()
            if number > 0:  # the first round warms up
                rates[name].append(count * STEPS / TIMER.seconds)
    print(f"{platform.processor() or platform.machine()}, {torch.get_num_threads()} threads, {count} robots")
    print(f"{'':<32}{'steps/s':>10}{'of bare physics':>18}")
    figures = {}
    for name, values in rates.items():
        ratio = statistics.median(value / bare for value, bare in zip(values, rates["bare physics"], strict=True))
        figures[name] = {"steps_per_second": statistics.median(values), "ratio": ratio}
        print(f"{name:<32}{statistics.median(values):>10,.0f}{ratio:>17.0%}")
    if config.json is not None:
        config.json.write_text(json.dumps(figures, indent=2) + "\n")


if __name__ == "__main__":
    main(tyro.cli(BenchmarkConfig))
