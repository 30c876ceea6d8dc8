"""The frame rate of a file, from times of its frames, fields, a comment or its name."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from plat.errors import MotionError
from plat.motions.clip import MotionClip
from plat.motions.formats.comment_rate import LIKELY, rates_in_comments, rates_of_steps
from plat.motions.formats.common import FPS, number
from plat.motions.formats.rate import rates_in_name
from plat.motions.formats.spellings import is_time, tokens
from plat.rotations import quat_slerp

__all__ = [
    "ELSEWHERE",
    "STATED",
    "StatedRate",
    "contradicting_name",
    "contradiction",
    "counts_frames",
    "distinct_rates",
    "even_frames",
    "evenly_timed",
    "numbering_fault",
    "rate_fields",
    "rate_of_times",
    "rates_of_fields",
    "stated_rates",
    "tells_time",
    "times_of_fields",
    "unit_of_times",
]

StatedRate = tuple[float, str]
"""Frames a second, and what states them: the quoted name of a field, or one of the following."""

STATED = "--fps"
"""Source of a rate that the user states."""

_COMMENT, _NAME, _FOLDER = ELSEWHERE = ("a comment", "the file name", "the folder's name")
"""Sources of rates that no field of a file states, which is worth a note."""

# Fields of archives and pickles that give frames a second, seconds a frame, and the time of each frame, in small
# letters with underscores. Single words that mean other things as well count where they are one number.
_RATES = (
    *("fps", "frequency", "frame_rate", "framerate", "hz", "mocap_framerate", "mocap_frame_rate", "motion_fps"),
    *("mocap_fps", "frames_per_second", "frame_rate_hz", "sampling_rate", "sample_rate", "sampling_frequency"),
)
_RATES_IF_ONE = ("rate", "freq", "fs")
_STEPS = ("dt", "timestep", "frame_time", "time_step", "delta_t")
_CLOCKS = frozenset(("time", "times", "t", "timestamp", "timestamps", "stamp", "stamps"))

# Rates that differ by less than this share are one, rounded.
_SAME_RATE = 0.02
# Whole numbers that go on by so much at most count frames, of which some may be left out. In ms they were over 240 Hz.
_LARGEST_COUNT = 4
_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
# A step this much longer than the usual one leaves frames out, and this much shorter ones are no jitter.
_GAP, _SHORT = 1.8, 0.5


def rate_of_times(times: np.ndarray, unit: str = "") -> float:
    """Return the frames a second of a column of times ``[T]``.

    Args:
        times: of the frames.
        unit: ``s``, ``ms``, ``us`` or ``ns`` where its name states it; else, and where that makes the rate an unlikely
            one, the one that makes it a likely one.

    Raises:
        MotionError: when a time is not finite, time does not go on evenly, or no unit gives a likely rate.

    >>> rate_of_times(np.arange(5) * 20), rate_of_times(np.arange(5) * 0.02)
    (50.0, 50.0)
    """
    if not np.isfinite(times).all():
        frame = int(np.isfinite(times).argmin())
        raise MotionError(
            f"the time of frame {frame} is {times[frame]}, expected a finite number (or state them: "
            "plat motions convert --fps)"
        )
    steps = np.diff(times)
    usual = float(np.median(steps)) if len(steps) else 0.0
    if not usual > 0:
        does = "goes back" if usual < 0 else "does not go on"
        raise MotionError(
            f"the time {does} from row to row, expected even steps (or state them: plat motions convert --fps)"
        )
    if (steps <= 0).any() or steps.max() > _GAP * usual:
        row = int(np.argmax((steps <= 0) | (steps > _GAP * usual)))
        raise MotionError(
            f"the time goes on by {steps[row]:g} at row {row + 2}, by {usual:g} elsewhere; expected even steps (or "
            "state them: plat motions convert --fps)"
        )
    mean = float(steps.mean())
    stated = [_UNITS[unit]] if unit in _UNITS else []
    for seconds in [*stated, *([] if stated and counts_frames(times) else _UNITS.values())]:
        if LIKELY[0] <= 1 / (mean * seconds) <= LIKELY[1]:
            rate = 1 / (mean * seconds)
            return float(round(rate)) if abs(rate - round(rate)) < 2e-3 * rate else rate
    raise MotionError(
        f"the time goes on by {mean:g} a row, a likely rate in no unit (s, ms, us, ns); state it: "
        "plat motions convert --fps"
    )


def evenly_timed(clip: MotionClip, times: np.ndarray) -> MotionClip:
    """Return a clip at even times, with a note, where those of its frames ``[T]`` are more than a step from even ones.

    What wavers by less is the jitter of a recording, and its frames are taken as even.
    """
    if len(times) != len(clip.qpos):
        return clip
    told, found = even_frames(times, clip.fps)
    if found is None:
        return replace(clip, notes=(*clip.notes, told)) if told else clip
    before, weight = (part[1:-1] for part in found)
    qpos = clip.qpos.copy()
    start, end = torch.from_numpy(clip.qpos[before]), torch.from_numpy(clip.qpos[before + 1])
    part = torch.from_numpy(weight).to(start)
    between = torch.lerp(start, end, part[:, None])
    between[:, 3:7] = quat_slerp(start[:, 3:7], end[:, 3:7], part)
    qpos[1:-1] = between.numpy()
    return replace(clip, qpos=qpos, notes=(*clip.notes, told))


def even_frames(times: np.ndarray, fps: float) -> tuple[str, tuple[np.ndarray, np.ndarray] | None]:
    """Return what is to be said of times ``[T]``, and where even ones lie between them if they are far from even.

    Args:
        times: that rise.
        fps: frames a second that they are on average.

    Returns:
        A note, or an empty text; and the frame before each of the even times ``[T]`` with its share of the way to the
        next frame ``[T]``, or None where the frames are taken as even.

    >>> even_frames(np.arange(5) / 50, 50.0)
    ('', None)
    >>> told, found = even_frames(np.array([0.0, 1, 2, 3, 4, 5, 6, 8, 10, 12, 14, 16]) / 50, 34.375)
    >>> told, found[0].tolist()
    ('frames 0.02 to 0.04 s apart, resampled to even ones', [0, 1, 2, 4, 5, 6, 7, 8, 8, 9, 10, 10])
    """
    even = np.linspace(times[0], times[-1], len(times))
    usual = even[1] - even[0]
    steps = np.diff(times) / usual / fps
    told = f"frames {steps.min():.3g} to {steps.max():.3g} s apart"
    if np.abs(times - even).max() <= usual:
        return (f"{told}, read as even" if steps.min() < _SHORT * np.median(steps) else ""), None
    before = (np.searchsorted(times, even, side="right") - 1).clip(0, len(times) - 2)
    weight = ((even - times[before]) / (times[before + 1] - times[before])).clip(0, 1)
    return f"{told}, resampled to even ones", (before, weight)


def unit_of_times(times: np.ndarray, rate: float) -> str:
    """Return the unit in which times ``[T]`` have a rate.

    >>> unit_of_times(np.arange(5) * 20, 50.0)
    'ms'
    """
    ticks = rate * (times[-1] - times[0]) / (len(times) - 1)  # a second
    return min(_UNITS, key=lambda unit: abs(np.log(ticks * _UNITS[unit])))


def counts_frames(times: np.ndarray, unit: str = "") -> bool:
    """Return whether a column ``[T]`` of no stated unit is a count of frames, which says nothing about their rate.

    >>> counts_frames(np.arange(5.0)), counts_frames(np.arange(5) * 20), counts_frames(np.arange(5.0), "ms")
    (True, False, False)
    """
    if not np.isfinite(times).all():
        return False
    steps = np.diff(times)
    whole = unit not in _UNITS and len(steps) > 0 and bool((times % 1 == 0).all())
    return whole and bool(1 <= steps[0] <= _LARGEST_COUNT and (steps == steps[0]).all())


def numbering_fault(numbers: np.ndarray) -> tuple[int, str] | None:
    """Return the frame after which the numbers of frames ``[T]`` do not go on evenly, and what to do about it.

    None for numbers that go on by an even step, or are all the same and count nothing. Of numbers that are not whole
    only a fall is a fault.

    >>> numbering_fault(np.arange(0, 20, 2)) is None
    True
    >>> numbering_fault(np.array([1, 2, 3, 7, 8]))
    (2, 'frames are missing: write a file for each piece')
    """
    steps = np.diff(numbers)
    if not steps.any():
        return None
    values, counts = np.unique(steps[steps > 0], return_counts=True)
    usual = values[counts.argmax()] if len(values) else 0
    uneven = steps != usual if (numbers % 1 == 0).all() else steps < 0
    if not uneven.any():
        return None
    frame = int(uneven.argmax())
    if steps[frame] < 0:
        return frame, "are these several motions? Write a file for each"
    if steps[frame] > 0:
        return frame, "frames are missing: write a file for each piece"
    return frame, "a frame is there twice: leave one out"


def rates_of_fields(fields: Mapping[str, Any]) -> list[StatedRate]:
    """Return the frame rates that fields of an archive or pickle state, each that differs from those before it.

    Times are looked at where there is one for each frame of another array.

    Raises:
        MotionError: for a rate that is not one number, a time that no frame takes, or times that leave frames out.

    >>> rates_of_fields({"fps": 30, "dt": 0.02, "frequency": 30.1})
    [(30.0, "'fps'"), (50.0, "'dt'")]
    """
    fields = {name: value for name, value in fields.items() if value is not None}
    called = _called(fields)
    named = [name for known in _RATES if (name := called.get(known)) is not None]
    loose = [called[known] for known in _RATES_IF_ONE if known in called]
    named += [name for name in loose if _is_likely(_one_of(fields[name]))]
    stated = [(number(_one_of(fields[name]), name), repr(name)) for name in named]
    steps = [called[known] for known in _STEPS if known in called]
    alone = not stated  # else the two are compared
    stated += [(_rate_of_step(number(_one_of(fields[name]), name), name, alone), repr(name)) for name in steps]
    stated += [(rate_of_times(times), repr(name)) for name, times in times_of_fields(fields).items()]
    return distinct_rates(stated)


def _rate_of_step(step: float, name: str, alone: bool) -> float:
    """Return the frames a second of the seconds that a frame takes.

    Raises:
        MotionError: for a time that no frame takes, with the rate that it would be in another unit, where it is alone.

    >>> _rate_of_step(0.02, "dt", True)
    50.0
    """
    if not step > 0:
        raise MotionError(f"{name!r} is {step:g}, expected a positive time")
    least, most = FPS
    if alone and not least <= 1 / step <= most:
        units = (("milliseconds", 1e-3), ("microseconds", 1e-6), ("nanoseconds", 1e-9))
        meant = [f" ({1 / (step * unit):.4g} frames a second if it is in {told})" for told, unit in units]
        likely = [least <= 1 / (step * unit) <= most for _, unit in units]
        told = next((told for told, fits in zip(meant, likely, strict=True) if fits), "")
        raise MotionError(f"{name!r} is {step:g} s a frame, expected {1 / most:g} to {1 / least:g}{told}")
    return 1 / step


def times_of_fields(fields: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Return the times of the frames ``[T]`` that fields of an archive or pickle hold, by the names of these.

    They are as many as another array has rows, and no count of frames.
    """
    arrays = {name: value for name, value in fields.items() if isinstance(value, np.ndarray)}
    lengths = {size for array in arrays.values() if array.ndim > 1 for size in array.shape[:2]}
    return {
        name: times.astype(np.float64)
        for name, times in arrays.items()
        if tells_time(name) and times.ndim == 1 and len(times) in lengths and times.dtype.kind in "fiu"
        if len(times) > 2 and not counts_frames(times)
    }


