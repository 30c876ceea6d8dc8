"""Regression check of benchmark results against those of an earlier run.

The ratio of a result is compared. For a rate it is the fraction of bare physics' rate. For a time it is the number of
bare physics' control steps in that time. Memory is compared as it is.

Ratios are comparable on one kind of CPU with a given number of threads, whatever its other load. The kind is the unit
for half-precision matrix products; each kind has a file in ``expected``.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median

from pydantic import TypeAdapter, ValidationError
from rounds import median_ratio

from plat.errors import PlatError

__all__ = ["TOLERANCE", "Figure", "Figures", "compared", "figure", "read_figures", "write_figures"]

TOLERANCE = 0.15
"""Relative change for the worse that is a regression."""
_PER_SECOND = {"ms": 1e-3, "s": 1.0}


@dataclass(frozen=True)
class Figure:
    """Row of the benchmark."""

    value: float
    unit: str
    """``"steps/s"``, ``"ms"``, ``"s"`` or ``"MB"``"""
    ratio: float
    """value that is compared"""
    physics: float | None = None
    """fraction of its time spent in physics, where that was timed"""

    def __str__(self) -> str:
        if self.unit == "steps/s":
            timed = "" if self.physics is None else f", {self.physics:.1%} of its time physics"
            return f"{self.value:,.0f} steps/s, {self.ratio:.1%} of bare physics{timed}"
        if self.unit == "MB":
            return f"{self.value:,.0f} MB"
        return f"{self.value:.3g} {self.unit}, the time of {self.ratio:,.{0 if self.ratio > 100 else 1}f} bare steps"


@dataclass(frozen=True)
class Figures:
    """Results of a run of the benchmark."""

    threads: int
    num_envs: int
    rows: dict[str, Figure]


def figure(values: Sequence[float], unit: str, bare: Sequence[float], physics: Sequence[float] = ()) -> Figure:
    """Return the figure of a measure's rounds, from bare physics' steps per second in the same rounds."""
    if unit == "steps/s":
        return Figure(median(values), unit, median_ratio(values, bare), median(physics) if physics else None)
    if unit == "MB":
        return Figure(median(values), unit, median(values))
    steps = [value * _PER_SECOND[unit] * rate for value, rate in zip(values, bare, strict=True)]
    return Figure(median(values), unit, median(steps))


def compared(measured: Figures, committed: Figures) -> tuple[list[str], list[str]]:
    """Compare two runs: return regressions beyond :data:`TOLERANCE` and other remarks, one line each.

    Raises:
        PlatError: when the runs have other numbers of threads or robots.
    """
    for name in ("threads", "num_envs"):
        ours, theirs = getattr(measured, name), getattr(committed, name)
        if ours != theirs:
            raise PlatError(f"{name}: {ours} in this run, {theirs} in the committed one; ratios cannot be compared")
    regressions, remarks = [], []
    for name in [*committed.rows, *(name for name in measured.rows if name not in committed.rows)]:
        if name not in measured.rows:
            remarks.append(f"{name}: committed, not measured")
        elif name not in committed.rows:
            remarks.append(f"{name}: measured, not committed")
        else:
            now, before = measured.rows[name], committed.rows[name]
            change = now.ratio / before.ratio - 1 if before.ratio else 0.0
            gain = change if now.unit == "steps/s" else -change
            line = f"{name}: {now}; committed {before} ({change:+.0%})"
            if gain < -TOLERANCE:
                regressions.append(line)
            elif gain > TOLERANCE:
                remarks.append(f"{line}: better, commit it")
    return regressions, remarks


def write_figures(path: Path, figures: Figures) -> None:
    """Write a run to a file that :func:`read_figures` reads."""
    path.write_text(json.dumps(asdict(figures), indent=2) + "\n")


def read_figures(path: Path) -> Figures:
    """Read what :func:`write_figures` wrote.

    Raises:
        PlatError: when there is no such file, or it holds something else.
    """
    try:
        return TypeAdapter(Figures).validate_json(path.read_bytes())
    except OSError as error:
        raise PlatError(f"benchmark figures {str(path)!r}: not readable ({error.strerror})") from None
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(map(str, first["loc"]))
        raise PlatError(f"benchmark figures {str(path)!r}: {field}: {first['msg']}") from None
