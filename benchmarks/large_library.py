"""Loading and start sampling of a large motion library, made up and memory-mapped.

python benchmarks/large_library.py --clips 130000 --hours 30

Rows are noise, for their content does not matter to what is measured. The table is written to a temporary folder, a
kilobyte a frame, and removed again.
"""

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch
import tyro
from rounds import machine, peak_memory
from torch import Tensor

from plat.motions import MotionLibrary
from plat.motions.cache import CachedTable, read_table, write_table
from plat.motions.table import FIELDS, table_width
from plat.robots import G1
from plat.runs import report_errors
from plat.tasks import PoseTable
from plat.tasks.starts import ClipStarts, FailureWeights

_DT = 0.02
_ROBOTS = 1024
_SECONDS = 1_080_000  # 300 hours


@dataclass(kw_only=True)
class LargeLibraryConfig:
    """Settings of the benchmark of a large motion library."""

    clips: int = 130_000
    """clips of equal length"""
    hours: float = 30.0
    """length of all clips"""
    folder: Path = Path(tempfile.gettempdir())
    """where the table is written for the time being, a kilobyte a frame"""


def timed(work: Callable[[], object], times: int = 1) -> float:
    """Return the seconds of a call, the mean of several."""
    began = time.perf_counter()
    for _ in range(times):
        work()
    return (time.perf_counter() - began) / times


def make_up(path: Path, clips: int, hours: float) -> None:
    """Write a table of clips of equal length."""
    frames = max(2, round(3600 * hours / _DT / clips))
    noise = torch.randn(1 << 14, table_width(FIELDS, G1))

    def build(write: Callable[[Tensor], object]) -> tuple[Tensor, Tensor, list[str], dict[str, object]]:
        left = clips * frames
        while left:
            rows = noise[:left]
            write(rows)
            left -= len(rows)
        length = torch.full((clips,), frames)
        return length.cumsum(0) - length, length, [f"clip_{number:06d}" for number in range(clips)], {}

    write_table(path, noise.shape[1], _DT, build)


def opened(path: Path) -> MotionLibrary:
    """Return the library of a table."""
    table = read_table(path)
    assert isinstance(table, CachedTable)
    return MotionLibrary(table.rows, table.start, table.length, table.names, table.dt, G1)


def main(config: LargeLibraryConfig) -> None:
    """Measure and print."""
    with tempfile.TemporaryDirectory(dir=config.folder) as folder:
        path = Path(folder) / "table.safetensors"
        written = timed(lambda: make_up(path, config.clips, config.hours))
        before = peak_memory()
        loaded = timed(lambda: opened(path))
        library = opened(path)
        starts = ClipStarts(library)
        poses = PoseTable.of_library(library)
        memory = peak_memory() - before
        frame = starts.draw(_ROBOTS)
        many = FailureWeights(_SECONDS)
        size = f"{library.num_clips:,} clips, {len(library) * _DT / 3600:.0f} h, {path.stat().st_size / 1e9:.1f} GB"
        rows = {
            f"{size}: writing (s)": written,
            "opening (s)": loaded,
            "memory of library, starts and poses (MB)": memory,
            f"failure weights of {_SECONDS:,} s (MB)": many.failures.nbytes / 1e6,
            f"drawing {_ROBOTS:,} of them (ms)": 1e3 * timed(lambda: many.draw(_ROBOTS), 20),
            "recording 20 of them and forgetting (ms)": 1e3 * timed(lambda: _failures(many, frame[:20] % _SECONDS), 20),
            f"drawing {_ROBOTS:,} starts (ms)": 1e3 * timed(lambda: starts.draw(_ROBOTS), 20),
            f"looking up {_ROBOTS:,} drawn states (ms)": 1e3
            * timed(lambda: poses.state(starts.bins.draw_frames(_ROBOTS)), 20),
        }
    print(machine())
    for name, value in rows.items():
        print(f"{name:<70}{value:>10.2f}")


def _failures(weights: FailureWeights, place: Tensor) -> None:
    weights.record(place)
    weights.forget()


if __name__ == "__main__":
    with report_errors():
        main(tyro.cli(LargeLibraryConfig))
