"""Costs beyond one process and one CPU: robots in workers, MuJoCo Warp on its CPU device, a large motion library."""

import time
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import torch
from costs import Cost
from large_library import make_up, opened

from plat.collectors import WorkerRollouts
from plat.envs import TrackingTaskConfig, make_tracking_env
from plat.envs.physics import WarpPhysics
from plat.errors import ConfigError
from plat.modules import Expert
from plat.motions import MotionLibrary
from plat.robots import G1
from plat.tasks.starts import ClipStarts

__all__ = ["in_workers", "large_library", "on_warp"]

WARP_ROBOTS = 64
"""More would take minutes on a CPU."""


def in_workers(
    library: MotionLibrary, count: int, config: TrackingTaskConfig, steps: int, stack: ExitStack
) -> dict[str, Cost]:
    """Return the rates of the acting expert's rollouts with one worker and with two, which the stack ends."""
    rows = {}
    for workers in (1, 2):
        source = WorkerRollouts(
            partial(make_tracking_env, config=config), library, count, Expert(G1).actor(), steps, workers=workers
        )
        stack.enter_context(source)
        rows[f"policy and collector, {workers} worker{'s' * (workers > 1)}"] = Cost("steps/s", partial(_rate, source))
    return rows


def _rate(source: WorkerRollouts) -> float:
    began = time.perf_counter()
    return next(source).numel() / (time.perf_counter() - began)


def on_warp(library: MotionLibrary, steps: int) -> dict[str, Cost]:
    """Return the rate of bare MuJoCo Warp along the motions on its CPU device; nothing where it is not installed."""
    try:
        physics = WarpPhysics(G1.model(), WARP_ROBOTS)
    except ConfigError as error:
        print(f"MuJoCo Warp: not measured: {error}")
        return {}
    return {f"bare MuJoCo Warp on the CPU, {WARP_ROBOTS} robots": Cost("steps/s", _along(library, physics, steps))}


def _along(library: MotionLibrary, physics: WarpPhysics, steps: int) -> Callable[[], float]:
    robots = torch.arange(WARP_ROBOTS)

    def measure() -> float:
        frame = torch.randint(len(library), (WARP_ROBOTS,))
        physics.set_state(robots, library.qpos(frame), torch.zeros(WARP_ROBOTS, 6 + G1.num_joints))
        ahead = (frame + step for step in range(1, steps + 1))
        targets = [library.poses(later.minimum(library.last_of(frame)))["joint_pos"] for later in ahead]
        began = time.perf_counter()
        for target in targets:
            physics.step(target, nstep=4)
        return WARP_ROBOTS * steps / (time.perf_counter() - began)

    return measure


def large_library(folder: Path, clips: int, hours: float, robots: int = 1024) -> dict[str, Cost]:
    """Return the times of opening a made-up table and of drawing starts in it.

    Args:
        folder: for the table, a kilobyte a frame.
        clips, hours: its size.
        robots: starts that are drawn at a time.
    """
    path = folder / "large.safetensors"
    make_up(path, clips, hours)
    starts = ClipStarts(opened(path))
    size = f"table of {clips:,} clips, {hours:g} h"
    return {
        f"{size}: opening": Cost("ms", lambda: _milliseconds(lambda: opened(path))),
        f"{size}: drawing {robots:,} starts": Cost("ms", lambda: _milliseconds(lambda: starts.draw(robots))),
    }


def _milliseconds(work: Callable[[], object], times: int = 5) -> float:
    began = time.perf_counter()
    for _ in range(times):
        work()
    return 1e3 * (time.perf_counter() - began) / times
