"""Bytes that pass between learner and workers, for each control step of a robot.

python benchmarks/workers.py [--num-envs 512]

Sizes are exact and hardly depend on the machine: no clock is read.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

from plat.collectors import Rollouts
from plat.collectors.packing import packed
from plat.envs import TrackingTaskConfig, make_tracking_env
from plat.modules import Expert
from plat.motions import MotionLibrary, generate_motions
from plat.robots import G1
from plat.tasks import DenseTracking, SimulatedTask


@dataclass(frozen=True)
class Sizes:
    """Bytes of one exchange with a worker.

    Attributes:
        steps: control steps of the rollout, all robots together.
        rollout: bytes of the rollout, from a worker.
        state: bytes of the robots' state, from a worker.
        weights: bytes of the policy, to a worker.
    """

    steps: int
    rollout: int
    state: int
    weights: int

    def line(self, name: str) -> str:
        """Return a row of the table."""
        each = (value / self.steps for value in (self.rollout, self.state, self.weights))
        return f"| {name} | {' | '.join(f'{value:,.0f}' for value in each)} | {self.weights / 1e6:.2f} MB |"


def measured(num_envs: int) -> dict[str, Sizes]:
    """Return the sizes of one worker's exchange, by recipe."""
    library = MotionLibrary.from_clips(generate_motions("train", seconds=30))
    expert = Expert(G1)
    acting, quiet = expert.actor(), expert.deployed().reset_out_keys()
    tracking = make_tracking_env(library, num_envs, TrackingTaskConfig(), goals=expert.goals)
    task = SimulatedTask(DenseTracking(library, expert.goals), num_envs)
    kinds = {"plat expert": (tracking, acting, 24), "plat expert-model": (task, quiet, 8)}
    return {name: sizes_of(Rollouts(env, policy, steps), policy) for name, (env, policy, steps) in kinds.items()}


def sizes_of(source: Rollouts, policy: object) -> Sizes:
    """Return the sizes of the next rollout and of what passes with it."""
    rollout = next(source)
    weights = packed(policy.state_dict())  # type: ignore[attr-defined]
    return Sizes(rollout.numel(), rollout.bytes(), len(packed(source.state_dict())), len(weights))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--num-envs", type=int, default=512, help="robots of a worker")
    options = parser.parse_args(arguments)
    print("| bytes a step | rollout | state | weights | weights, each rollout |\n|---|---|---|---|---|")
    for name, sizes in measured(options.num_envs).items():
        print(sizes.line(name))


if __name__ == "__main__":
    main()
