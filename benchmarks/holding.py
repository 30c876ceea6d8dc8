"""How long a policy holds a pose, and whether it steps on the spot.

python benchmarks/holding.py --policy imagined-g1 --seconds 60
"""

from dataclasses import dataclass, replace
from pathlib import Path

import torch
import tyro

from plat.control import author, resting_poses
from plat.evaluation.authored_scores import AuthoredRecords, AuthoredScore, evaluate_authored
from plat.motions import MotionLibrary
from plat.runs import load_policy, report_errors
from plat.spec.timing import Timing, timing_of


@dataclass(kw_only=True)
class HoldingConfig:
    """Settings of the benchmark of holding."""

    policy: Path
    """run, or a name such as plat-g1"""
    motions: tuple[str, ...] = ("generated:val",)
    """motion files, folders or globs with poses at rest"""
    seconds: float = 60.0
    """length of each hold (s)"""
    count: int = 20
    """holds of resting poses, and as many of the last poses of arms, crouch and reach"""
    seed: int = 0
    """draws the poses"""


def main(config: HoldingConfig) -> AuthoredRecords:
    """Run the benchmark: print a row a family, return the records."""
    policy = load_policy(config.policy)
    robot, deployed = policy.robot, policy.deployed()
    resting = resting_poses(MotionLibrary.load(config.motions, robot))
    timing = timing_of(deployed) or Timing()
    chains = [
        replace(chain, hold=config.seconds)
        for family in ("hold", "arms", "crouch", "reach")
        for chain in author(family, robot, config.count, config.seed, resting, timing)
    ]
    records = evaluate_authored(deployed, robot, chains)
    print(f"{'':<8}{'held for ' + format(config.seconds, 'g') + ' s %':>18}{'stepped %':>11}{'foot travel m':>15}")
    for family in dict.fromkeys(records.family):
        rows = torch.tensor([name == family for name in records.family])
        upright, held = ~records.fell[rows], records.held[rows]
        stepped = AuthoredScore.of(records, family).stepped[0]
        travel = float(records.foot_travel[rows][held].median()) if bool(held.any()) else float("nan")
        print(f"{family:<8}{100 * float(upright.double().mean()):>18.1f}{stepped:>11.1f}{travel:>15.3f}")
    print("held: without a fall; feet: of these, where the keyframe was reached, and the robot in it after a second")
    print("stepped: of poses that can be held at rest; foot travel: the median")
    return records


if __name__ == "__main__":
    with report_errors():
        main(tyro.cli(HoldingConfig, description=__doc__))
