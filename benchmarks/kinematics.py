"""Milliseconds of the positions of a robot's keypoints with their gradient: through the chain, and as plat computes it.

python benchmarks/kinematics.py            # a table, of which the ratio is what matters
"""

import argparse
import time
from collections.abc import Callable

import torch
from torch import Tensor

from plat.robots import G1, ForwardKinematics


def milliseconds(positions: Callable[..., Tensor], pose: tuple[Tensor, ...], repeats: int) -> float:
    """Milliseconds of positions and gradient, the least of five rounds after one that is not counted."""

    def compute() -> None:
        torch.autograd.grad(positions(*pose).sum(), pose)

    compute()
    rounds = []
    for _ in range(5):
        begin = time.perf_counter()
        for _ in range(repeats):
            compute()
        rounds.append(time.perf_counter() - begin)
    return 1e3 * min(rounds) / repeats


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--batches", type=int, nargs="+", default=[64, 256, 1024])
    parser.add_argument("--repeats", type=int, default=20)
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    kinematics = ForwardKinematics(G1)
    for size in options.batches:
        quat = torch.nn.functional.normalize(torch.randn(size, 4), dim=-1)
        pose = tuple(part.requires_grad_() for part in (torch.randn(size, 3), quat, torch.randn(size, G1.num_joints)))
        traced = milliseconds(lambda *parts: kinematics(*parts)[0], pose, options.repeats)
        geometric = milliseconds(kinematics.positions, pose, options.repeats)
        print(f"{size:5d} robots: {traced:.2f} ms, {geometric:.2f} ms ({traced / geometric:.1f})", flush=True)


if __name__ == "__main__":
    main()
