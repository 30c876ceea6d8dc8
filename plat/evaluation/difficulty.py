"""Difficulty of motion, measured from the motion itself, and bins of it."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import torch
from torch import Tensor

from plat.bounds import check_value
from plat.envs.transforms import CommandSchedule, horizon_named
from plat.motions.library import MotionLibrary
from plat.robots.kinematics import ForwardKinematics
from plat.spec.timing import Timing

__all__ = ["BINS", "SCALES", "Bin", "bin_of", "command_bins", "command_difficulty", "frame_measures"]

SCALES: Mapping[str, float] = MappingProxyType(
    {"speed": 1.0, "acceleration": 5.0, "turn": 2.0, "flight": 0.1, "lowness": 0.25}
)
"""Value of each measure that counts as a difficulty of 1: horizontal speed of the root (m/s), its acceleration (m/s²),
its yaw rate (rad/s), height of the lower foot above standing (m), and of the root below standing (m)."""

_SPAN = 0.1  # seconds to either side over which an acceleration is taken


@dataclass(frozen=True)
class Bin:
    """Bin of difficulty: from ``low`` up to, but without, ``high``."""

    name: str
    low: float
    high: float


BINS = (Bin("calm", 0.0, 0.5), Bin("everyday", 0.5, 1.0), Bin("brisk", 1.0, 2.0), Bin("hard", 2.0, float("inf")))
"""Bins, the easiest first. Everyday motion saturates TKS@3: policies differ in the others."""


def frame_measures(library: MotionLibrary) -> dict[str, Tensor]:
    """Return each of :data:`SCALES`' measures at every frame ``[F]``, in its own unit.

    >>> from plat.motions import generate_motions
    >>> library = MotionLibrary.from_clips(generate_motions("val", seconds=8))
    >>> sorted(frame_measures(library)) == sorted(SCALES)
    True
    """
    robot, frames = library.robot, library.frames
    feet = [robot.keypoints.index(foot) for foot in robot.feet]
    velocity = frames["keypoint_lin_vel"][:, 0]
    span = max(1, round(_SPAN / library.dt))
    here = torch.arange(len(library), device=library.device)
    first = library.clip_start[library.clip_of_frame]
    before, after = (here - span).maximum(first), (here + span).minimum(library.last_frame)
    seconds = (after - before).clamp_min(1)[:, None] * library.dt
    upright = torch.tensor([1.0, 0.0, 0.0, 0.0])
    standing, _ = ForwardKinematics(robot)(
        torch.tensor([0.0, 0.0, robot.root_height]), upright, robot.default_joint_pos.float()
    )
    heights = frames["keypoint_pos"][..., 2]
    return {
        "speed": velocity[:, :2].norm(dim=-1),
        "acceleration": ((velocity[after] - velocity[before]) / seconds).norm(dim=-1),
        "turn": frames["keypoint_ang_vel"][:, 0, 2].abs(),
        "flight": (heights[:, feet].amin(-1) - float(standing[feet, 2].mean())).clamp_min(0.0),
        "lowness": (float(standing[0, 2]) - heights[:, 0]).clamp_min(0.0),
    }


def command_difficulty(library: MotionLibrary, schedule: CommandSchedule) -> Tensor:
    """Return the difficulty ``[M]`` of each command: the largest measure, in its scale, on the way to its keyframe.

    Args:
        library: the motions.
        schedule: the M commands along them.

    Raises:
        ConfigError: for what is no schedule or no library.

    >>> from plat.motions import generate_motions
    >>> library = MotionLibrary.from_clips(generate_motions("val", seconds=8))
    >>> schedule = CommandSchedule(library, horizon_named("long", Timing()), seed=0)
    >>> command_difficulty(library, schedule).shape[0] == schedule.num_commands
    True
    """
    check_value("command_difficulty: library", library, MotionLibrary)
    check_value("command_difficulty: schedule", schedule, CommandSchedule)
    measures = torch.stack([value / SCALES[name] for name, value in frame_measures(library).items()]).amax(0)
    command = schedule.command_of_frame
    scheduled = command >= 0
    worst = torch.zeros(schedule.num_commands, device=library.device)
    worst.scatter_reduce_(0, command[scheduled], measures[scheduled], "amax")
    arrivals = schedule.target_frame[schedule.first_frame.to(library.device)]
    return worst.maximum(measures[arrivals]).cpu()


def command_bins(library: MotionLibrary, horizon: str, timing: Timing, seed: int) -> list[str]:
    """Return the bin of each command that is given along motions, in the order of their records.

    Args:
        library: the motions.
        horizon: name of the commands' lengths.
        timing: of the policy.
        seed: draws the commands.

    Raises:
        TaskError: for a horizon of another name, or one that is too long for the timing.
        ConfigError: for what is no library, timing or seed.

    >>> from plat.motions import generate_motions
    >>> library = MotionLibrary.from_clips(generate_motions("val", seconds=8))
    >>> set(command_bins(library, "long", Timing(), seed=0)) <= {one.name for one in BINS}
    True
    """
    check_value("command_bins: library", library, MotionLibrary)
    check_value("command_bins: timing", timing, Timing)
    return bin_of(command_difficulty(library, CommandSchedule(library, horizon_named(horizon, timing), seed)))


def bin_of(difficulty: Tensor) -> list[str]:
    """Return the name of the bin of each difficulty ``[M]``.

    >>> bin_of(torch.tensor([0.2, 1.0, 7.0]))
    ['calm', 'brisk', 'hard']
    """
    edges = torch.tensor([part.high for part in BINS[:-1]])
    return [BINS[index].name for index in torch.bucketize(difficulty, edges, right=True).tolist()]
