"""Scaling of throughput and memory with robots, motions, horizons and threads.

python benchmarks/scaling.py        # needs the extra figures

Every point is measured in a process of its own, several rounds over, beside bare physics with as many robots and
threads; medians over rounds go into a table and a picture.
"""

import itertools
import logging
import multiprocessing
import os
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import torch
import tyro
from costs import write_motions
from rounds import in_rounds, machine, peak_memory
from run import BARE, STEPS, bare_physics, collection, distillation, steps_per_second
from torch import Tensor

from plat.collectors import PrivilegedGoals, simulation_threads
from plat.envs import (
    BatchedPhysics,
    DistillationTaskConfig,
    KeyframeTaskConfig,
    TrackingTaskConfig,
    make_keyframe_env,
    make_tracking_env,
)
from plat.envs.physics import available_cpus
from plat.envs.transforms import Horizon, NoiseLevels, RandomizationRanges
from plat.figures import pyplot
from plat.files import replace_table
from plat.motions import MotionLibrary
from plat.runs import report_errors
from plat.spec.timing import Timing

_AXES = {
    "robots": "robots",
    "motions": "motion library (s)",
    "rollout": "PPO rollout (control steps)",
    "horizon": "longest command (control steps)",
    "threads": "threads",
}
_STEPLESS = 100  # control steps without physics: some operations of the task come every 50th step only
_TRACKING = TrackingTaskConfig(noise=NoiseLevels(), randomization=RandomizationRanges())
_KEYFRAMES = KeyframeTaskConfig(noise=NoiseLevels(), randomization=RandomizationRanges())


@dataclass(kw_only=True)
class ScalingConfig:
    """Settings of the scaling benchmark."""

    robots: tuple[int, ...] = (64, 128, 256, 512, 1024, 2048, 4096, 8192)
    """numbers of robots"""
    motions: tuple[float, ...] = (100.0, 1000.0, 10_000.0, 20_000.0)
    """lengths of the motion library (s)"""
    rollouts: tuple[int, ...] = (10, 24, 50)
    """control steps between updates of PPO"""
    horizons: tuple[int, ...] = (10, 25, 50)
    """longest commands (control steps)"""
    threads: tuple[int, ...] = tuple(2**power for power in range(available_cpus().bit_length()))
    """threads of physics and PyTorch"""
    num_envs: int = 1024
    """robots where their number is not varied"""
    rounds: int = 2
    """rounds of measurement of each point"""
    table: Path = Path(__file__).parent / "scaling.csv"
    """file to write the results to"""
    picture: Path = Path(__file__).parents[1] / "docs" / "images" / "scaling.png"
    """file of the plot"""


@dataclass(frozen=True)
class Point:
    """Point of the benchmark: the varied quantity and its value; all else keeps its default."""

    axis: str
    value: float
    num_envs: int
    motions: str
    threads: int
    rounds: int
    rollout: int
    horizon: int


@dataclass(frozen=True)
class Row:
    """Result at a point."""

    axis: str
    value: float
    quantity: str
    unit: str
    figure: float

    def __str__(self) -> str:
        return f"{self.quantity} {self.figure:,.{0 if self.figure > 100 else 2}f} {self.unit}"


def points(config: ScalingConfig, folder: Path) -> list[Point]:
    """Return every point, with the motions of each number of seconds in ``folder / SECONDS``."""
    usual: dict[str, Any] = {
        "num_envs": config.num_envs,
        "motions": "generated:train",
        "threads": available_cpus(),
        "rounds": config.rounds,
        "rollout": STEPS,
        "horizon": Timing.max_steps,
    }

    def vary(axis: str, values: Sequence[float], setting: Callable[[Any], dict[str, Any]]) -> list[Point]:
        return [Point(axis=axis, value=value, **(usual | setting(value))) for value in values]

    return [
        *vary("robots", config.robots, lambda count: {"num_envs": count}),
        *vary("motions", config.motions, lambda seconds: {"motions": str(folder / f"{seconds:g}")}),
        *vary("rollout", config.rollouts, lambda steps: {"rollout": steps}),
        *vary("horizon", config.horizons, lambda steps: {"horizon": steps}),
        *vary("threads", config.threads, lambda count: {"threads": count}),
    ]


def measure(point: Point) -> list[Row]:
    """Measure a point in this process."""
    if point.axis == "threads" and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: point.threads])
    if point.axis == "motions":
        os.environ["PLAT_CACHE_DIR"] = str(Path(point.motions).parent)  # long libraries are not worth keeping
    logging.getLogger("torchrl").setLevel(logging.WARNING)
    torch.set_num_threads(point.threads)
    torch.manual_seed(0)
    library = MotionLibrary.load(point.motions)
    count, steps = point.num_envs, point.num_envs * point.rollout
    measures: dict[str, tuple[str, Callable[[], float]]] = {
        BARE: ("steps/s", partial(steps_per_second, bare_physics(library, count), count * STEPS))
    }
    if point.axis != "horizon":
        for name, learn in (("policy and collector", False), ("PPO", True)):
            env = make_tracking_env(library, count, _TRACKING)
            measures[name] = ("steps/s", partial(steps_per_second, collection(env, learn, point.rollout), steps))
    if point.axis in ("horizon", "threads"):
        env = make_keyframe_env(library, count, DistillationTaskConfig(), horizon=Horizon(1, point.horizon))
        measures["DAgger"] = ("steps/s", partial(steps_per_second, distillation(env), count * STEPS))
    if point.axis == "motions":
        measures["everything but physics, a step"] = ("ms", without_physics(library, count))
        measures["goals of 2048 windows"] = ("ms", goal_windows(library))
    values = in_rounds({name: work for name, (_, work) in measures.items()}, point.rounds)
    rows = [
        Row(point.axis, point.value, name, unit, statistics.median(values[name]))
        for name, (unit, _) in measures.items()
    ]
    return [*rows, Row(point.axis, point.value, "peak memory", "MB", peak_memory())]