def rate_fields(fields: Iterable[Any]) -> list[str]:
    """Return the names of fields that state the frames a second, or the seconds of one.

    >>> rate_fields(["FPS", "joint_pos", "frameRate", "dt", "time"])
    ['FPS', 'frameRate', 'dt']
    """
    called = _called(fields)
    return [called[known] for known in (*_RATES, *_RATES_IF_ONE, *_STEPS) if known in called]


def tells_time(field: str) -> bool:
    """Return whether a field has the time of each frame, by its name.

    >>> [tells_time(field) for field in ("sim_time", "timestamps", "contact_time", "s")]
    [True, True, False, False]
    """
    return is_time(field) and bool(_CLOCKS & set(tokens(field))) and "_".join(tokens(field)) not in _STEPS


def _called(fields: Iterable[Any]) -> dict[str, str]:
    """Return the names of fields by how plat writes them."""
    return {"_".join(tokens(name)): name for name in fields if isinstance(name, str)}


def _is_likely(value: Any) -> bool:
    """Return whether a value is one number that may be the rate of a motion."""
    one = value.item() if isinstance(value, np.ndarray) and value.size == 1 else value
    return isinstance(one, (int, float)) and LIKELY[0] <= one <= LIKELY[1]


def _one_of(values: Any) -> Any:
    """Return one of several equal numbers, as where each clip has its rate; else what it is."""
    several = isinstance(values, np.ndarray) and values.ndim == 1 and len(values) > 0
    return values[:1] if several and (values == values[0]).all() else values


