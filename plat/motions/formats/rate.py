"""Frame rates that names of files state."""

import re

from plat.errors import MotionError
from plat.motions.formats.comment_rate import LEAST_HERTZ

__all__ = ["RATES", "rates_in_name", "without_rates"]

RATES = (24.0, 25.0, 30.0, 50.0, 60.0, 90.0, 100.0, 120.0, 200.0, 240.0)
"""Usual frame rates of motions."""

_NUMBER = r"(\d+(?:\.\d+)?)"
# where a number begins: take3.60fps and 001.60fps are takes at 60, 119.88fps is a rate
_START = r"(?!0\d+\.)(?:(?<!\d)(?<!\d\.)(?!(?<=[a-z])\d\.\d)|(?<=[a-z]\d\.)|(?<=0\d\.)|(?<=0\d\d\.)|(?<=\.\d\d\.))"
_UNIT = r"(?:fps|hz|frames?[ _-]?per[ _-]?second)"
# without a unit only usual rates are meant: kick@3 is a take
_USUAL = "|".join([*(f"{rate:g}" for rate in RATES), r"23\.976", r"29\.97", r"59\.94"])
# of a filter, and none of frames
_CUTOFF = r"(?:cut[ _-]?off|(?:low|high|band)[ _-]?pass|butter(?:worth)?)"
_STATED = re.compile(
    rf"[ _.-]*{_CUTOFF}[ _=-]*\d+(?:\.\d+)?[ _-]?hz(?![a-z])"
    rf"|[ _.@-]*{_START}\d+(?:\.\d+)?[ _-]?hz[ _-]?{_CUTOFF}(?![ _=-]*\d)"
    rf"|[ _.@-]*{_START}{_NUMBER}[ _-]?{_UNIT}(?![a-z])"
    rf"|[ _.-]*(?<![a-z])(?:{_UNIT}|frame[ _-]?rate)[ _=-]?{_NUMBER}(?![\d.]*\d)"
    rf"|[ _.-]*@({_USUAL})(?:\.0+)?(?![\d.]*\d)",
    re.IGNORECASE,
)


def rates_in_name(name: str) -> list[float]:
    """Return the frame rates that a name states, each once, in its order; a few Hertz are those of a movement.

    Raises:
        MotionError: for a rate of 0.

    >>> [rates_in_name(name) for name in ("walk.bvh_60hz", "walk_fps60", "a_120fps_to_30fps", "g1_take_102")]
    [[60.0], [60.0], [120.0, 30.0], []]
    >>> [rates_in_name(name) for name in ("walk.60fps", "take3.60fps", "walk_29.97fps")]
    [[60.0], [60.0], [29.97]]
    >>> [rates_in_name(name) for name in ("kick@3", "kick@60", "walk_50hz_lowpass_6hz")]
    [[], [60.0], [50.0]]
    >>> [rates_in_name(name) for name in ("wave_2hz", "wave_2hz_50fps", "walk_2fps")]
    [[], [50.0], [2.0]]
    """
    found = [rate for match in _STATED.finditer(name) if (rate := _rate(match)) is not None]
    if 0.0 in found:
        raise MotionError("its name states 0 frames a second, expected a positive rate")
    return list(dict.fromkeys(found))


def _rate(match: re.Match[str]) -> float | None:
    """Return the frame rate that a part of a name states, or None for one that is of something else."""
    rate = next((float(rate) for rate in match.groups() if rate), None)
    return None if rate is not None and "hz" in match[0].lower() and 0 < rate < LEAST_HERTZ else rate


def without_rates(name: str, otherwise: str | None = None) -> str:
    """Return a name without the rates in it.

    Args:
        name: of a file or clip.
        otherwise: what to return where nothing else is in it; the name, if that is None.

    >>> without_rates("walk_60fps"), without_rates("60fps"), without_rates("60fps", "motion"), without_rates("wave_2hz")
    ('walk', '60fps', 'motion', 'wave_2hz')
    """
    kept = _STATED.sub(lambda match: match[0] if _rate(match) is None else "", name)
    return kept or (name if otherwise is None else otherwise)
