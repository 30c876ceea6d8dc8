"""Intervals that are longer than a policy's longest command, and the rule by which they are split."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from plat.bounds import check_value, is_finite
from plat.errors import KeyframeError
from plat.files import as_path
from plat.keyframes.files import read_keyframes
from plat.keyframes.keyframe import Keyframe, RobotJoints, check_keyframe, check_keyframes, standing
from plat.spec.timing import Timing

__all__ = ["LongInterval", "long_intervals", "long_intervals_of_file", "unit_doubt"]

_LONG = 10.0
"""Seconds between keyframes that are hardly meant."""


@dataclass(frozen=True)
class LongInterval:
    """Interval that a policy cannot be given as one command.

    Args:
        index: number of the keyframe at its end.
        name: of that keyframe.
        seconds: of the interval.
        longest: seconds of the policy's longest command.
        parts: commands that it is split into by :func:`plat.keyframes.split_long_intervals`.
        doubt: what the file's times may be, at the first of its intervals; see :func:`unit_doubt`.
    """

    index: int
    name: str | None
    seconds: float
    longest: float
    parts: int
    doubt: str = ""

    @property
    def words(self) -> str:
        """Return what happens to it, for a person."""
        label = f"keyframe {self.index}" + (f" ({self.name!r})" if self.name else "")
        before = f"{self.doubt} " if self.doubt else ""
        return (
            f"{before}{label} comes {self.seconds:g} s after the one before, the policy's longest command is "
            f"{self.longest:g} s: split into {self.parts} equal parts, at poses on the straight line between the two"
        )


def long_intervals(start: Keyframe, keyframes: Sequence[Keyframe], timing: Timing) -> tuple[LongInterval, ...]:
    """Return the intervals that :func:`plat.keyframes.split_long_intervals` would split.

    Raises:
        KeyframeError: for what are no keyframes.

    >>> from plat.keyframes import standing
    >>> from plat.robots import G1
    >>> pose = standing(G1)
    >>> (interval,) = long_intervals(pose, [pose.at(1.0), pose.at(3.5)], Timing())
    >>> interval.index, interval.seconds, interval.parts
    (1, 2.5, 3)
    """
    check_value("timing", timing, Timing)
    check_keyframe("start", start)
    keyframes = check_keyframes("keyframes", keyframes)
    found: list[LongInterval] = []
    for index, (before, after) in enumerate(pairwise((start, *keyframes))):
        steps = timing.steps(after.time) - timing.steps(before.time)
        if steps > timing.max_steps:
            parts = -(-steps // timing.max_steps)
            seconds = round(after.time - before.time, 6)
            doubt = "" if found else unit_doubt(keyframes)
            found.append(LongInterval(index, after.name, seconds, timing.longest, parts, doubt))
    return tuple(found)


def unit_doubt(keyframes: Sequence[Keyframe]) -> str:
    """Return what the times may be where no policy could keep any of them; empty where one may be a slip.

    >>> from plat.keyframes import standing
    >>> from plat.robots import G1
    >>> unit_doubt([standing(G1).at(800), standing(G1).at(1500)])
    'times are in seconds: are these milliseconds or frames?'
    """
    times = [0.0, *(keyframe.time for keyframe in keyframes)]
    doubtful = (
        len(times) > 1 and all(is_finite(time) for time in times) and all(b - a > _LONG for a, b in pairwise(times))
    )
    return "times are in seconds: are these milliseconds or frames?" if doubtful else ""


def long_intervals_of_file(path: Path, robot: RobotJoints, timing: Timing) -> tuple[LongInterval, ...]:
    """Return the :func:`long_intervals` of a keyframe file.

    Raises:
        KeyframeError: as :meth:`plat.keyframes.KeyframeSequence.load` does.
    """
    start, keyframes = read_keyframes(as_path(path, "keyframe file", KeyframeError), robot)
    return long_intervals(start or standing(robot), keyframes, timing)
