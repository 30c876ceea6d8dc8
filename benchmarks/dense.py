"""How well an expert tracks a dense reference: each clip once, from its first frame.

python benchmarks/dense.py expert-g1 runs/expert --motions bandai_val.npz hard_free_val.npz

A robot has failed when its root is 0.25 m too high or low, 0.6 m off, or tilted otherwise than the reference; what
comes after does not count. Errors are means over the frames before.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import torch
import tyro

from plat.modules import Expert
from plat.motions import MotionLibrary
from plat.runs import SavedRun, report_errors
from plat.tasks import DenseTracking, SimulatedTask


@dataclass(kw_only=True)
class DenseConfig:
    """Settings of the benchmark of dense tracking."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """experts: runs, or names such as expert-g1"""
    motions: tuple[str, ...]
    """motion files; each is a row"""
    clips: int = 64
    """clips of a file, evenly spread over it; 0 for all"""
    seconds: float = 8.0
    """longest time that a clip is followed (s)"""
    threads: int = 1
    """threads of the physics"""


@dataclass(frozen=True)
class DenseScore:
    """Score of dense tracking on some clips."""

    clips: int
    """number of clips"""
    failed: int
    """clips on which the robot failed"""
    seconds: float
    """time that robots were up (s)"""
    joint: float
    """mean error of the joint angles (rad)"""
    aligned: float
    """mean error of the keypoints from the root on, in world axes (m)"""
    world: float
    """mean error of the keypoints (m)"""


class FromFirstFrame(DenseTracking):
    """Dense tracking in which robot i follows clip i of ``frames``, without noise."""

    def __init__(self, library: MotionLibrary, expert: Expert, frames: torch.Tensor):
        super().__init__(library, expert.goals, reset_noise=None)
        self.frames = frames

    def start(self, count: int):  # type: ignore[no-untyped-def]
        """Return the first frames of the clips."""
        return self.at(self.frames[:count])


@torch.no_grad()
def score(
    expert: Expert, library: MotionLibrary, clips: int = 64, seconds: float = 8.0, threads: int = 1
) -> DenseScore:
    """Let an expert follow clips; return how well it did."""
    count = min(clips or library.num_clips, library.num_clips)
    ids = torch.linspace(0, library.num_clips - 1, count).long()
    last = library.last_frame[library.clip_start[ids]]
    env = SimulatedTask(FromFirstFrame(library, expert, library.clip_start[ids]), count, num_threads=threads)
    actor, names = expert.deployed(tuple(expert.goals)), list(library.robot.keypoints)
    state = env.reset()
    up, failed, frames, errors = torch.ones(count, dtype=torch.bool), 0, 0, torch.zeros(3)
    for _ in range(round(seconds / library.dt)):
        state = env.step(actor(state))["next"]
        frame = state["memory", "frame"]
        fell = state["terminated"][:, 0] & up
        failed, up = failed + int(fell.sum()), up & ~fell
        reference = library.states(frame)
        body, goal = env.physics.kinematics(names).body_pos_w, reference["keypoint_pos"]
        root_off = (body - goal)[:, :1]
        joint_pos = state["robot_state"][:, 7 : 7 + library.robot.num_joints]
        errors += torch.stack(
            (
                (joint_pos - reference["joint_pos"]).abs().mean(1)[up].sum(),
                (body - goal - root_off).norm(dim=-1).mean(1)[up].sum(),
                (body - goal).norm(dim=-1).mean(1)[up].sum(),
            )
        )
        frames += int(up.sum())
        up = up & (frame < last)
        if not up.any():
            break
    joint, aligned, world = (errors / max(frames, 1)).tolist()
    return DenseScore(count, failed, frames * library.dt, joint, aligned, world)


def main(config: DenseConfig) -> dict[tuple[str, str], DenseScore]:
    """Run the benchmark: print a row for each expert and file, return the scores."""
    experts = {str(run): SavedRun(run).policy_as(Expert, "an expert") for run in config.runs}
    libraries = {path: MotionLibrary.load(path) for path in config.motions}
    width = max(len(name) for name in experts)
    print(f"{'':<{width}}  motions{'':<18} failed   a second  joint rad  aligned mm  world mm")
    scores = {}
    for name, expert in experts.items():
        for path, library in libraries.items():
            found = scores[name, path] = score(expert, library, config.clips, config.seconds, config.threads)
            rate = found.failed / max(found.seconds, 1e-9)
            print(
                f"{name:<{width}}  {Path(path).name[:24]:<24} {f'{found.failed}/{found.clips}':>7} {rate:>10.3f} "
                f"{found.joint:>10.4f} {1000 * found.aligned:>11.1f} {1000 * found.world:>9.1f}",
                flush=True,
            )
    return scores


if __name__ == "__main__":
    with report_errors():
        main(tyro.cli(DenseConfig, description=__doc__))
