"""Frame rates, and time steps of frames, that comments and names state."""

import re
from collections.abc import Iterator, Sequence

__all__ = ["LEAST_HERTZ", "LIKELY", "rates_in_comment", "rates_in_comments", "rates_of_steps", "without_steps"]

LIKELY = (5.0, 1000.0)
"""Frames a second that motions have; what counts in another unit lies far outside."""

LEAST_HERTZ = 10.0
"""Hertz that name nothing are of movements below this."""

_NUMBER = r"(?<![\d.])(\d+(?:\.\d*)?|\.\d+)(?![\d.]*\d)"
_HERTZ = r"(?:k?hz|hertz|1/s)(?![a-z])"
_FRAMES = r"(?:fps|f/s|(?:frames?|samples?|rows?|poses?)[ _-]*(?:per|an?|/)[ _-]*s(?:ec(?:ond)?)?)(?![a-z])"
_SECONDS = r"(?:seconds?|secs?|s|milliseconds?|millis|ms|microseconds?|us|µs)(?![a-z\d])"
# between what is called a rate and its number
_IS = r"[\"']?\s*(?:of|in|is|was|at|[:=~≈])?\s*[\"']?\s*"
_LEADS = rf"[\"']?(?:[ _]*(?:in\s+)?(?:{_HERTZ}|{_FRAMES}))?{_IS}"
# rates that are of frames by their names
_OF_FRAMES = re.compile(
    rf"(?<![a-z])(?:(?:frame|sampl(?:e|ing)|capture|mocap|recording)[ _-]*(?:rate|freq(?:uency)?)|{_FRAMES})"
    rf"{_LEADS}{_NUMBER}(?!\s*%)\s*(khz)?|{_NUMBER}\s*{_FRAMES}",
    re.IGNORECASE,
)
# those that are of anything
_OF_ANYTHING = re.compile(
    rf"(?:([a-z]+)[ _-]+)?(?<![a-z])(?:rate|freq(?:uency)?|fs|{_HERTZ}){_LEADS}"
    rf"{_NUMBER}(?!\s*(?:%|°|deg|rad|x(?![a-z])|m/))\s*(khz)?|{_NUMBER}\s*(k?hz|hertz)(?![a-z])",
    re.IGNORECASE,
)
# what may stand before a rate of frames
_NO_OTHER = frozenset(
    (
        *("a", "an", "and", "are", "at", "is", "of", "the", "with", "its", "this"),
        *("motion", "data", "control", "output", "export", "exported", "source", "update"),
    )
)
# what such a number belongs to that is no rate of frames
_OTHERS = re.compile(
    r"filter|(?:low|high|band)[ _-]?pass|cut[ _-]?off|butter(?:worth)?|smooth|bandwidth|playback|render|display|preview"
    r"|gait|stride|stepping|step[ _-]freq|cadence|swing|sway|wav(?:e|ing)(?![a-z])|oscillat|vibrat|tremor|natural"
    r"|resonan|heart|noise|simulat|(?<![a-z])sim(?![a-z])|physics|solver|integrat|delay|latency|imu|gyro|torque|servo",
    re.IGNORECASE,
)
_SHOWN = re.compile(r"playback|render|display|preview|viewer", re.IGNORECASE)
# of a simulation that takes several steps a frame
_SEVERAL_STEPS = re.compile(r"decimation|sub[ _-]?steps?|frame[ _-]?skip", re.IGNORECASE)
# of what the motion was made of
_OF_SOURCE = re.compile(
    rf"(?<![a-z])(?:original|originally|source|raw|native)(?![a-z])[^,;|]*"
    rf"|(?<![a-z])from\s+(?:[a-z]+\s+)?{_NUMBER}\s*(?:{_HERTZ}|{_FRAMES})",
    re.IGNORECASE,
)
_STEP = (
    r"(?<![a-z])(?:dt|delta[ _-]?t|(?:time|frame|sampl(?:e|ing))[ _-]?(?:step|time|interval|period|duration))"
    r"|(?<![a-z])(?:period|interval)"
)
_STEPS = re.compile(
    rf"(?:{_STEP})[ _]*(?:in[ _]+)?({_SECONDS})?_?{_IS}(?:1\s*/\s*{_NUMBER}|{_NUMBER}[ _]*({_SECONDS})?(?![a-z\d]))"
    rf"|(?<![a-z])every\s+{_NUMBER}\s*({_SECONDS})"
    rf"|{_NUMBER}\s*({_SECONDS})\s*(?:per|an?|/)\s*(?:frame|sample|row|step)(?![a-z])",
    re.IGNORECASE,
)
_UNIT_IN_BRACKETS = re.compile(rf"[(\[]\s*({_HERTZ}|{_FRAMES}|{_SECONDS})\s*[)\]]", re.IGNORECASE)
_WITHIN = re.compile(r"\(([^()]*)\)")