def distinct_rates(stated: Iterable[StatedRate]) -> list[StatedRate]:
    """Return the rates that differ by more than rounding, each with what states it first.

    >>> distinct_rates([(30, "'fps'"), (29.97, "the file name"), (60, "a comment")])
    [(30, "'fps'"), (60, 'a comment')]
    """
    distinct: list[StatedRate] = []
    for rate, source in stated:
        if all(abs(rate - other) > _SAME_RATE * other for other, _ in distinct):
            distinct.append((rate, source))
    return distinct


def contradiction(rates: Sequence[StatedRate]) -> MotionError:
    """Return the error of a file that states several rates."""
    told = " and ".join(f"{rate:g} ({source})" for rate, source in rates)
    return MotionError(f"it states {told} frames a second; state which: plat motions convert --fps {rates[-1][0]:g}")


def contradicting_name(path: Path, rates: Iterable[StatedRate]) -> list[StatedRate]:
    """Return the frame rates that a file's name states, where none of them is among those that the file itself states.

    >>> contradicting_name(Path("walk_60fps.npz"), [(50.0, "'fps'")])
    [(60.0, 'the file name')]
    >>> contradicting_name(Path("walk_120fps_to_30fps.npz"), [(30.0, "'fps'")])
    []
    """
    named: list[StatedRate] = []
    with suppress(MotionError):  # a name that states 0 says nothing against a file
        named = [(rate, _NAME) for rate in (*rates_in_name(path.stem), *rates_of_steps(path.stem))]
    agree = any(len(distinct_rates((own, other))) == 1 for own in rates for other in named)
    return [] if agree else distinct_rates(named)


def stated_rates(path: Path, comments: Sequence[str]) -> list[StatedRate]:
    """Return the frame rates that comments and the name, else the name of the folder state, each with its source."""
    told = [
        *((rate, _COMMENT) for rate in rates_in_comments(comments)),
        *((rate, _NAME) for rate in (*rates_in_name(path.stem), *rates_of_steps(path.stem))),
    ]
    folder = path.absolute().parent.name
    return list(dict.fromkeys(told or ((rate, _FOLDER) for rate in rates_in_name(folder))))
