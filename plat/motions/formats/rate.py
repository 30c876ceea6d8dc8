"""Frame rates that names of files state."""

import re

from plat.errors import MotionError

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
    """Return the frame rates that a name states, each once, in its order.

    Raises:
        MotionError: for a rate of 0.

    >>> [rates_in_name(name) for name in ("walk.bvh_60hz", "walk_fps60", "a_120fps_to_30fps", "g1_take_102")]
    [[60.0], [60.0], [120.0, 30.0], []]
    >>> [rates_in_name(name) for name in ("walk.60fps", "take3.60fps", "walk_29.97fps")]
    [[60.0], [60.0], [29.97]]
    >>> [rates_in_name(name) for name in ("kick@3", "kick@60", "walk_50hz_lowpass_6hz")]
    [[], [60.0], [50.0]]
    """
    found = [float(rate) for match in _STATED.finditer(name) for rate in match.groups() if rate]
    if 0.0 in found:
        raise MotionError("its name states 0 frames a second, expected a positive rate")
    return list(dict.fromkeys(found))


def without_rates(name: str, otherwise: str | None = None) -> str:
    """Return a name without the rates in it.

    Args:
        name: of a file or clip.
        otherwise: what to return where nothing else is in it; the name, if that is None.

    >>> without_rates("walk_60fps"), without_rates("60fps"), without_rates("60fps", "motion")
    ('walk', '60fps', 'motion')
    """
    kept = _STATED.sub(lambda match: "" if any(match.groups()) else match[0], name)
    return kept or (name if otherwise is None else otherwise)
