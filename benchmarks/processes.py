"""Seconds of a gradient of policy and model on a CPU: by one process with one thread and with all, and by several.

python benchmarks/processes.py            # a table, of which the ratio is what matters
"""

import argparse
import itertools
import time

import torch
from tensordict import TensorDict

from plat.envs.physics import available_cpus
from plat.modules import DynamicsConfig, DynamicsModel, PlainPolicy, PlainPolicyConfig
from plat.motions import MotionLibrary, generate_motions
from plat.objectives import DynamicsLoss, GraphedLoss, ImaginationLoss, ParallelGradients
from plat.spec.timing import Timing
from plat.tasks import TimedKeyframes, TimedKeyframesConfig

CPU = torch.device("cpu")


def seconds(gradients: ParallelGradients, name: str, batch: TensorDict, repeats: int) -> float:
    """Seconds of a batch, after some that are not counted."""
    batches = [batch] * gradients.processes
    list(gradients.backward(name, batches))
    begin = time.perf_counter()
    for _ in range(repeats):
        list(gradients.backward(name, batches))
    return (time.perf_counter() - begin) / repeats / len(batches)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--batches", type=int, nargs="+", default=[128, 256, 512])
    parser.add_argument("--processes", type=int, nargs="+", default=[available_cpus()])
    parser.add_argument("--steps", type=int, default=24)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    library = MotionLibrary.from_clips(generate_motions("train", seconds=60))
    policy = PlainPolicy(library.robot, PlainPolicyConfig(also=("parts", "clock"), timing=Timing(max_steps=150)))
    model = DynamicsModel(library.robot, DynamicsConfig())
    task = TimedKeyframes(library, TimedKeyframesConfig(chains=600, partial=0.35), timing=policy.config.timing)
    imagined = ImaginationLoss(policy.deployed(), model, task, steps=options.steps)
    losses = {
        "policy": GraphedLoss(imagined, policy.parameters(), CPU),
        "model": GraphedLoss(DynamicsLoss(model), model.parameters(), CPU),
    }
    cpus = torch.get_num_threads()
    print(f"{available_cpus()} CPUs, torch {torch.__version__}, {options.steps} imagined steps")
    for name, size in itertools.product(losses, options.batches):
        state, memory = task.start(size)
        packed, joints = state.pack(), library.robot.num_joints
        batch = TensorDict({"robot_state": packed, "memory": memory}, [size])
        if name == "model":
            windows = packed[:, None].repeat(1, 9, 1)
            batch = TensorDict({"robot_state": windows, "action": torch.zeros(size, 9, joints)}, [size, 9])
        took = {}
        for threads in sorted({1, cpus}):
            torch.set_num_threads(threads)
            with ParallelGradients(losses, [policy, model]) as gradients:
                took[f"1 process, {threads} threads"] = seconds(gradients, name, batch, options.repeats)
        for processes in options.processes:
            with ParallelGradients(losses, [policy, model], processes) as gradients:
                took[f"{processes} processes"] = seconds(gradients, name, batch, options.repeats)
        alone = next(iter(took.values()))
        told = ", ".join(f"{what} {1e3 * each:.0f} ms ({alone / each:.2f})" for what, each in took.items())
        print(f"{name} {size:4d}: {told}", flush=True)


if __name__ == "__main__":
    main()
