"""What a motion itself says about its frame rate."""

from collections.abc import Sequence
from pathlib import Path

from plat.errors import MotionError
from plat.motions.checks.flight import Flight
from plat.motions.checks.tempo import Tempo
from plat.motions.clip import MotionClip
from plat.motions.formats.clock import ELSEWHERE, STATED, StatedRate, contradicting_name, contradiction
from plat.robots.robot import Robot

__all__ = ["Pace", "UnfitRateError", "rate_of_file", "settled_rate"]


# A name says something against what a file states where the rates are so many times apart, and the motion fits one.
_APART = 1.5


class UnfitRateError(MotionError):
    """A file that states no frame rate, and whose motion does not fit the usual one.

    Args:
        message: what is wrong.
        folder: of the file.
    """

    def __init__(self, message: str, folder: Path | None = None):
        super().__init__(message)
        self.folder = folder


class Pace:
    """The evidence of a motion for its frame rate: the steps of a gait, and the fall of a flight.

    Args:
        clip: whose frame rate is not looked at.
        robot: whose motion it is.
    """

    def __init__(self, clip: MotionClip, robot: Robot):
        named = (("steps", Tempo.of(clip, robot)), ("flight", Flight.of(clip, robot)))
        self._found = {what: found for what, found in named if found is not None}

    def against(self, fps: float) -> str:
        """Return what speaks against a rate, with the rate that it looks like; empty where nothing does.

        >>> from plat.motions import generate_motions
        >>> from plat.robots import G1
        >>> walk = next(clip for clip in generate_motions("train", seconds=60) if clip.name.startswith("walk"))
        >>> Pace(walk, G1).against(walk.fps), Pace(walk, G1).against(4 * walk.fps)[:9]
        ('', 'its steps')
        """
        unfit = [(what, found) for what, found in self._found.items() if not found.fits(fps)]
        return " and ".join(f"its {what} (about {found.likely_rate:.0f})" for what, found in unfit)

    def confirmed_by(self, fps: float) -> str:
        """Return what speaks for a rate, where nothing speaks against it; empty where nothing does."""
        return "" if self.against(fps) else " and ".join(self._found)


def settled_rate(rates: Sequence[StatedRate], clips: Sequence[MotionClip], robot: Robot) -> tuple[float, str]:
    """Return the one of several stated rates that fits the motion, and a note on it.

    Args:
        rates: that a file states.
        clips: of the file, whose frame rate is not looked at.
        robot: whose motions they are.

    Raises:
        MotionError: naming the rates, where the motion does not decide.
    """
    paces = [Pace(clip, robot) for clip in clips]
    fitting = {}
    for rate, _ in rates:
        found = [what for pace in paces if (what := pace.confirmed_by(rate))]
        if found and not any(pace.against(rate) for pace in paces):
            fitting[rate] = found[0]
    if len(fitting) != 1:
        raise contradiction(rates)
    ((rate, what),) = fitting.items()
    told = " and ".join(f"{rate:g} ({source})" for rate, source in rates)
    return rate, f"fps {rate:g} of {told}: the one that fits its {what}"


def rate_of_file(
    path: Path, rates: Sequence[StatedRate], clips: Sequence[MotionClip], robot: Robot
) -> tuple[float, list[str]]:
    """Return the frame rate of an archive or a pickle, and a note where it states several or its name another.

    The motion decides where it can. Else what a file itself states beats its name.

    Args:
        path: of the file.
        rates: that it states, at least one.
        clips: of the file, whose frame rate is not looked at.
        robot: whose motions they are.

    Raises:
        MotionError: naming the rates, where the file itself states several and the motion does not decide.
    """
    (rate, source), *others = rates
    if source == STATED:
        return rate, []
    named = contradicting_name(path, rates)
    if not others and not named:
        return rate, [f"fps from {source}"] if source in ELSEWHERE else []
    far = [other for other in named if not 1 / _APART < other[0] / rate < _APART]
    try:
        rate, told = settled_rate([*rates, *far], clips, robot)
    except MotionError:
        if others:
            raise
        far = []
    if not others and not far:
        told = f"fps {rate:g} ({source}), though the file name says {named[0][0]:g}"
    return rate, [told]
