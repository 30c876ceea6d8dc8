"""The frame rate of a table, from a column of times, a comment or the file's name."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from plat.errors import MotionError
from plat.motions.formats.rate import rates_in_name

__all__ = ["rate_of_times", "stated_rates"]

_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
# rates of motions; a time that counts in another unit lies far outside
_LIKELY = (5.0, 1000.0)
# A step this much longer than the usual one leaves frames out.
_GAP = 1.8
_IN_COMMENT = re.compile(
    r"(?:fps|frame[ _-]?rate|rate|hz|frequency)\s*[:=]?\s*(\d+(?:\.\d+)?)|(\d+(?:\.\d+)?)\s*(?:fps|hz)", re.IGNORECASE
)
_STEP_IN_TEXT = re.compile(
    r"(?<![a-z])(?:dt|time[ _-]?step|frame[ _-]?time)[ _]*[:=]?[ _]*(\d*\.\d+)(?:[ _]*s)?(?![\da-z])", re.IGNORECASE
)


def rate_of_times(times: np.ndarray, unit: str = "") -> float:
    """Return the frames a second of a column of times ``[T]``.

    Args:
        times: of the frames.
        unit: ``s``, ``ms``, ``us`` or ``ns`` where its name states it; else the one that makes the rate a likely one.

    Raises:
        MotionError: when time does not go on evenly, or no unit gives a likely rate.

    >>> rate_of_times(np.arange(5) * 20), rate_of_times(np.arange(5) * 0.02)
    (50.0, 50.0)
    """
    steps = np.diff(times)
    usual = float(np.median(steps)) if len(steps) else 0.0
    if not usual > 0 or (steps <= 0).any() or steps.max() > _GAP * usual:
        row = int(np.argmax((steps <= 0) | (steps > _GAP * usual))) if len(steps) else 0
        raise MotionError(
            f"the time goes on by {steps[row] if len(steps) else 0:g} at row {row + 2}, by {usual:g} elsewhere; "
            "expected even steps (or state --fps)"
        )
    mean = float(steps.mean())
    for seconds in (_UNITS[unit],) if unit in _UNITS else _UNITS.values():
        if _LIKELY[0] <= 1 / (mean * seconds) <= _LIKELY[1]:
            rate = 1 / (mean * seconds)
            return float(round(rate)) if abs(rate - round(rate)) < 2e-3 * rate else rate
    raise MotionError(f"the time goes on by {mean:g} a row, a likely rate in no unit (s, ms, us, ns); state --fps")


def stated_rates(path: Path, comments: Sequence[str]) -> list[tuple[float, str]]:
    """Return the frame rates that comments and the name, else the name of the folder state, each with its source."""
    found = [float(next(filter(None, match.groups()))) for line in comments for match in _IN_COMMENT.finditer(line)]
    found += [rate for line in comments for rate in _of_steps(line)]
    told = [
        *((rate, "a comment") for rate in found),
        *((rate, "the file name") for rate in (*rates_in_name(path.stem), *_of_steps(path.stem))),
    ]
    return list(dict.fromkeys(told or ((rate, "the folder's name") for rate in rates_in_name(path.parent.name))))


def _of_steps(text: str) -> list[float]:
    """Return the rates of the time steps (s) that a text states."""
    steps = [float(step) for step in _STEP_IN_TEXT.findall(text)]
    return [round(1 / step, 3) for step in steps if step > 0 and _LIKELY[0] <= 1 / step <= _LIKELY[1]]
