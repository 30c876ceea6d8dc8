"""Seconds of an iteration of `plat imagine`: one after the other, and with robots and model beside the policy.

python benchmarks/overlap.py            # a table, of which the ratio is what matters
"""

import argparse
import time
from contextlib import closing
from dataclasses import replace
from typing import Any

import torch

from plat.collectors import RolloutReplay, collect
from plat.envs.physics import available_cpus
from plat.modules import DynamicsConfig, DynamicsModel, PlainPolicy, PlainPolicyConfig
from plat.motions import MotionLibrary, generate_motions
from plat.objectives import ImaginationConfig, ImaginationLearner, exploring
from plat.spec.timing import Timing
from plat.tasks import SimulatedTask, TimedKeyframes, TimedKeyframesConfig

ROBOTS, UNCOUNTED = 512, 3


def make_task(library: MotionLibrary) -> TimedKeyframes:
    """Keyframes of all kinds, up to 3 s ahead."""
    return TimedKeyframes(library, TimedKeyframesConfig(chains=600, partial=0.35), timing=Timing(max_steps=150))


def simulated(library: MotionLibrary, num_envs: int, **options: Any) -> SimulatedTask:
    """Robots with that task."""
    return SimulatedTask(make_task(library), num_envs, **options)


def seconds(overlap: bool, rollout: int, config: ImaginationConfig, repeats: int) -> float:
    """Seconds of an iteration, after some that are not counted."""
    library = MotionLibrary.from_clips(generate_motions("train", seconds=60))
    task = make_task(library)
    policy = PlainPolicy(library.robot, PlainPolicyConfig(also=("parts", "clock"), timing=task.timing))
    model = DynamicsModel(library.robot, DynamicsConfig())
    replay = RolloutReplay(ROBOTS, 20 * rollout, ["robot_state", "memory", "action"])
    learner = ImaginationLearner(policy, policy.deployed(), model, task, config, overlap=overlap)
    acts = exploring(policy.deployed(), 0.25)
    with (
        closing(learner),
        collect(simulated, library, ROBOTS, acts, rollout, workers=int(overlap), ahead=True) as source,
    ):
        for iteration in range(UNCOUNTED + repeats):
            if iteration == UNCOUNTED:
                begin = time.perf_counter()
            rolled = next(source)
            replay.extend(rolled)
            learner.observe(rolled)
            learner.step(replay)
        return (time.perf_counter() - begin) / repeats


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=10)
    options = parser.parse_args()
    cpus = torch.get_num_threads()
    plain = replace(ImaginationConfig(), warmup=0, settle=0)
    more = replace(plain, model_updates=12)
    cells = [
        *((f"in turn, {threads} threads", False, threads, 8, plain) for threads in sorted({1, cpus})),
        ("beside each other", True, cpus, 8, plain),
        (f"in turn, {cpus} threads, 16 steps a rollout and 12 updates of the model", False, cpus, 16, more),
        ("beside each other, 16 steps a rollout and 12 updates of the model", True, cpus, 16, more),
    ]
    print(f"{available_cpus()} CPUs, torch {torch.__version__}, {ROBOTS} robots")
    first = None
    for name, overlap, threads, rollout, config in cells:
        torch.set_num_threads(threads)
        took = seconds(overlap, rollout, config, options.repeats)
        first = first or took
        print(f"{took:6.2f} s, {first / took:.2f} times as fast: {name}", flush=True)


if __name__ == "__main__":
    main()
