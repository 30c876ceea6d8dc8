"""Seconds of an update of model and policy on a GPU: kernels asked for one by one, and as one CUDA graph.

python benchmarks/graphs.py            # a table, of which the ratio is what matters; needs a GPU
"""

import argparse
import itertools
import time

import torch
from tensordict import TensorDict

from plat.modules import DynamicsConfig, DynamicsModel, PlainPolicy, PlainPolicyConfig
from plat.motions import MotionLibrary, generate_motions
from plat.objectives import DynamicsLoss, GraphedLoss, ImaginationLoss
from plat.spec.timing import Timing
from plat.tasks import TimedKeyframes, TimedKeyframesConfig


def seconds(loss: GraphedLoss, batch: TensorDict, repeats: int) -> float:
    """Seconds of an update, after one that is not counted."""
    loss.backward(batch)
    torch.cuda.synchronize()
    begin = time.perf_counter()
    for _ in range(repeats):
        loss.backward(batch)
    torch.cuda.synchronize()
    return (time.perf_counter() - begin) / repeats


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--batches", type=int, nargs="+", default=[512, 2048, 4096])
    parser.add_argument("--steps", type=int, default=32)
    parser.add_argument("--repeats", type=int, default=10)
    options = parser.parse_args()
    device = torch.device("cuda")
    library = MotionLibrary.from_clips(generate_motions("train", seconds=60)).to(device)
    policy = PlainPolicy(library.robot, PlainPolicyConfig(also=("parts", "clock"), timing=Timing(max_steps=150))).to(
        device
    )
    model = DynamicsModel(library.robot, DynamicsConfig()).to(device)
    config = TimedKeyframesConfig(chains=600, partial=0.35)
    task = TimedKeyframes(library, config, timing=policy.config.timing).to(device)
    policy_loss = ImaginationLoss(policy.deployed(), model, task, steps=options.steps)
    print(f"{torch.cuda.get_device_name()}, torch {torch.__version__}, {options.steps} imagined steps")
    for what, batch_size in itertools.product(("policy", "model"), options.batches):
        state, memory = task.start(batch_size)
        batch = TensorDict({"robot_state": state.pack(), "memory": memory}, [batch_size], device=device)
        loss: torch.nn.Module = policy_loss
        weights = list(policy.parameters())
        if what == "model":
            packed = state.pack()[:, None].expand(-1, 9, -1)
            actions = torch.zeros(batch_size, 9, library.robot.num_joints, device=device)
            batch = TensorDict({"robot_state": packed, "action": actions}, [batch_size, 9], device=device)
            loss, weights = DynamicsLoss(model), list(model.parameters())
        one_by_one = seconds(GraphedLoss(loss, weights, device, capture=False), batch, 2)
        begin = time.perf_counter()
        graphed = GraphedLoss(loss, weights, device)
        graphed.backward(batch)
        captured = time.perf_counter() - begin
        graph = seconds(graphed, batch, options.repeats)
        print(
            f"{what} {batch_size:5d}: {1e3 * one_by_one:7.1f} ms one by one, {1e3 * graph:6.1f} ms as a graph, "
            f"{one_by_one / graph:.1f} times as fast; captured in {captured:.1f} s, "
            f"{torch.cuda.max_memory_allocated() / 1e9:.1f} GB",
            flush=True,
        )


if __name__ == "__main__":
    main()
