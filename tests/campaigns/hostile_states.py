"""Hostile states and targets: no command of the safe runner leaves its limits.

python -m tests.campaigns.hostile_states --steps 100000

A policy that answers with anything is given states of every kind that a broken robot, driver or network might send.
After every control step range, rate, gains and numbers of the command are checked.
"""

import argparse
import logging
from collections import Counter

import numpy as np

from plat.deploy.safety import SafeRunner, SafetySettings
from tests.deploy.safety.stand_ins import DT, ROBOT, Commands, HostileStates, hostile_policy


def run(steps: int, seed: int = 0) -> Counter[str]:
    """Run a campaign; return how many steps were spent in each mode, and how often each piece stepped in.

    Raises:
        AssertionError: for a command outside its limits.
    """
    settings = SafetySettings(ramp=0.5, range_margin=0.01)
    source = Commands(8.0)
    runner, states = SafeRunner(hostile_policy(seed), source, settings), HostileStates(seed)
    random = np.random.default_rng(seed)
    low, high = ROBOT.joint_range[:, 0] + 0.01, ROBOT.joint_range[:, 1] - 0.01
    counts: Counter[str] = Counter()
    before, now, damped = None, 0.0, 0
    for _ in range(steps):
        now += DT * random.choice([1.0, 1.0, 1.0, 0.5, 2.0])
        state, stamp = states(now)
        command = runner.step(now, state, stamp)
        assert command.position.shape == (29,)
        assert np.isfinite(command.position).all()
        assert (command.position >= low).all()
        assert (command.position <= high).all()
        stiff = bool(command.stiffness.any())
        np.testing.assert_array_equal(command.stiffness, ROBOT.stiffness if stiff else 0.0)
        np.testing.assert_array_equal(command.damping, ROBOT.damping)
        if stiff and before is not None:
            assert np.abs(command.position - before).max() <= settings.rate * DT + 1e-9
        before = command.position if stiff else None
        counts[runner.mode] += 1
        damped = damped + 1 if runner.mode == "damping" else 0
        if damped > 5:  # someone has looked, and starts it again
            counts.update(f"stepped in: {entry.piece}" for entry in runner.journal)
            runner.journal.clear()
            runner.reset()
            before, damped = None, 0
    counts.update(f"stepped in: {entry.piece}" for entry in runner.journal)
    return counts


def main() -> None:
    """Run it from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    logging.getLogger("plat.deploy.safety").setLevel(logging.ERROR)
    for name, count in run(arguments.steps, arguments.seed).most_common():
        print(f"{name:<30}{count:>8}")
    print(f"{arguments.steps} steps, no command outside its limits")


if __name__ == "__main__":
    main()