def rates_in_comment(line: str) -> list[float]:
    """Return the frames a second that a comment states, in its order; none of filters, gaits, screens, physics.

    >>> [rates_in_comment(line) for line in ("25 frames per second", "Frame rate (Hz): 50", "dt [ms] = 20", "fs=50")]
    [[25.0], [50.0], [50.0], [50.0]]
    >>> [rates_in_comment(line) for line in ("playback rate: 1.0", "success rate 98.5 %", "gait frequency: 2 Hz")]
    [[], [], []]
    """
    stepped = not _SEVERAL_STEPS.search(line)
    return [rate for part in _parts(line) for rate in (*_of_part(part), *(rates_of_steps(part) if stepped else ()))]


def rates_in_comments(lines: Sequence[str]) -> list[float]:
    """Return the frames a second that comments state; of what the motion was made of only where they state no other.

    >>> rates_in_comments(["retargeted at 50 fps from 120 fps"]), rates_in_comments(["source: cmu, 120 fps"])
    ([50.0], [120.0])
    """
    own = [rate for line in lines for rate in rates_in_comment(_OF_SOURCE.sub(" ", line))]
    return own or [rate for line in lines for rate in rates_in_comment(line)]


def _parts(line: str) -> Iterator[str]:
    """Yield the parts of a comment that each say one thing; what is in brackets belongs to what is before them."""
    line = _UNIT_IN_BRACKETS.sub(r" \1 ", line)
    for part in re.split(r"[,;|](?![^()]*\))|\sand\s", line):
        outside = _WITHIN.sub(" ", part)
        yield outside
        if not _OTHERS.search(outside):
            yield from _WITHIN.findall(part)


def _of_part(part: str) -> Iterator[float]:
    if not _SHOWN.search(part):
        for match in _OF_FRAMES.finditer(part):
            yield float(match[1] or match[3]) * (1000 if match[2] else 1)
    rest = _OF_FRAMES.sub(" ", part)
    if _OTHERS.search(part):
        return
    for match in _OF_ANYTHING.finditer(rest):
        word, named, thousands, alone, unit = match.groups()
        if word is not None and named is not None and word.lower() not in _NO_OTHER:
            continue
        rate = float(named or alone) * (1000 if thousands or (unit or "").lower() == "khz" else 1)
        if (LIKELY[0] if named else LEAST_HERTZ) <= rate <= LIKELY[1]:
            yield rate


def rates_of_steps(text: str) -> list[float]:
    """Return the frames a second of the time steps that a text states; a whole number without a unit is none.

    >>> rates_of_steps("walk_dt0.02"), rates_of_steps("dt = 20 ms"), rates_of_steps("physics dt 0.002")
    ([50.0], [50.0], [])
    """
    return [] if _OTHERS.search(text) else [rate for match in _STEPS.finditer(text) if (rate := _rate(match))]


def _rate(match: re.Match[str]) -> float | None:
    before, inverse, step, behind, *others = match.groups()
    number, unit = step, behind or before
    for value, its_unit in zip(others[::2], others[1::2], strict=True):
        number, unit = number or value, unit or its_unit
    if inverse is not None:
        rate = float(inverse)
    elif number is None or float(number) == 0 or (unit is None and "." not in number):
        return None
    else:
        thousands = {"s": 1.0, "m": 1e3, "u": 1e6, "µ": 1e6}
        first = (unit or "s")[0].lower()
        rate = (1e6 if (unit or "").lower().startswith("micro") else thousands[first]) / float(number)
    return round(rate, 3) if LIKELY[0] <= rate <= LIKELY[1] else None


def without_steps(name: str) -> str:
    """Return a name without the time steps in it.

    >>> without_steps("walk_dt0.02"), without_steps("walk_dt20ms"), without_steps("walk_dt2")
    ('walk', 'walk', 'walk_dt2')
    """
    return _STEPS.sub(lambda match: match[0] if _rate(match) is None else "", name).rstrip("_ ")