class StandingStill(BatchedPhysics):
    """Physics whose steps take no time, as nothing moves."""

    def step(self, ctrl: Tensor, nstep: int) -> None:
        """Do nothing."""


def without_physics(library: MotionLibrary, count: int) -> Callable[[], float]:
    """Measure the milliseconds of a keyframe task's step without physics: lookups, rewards, resets."""
    env = make_keyframe_env(library, count, _KEYFRAMES, physics=StandingStill)
    current = env.reset()

    def measure() -> float:
        nonlocal current
        with simulation_threads(count):
            began = time.perf_counter()
            for _ in range(_STEPLESS):
                current["action"] = torch.zeros(count, library.robot.num_joints)
                _, current = env.step_and_maybe_reset(current)
            return 1e3 * (time.perf_counter() - began) / _STEPLESS

    return measure


def goal_windows(library: MotionLibrary, count: int = 2048) -> Callable[[], float]:
    """Measure the milliseconds to gather the privileged goals of a batch of stage 2."""
    states = make_keyframe_env(library, count).reset()
    gather = PrivilegedGoals(library, stride=5)

    def measure() -> float:
        began = time.perf_counter()
        for _ in range(10):
            gather(states.copy())
        return 1e3 * (time.perf_counter() - began) / 10

    return measure


def draw(rows: list[Row], path: Path) -> None:
    """Draw a column for each axis, throughput above memory, and one for step times over the library's length."""
    plt = pyplot()
    cells = [((axis, "steps/s"), (axis, "MB")) for axis in _AXES] + [(("motions", "ms"), None)]
    figure, panels = plt.subplots(2, len(cells), figsize=(3.4 * len(cells), 5.6), layout="constrained")
    colors = {quantity: f"C{number}" for number, quantity in enumerate(dict.fromkeys(row.quantity for row in rows))}
    for panel, cell in zip(panels.T.flat, itertools.chain(*cells), strict=True):
        chosen = [row for row in rows if (row.axis, row.unit) == cell]
        if not chosen:
            panel.axis("off")
            continue
        for quantity in dict.fromkeys(row.quantity for row in chosen):
            line = [(row.value, row.figure) for row in chosen if row.quantity == quantity]
            panel.plot(*zip(*line, strict=True), "o-", markersize=3, color=colors[quantity], label=quantity)
        axis, unit = chosen[0].axis, chosen[0].unit
        panel.set_ylim(0, 1.1 * max(row.figure for row in chosen))
        if axis in ("robots", "motions"):
            panel.set_xscale("log")
            if unit == "MB":  # what grows in proportion is a straight line here only if both are logarithmic
                panel.set_yscale("log")
                panel.set_ylim(100, None)
        values = list(dict.fromkeys(row.value for row in chosen))
        panel.set_xticks(values, [f"{value / 1000:g}k" if value >= 10_000 else f"{value:g}" for value in values])
        panel.set_xticks([], minor=True)
        panel.tick_params(axis="x", labelsize=7)
        panel.set(xlabel=_AXES[axis], ylabel="memory (MB)" if unit == "MB" else unit)
        panel.grid(alpha=0.3)
        panel.legend(fontsize=7)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100)
    plt.close(figure)


def write_table(rows: list[Row], path: Path) -> None:
    """Write the rows as ``.csv``."""
    lines = ((row.axis, f"{row.value:g}", row.quantity, row.unit, f"{row.figure:.4g}") for row in rows)
    replace_table(path, ("axis", "value", "quantity", "unit", "figure"), lines)


def main(config: ScalingConfig) -> None:
    """Measure, print, write and draw."""
    pyplot()  # says what to install before anything is measured
    print(f"{machine()}, {config.num_envs} robots", flush=True)
    rows: list[Row] = []
    with TemporaryDirectory() as folder:
        generated = MotionLibrary.load("generated:train")
        for seconds in config.motions:
            write_motions(Path(folder) / f"{seconds:g}", generated, seconds)
        # a process for each point, so that memory is that point's alone
        with multiprocessing.get_context("spawn").Pool(1, maxtasksperchild=1) as pool:
            for found in pool.imap(measure, points(config, Path(folder)), chunksize=1):
                rows += found
                print(f"{found[0].axis} {found[0].value:g}: {', '.join(map(str, found))}", flush=True)
                write_table(rows, config.table)  # after each point: a run is long
    draw(rows, config.picture)


if __name__ == "__main__":
    with report_errors():
        main(tyro.cli(ScalingConfig))
