"""Keyframe sequences: which keyframe is commanded when."""

from __future__ import annotations  # the types of motions and robots bring torch with them

from bisect import bisect_right
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate
from pathlib import Path
from typing import TYPE_CHECKING

from plat.bounds import as_names, check_value, is_finite
from plat.errors import KeyframeError
from plat.files import as_path
from plat.json_file import short
from plat.keyframes.files import read_keyframes, write_keyframes
from plat.keyframes.keyframe import (
    Keyframe,
    RobotJoints,
    check_keyframe,
    check_keyframes,
    check_time,
    interpolate,
    standing,
)
from plat.keyframes.roots import as_arrived, with_commanded_root
from plat.keyframes.splits import LongInterval, long_intervals, unit_doubt
from plat.spec.timing import Timing
from plat.words import counted

if TYPE_CHECKING:
    from plat.motions.clip import MotionClip
    from plat.robots.robot import Robot

__all__ = ["Command", "KeyframeSequence", "check_sequence", "split_long_intervals"]


@dataclass(frozen=True)
class Command:
    """Command at a moment: a keyframe and the time left.

    Args:
        index: number of the keyframe in its sequence.
        keyframe: commanded pose.
        steps_left: control steps to the arrival, at least 1.
        length: total control steps of the command.
    """

    index: int
    keyframe: Keyframe
    steps_left: int
    length: int


@dataclass(frozen=True, eq=False)
class KeyframeSequence:
    """Sequence of keyframes for one robot, in the order of their times.

    A keyframe is commanded from the previous arrival until its own. Arrivals are on control steps: time ``t`` is step
    ``round(t / timing.control_dt)``.

    Args:
        robot: whose keyframes they are.
        start: the pose at time 0, for simulations to begin in; see :func:`standing`.
        keyframes: at least one, times strictly increasing, at least a control step and at most ``timing.max_steps``
            control steps after the one before (the first: after time 0); see :func:`split_long_intervals`.
        timing: of the policy that is to chase them.

    Raises:
        KeyframeError: naming keyframe and field.
        ConfigError: for what is no timing.

    >>> from plat.robots import G1
    >>> pose = standing(G1)
    >>> sequence = KeyframeSequence(G1, pose, (pose.at(0.5), pose.at(1.5)))
    >>> command = sequence.command(0.6)
    >>> command.index, command.steps_left, command.length
    (1, 45, 50)
    """

    robot: RobotJoints
    start: Keyframe
    keyframes: tuple[Keyframe, ...]
    timing: Timing = Timing()

    def __post_init__(self) -> None:
        check_value("timing", self.timing, Timing)
        check_keyframe("start", self.start)
        keyframes = check_keyframes("keyframes", self.keyframes or ())
        if not keyframes:
            raise KeyframeError("keyframes: none, expected at least one")
        checked = [_checked(self.start, "start", self.robot)]
        if checked[0].time != 0:
            raise KeyframeError(f"start: time is {checked[0].time:g} s, expected 0")
        for index, keyframe in enumerate(keyframes):
            label = _label(index, keyframe)
            checked.append(_checked(keyframe, label, self.robot))
            _check_order(checked[-2], checked[-1], label, self.timing)
            _check_length(checked[-2], checked[-1], label, self.timing, keyframes)
        # frozen: the checked copies replace the arguments
        object.__setattr__(self, "start", checked[0])
        object.__setattr__(self, "keyframes", tuple(checked[1:]))

    def __len__(self) -> int:
        return len(self.keyframes)

    @property
    def partial(self) -> Keyframe | None:
        """Return the first keyframe that commands a part of its pose; None when all are whole."""
        return next((keyframe for keyframe in self.keyframes if not keyframe.whole), None)

    @property
    def duration(self) -> float:
        """Return the time of the last keyframe (s), as it is written.

        It arrives on the control step nearest to it, the last of :attr:`arrival_steps`, where a chase ends or holds.
        """
        return self.keyframes[-1].time

    @property
    def arrival_steps(self) -> tuple[int, ...]:
        """Return the control step of each keyframe's arrival, counted from time 0."""
        return tuple(self.timing.steps(keyframe.time) for keyframe in self.keyframes)

    def command(self, time: float) -> Command | None:
        """Return the command at a time (s), rounded to a control step; None from the last arrival on."""
        step, arrivals = max(self.timing.steps(time), 0), (0, *self.arrival_steps)
        index = bisect_right(arrivals, step) - 1
        if index == len(self):
            return None
        arrival = arrivals[index + 1]
        return Command(index, self.keyframes[index], arrival - step, arrival - arrivals[index])

    def sample(self, time: float) -> Keyframe:
        """Return the pose at a time (s), see :func:`interpolate`; first and last pose extend beyond the ends.

        Keyframes are where their arrivals are, on control steps, however their times are written.
        The root of a partial keyframe is where the robot probably is, see :func:`plat.keyframes.roots.as_arrived`.
        """
        return _between(self._sampled, time)

    def commanded(self, time: float) -> Keyframe:
        """Return the pose at a time (s) with the root as it is commanded: what no keyframe says is as it was."""
        return _between(self._commanded, time)

    def on_the_way(self, index: int, began: Keyframe, time: float) -> Keyframe:
        """Return the same on the way to keyframe ``index`` from what it begins with, :meth:`began`."""
        return _between((began, self._commanded[index + 1]), time)

    def began(self, index: int, measured: Keyframe) -> Keyframe:
        """Return what the way to keyframe ``index`` begins with: what the one before left open of the root is measured.

        A robot that squatted because only its hands were commanded low is on its way up, and no one that has fallen.

        Args:
            index: of the keyframe.
            measured: a pose with the robot's root when the keyframe before was over.
        """
        before = self._commanded[index]
        if index == 0:
            return before
        return with_commanded_root(measured, replace(before, commands=self.keyframes[index - 1].commands))

    def ends(self, index: int) -> tuple[Keyframe, Keyframe]:
        """Return the poses that keyframe ``index`` and the one before it command, roots as in :meth:`commanded`."""
        return self._commanded[index], self._commanded[index + 1]

    @cached_property
    def arrived(self) -> tuple[Keyframe, ...]:
        """Return the start and the keyframes, each with its root where the robot probably is at the arrival."""
        return tuple(accumulate((self.start, *self.keyframes), as_arrived))

    @cached_property
    def _sampled(self) -> tuple[Keyframe, ...]:
        return self._on_steps(self.arrived)

    @cached_property
    def _commanded(self) -> tuple[Keyframe, ...]:
        return self._on_steps(tuple(accumulate((self.start, *self.keyframes), with_commanded_root)))

    def _on_steps(self, poses: Sequence[Keyframe]) -> tuple[Keyframe, ...]:
        steps = (0, *self.arrival_steps)
        return tuple(pose.at(step * self.timing.control_dt) for pose, step in zip(poses, steps, strict=True))

    def with_timing(self, timing: Timing, *, split: bool = False) -> KeyframeSequence:
        """Return the same keyframes for a policy of another timing.

        Args:
            timing: of the policy.
            split: split intervals that are too long by :func:`split_long_intervals`; by default they are refused.

        Raises:
            KeyframeError: naming the keyframe that is too long, or too short, after the one before.

        >>> from plat.robots import G1
        >>> pose = standing(G1)
        >>> slow = KeyframeSequence(G1, pose, (pose.at(3.0),), Timing(max_steps=150))
        >>> len(slow.with_timing(Timing(), split=True))
        3
        """
        if timing == self.timing:
            return self
        keyframes = split_long_intervals(self.start, self.keyframes, timing) if split else self.keyframes
        return KeyframeSequence(self.robot, self.start, keyframes, timing)

    def save(self, path: str | Path) -> None:
        """Write the JSON file; it is replaced atomically or not at all.

        Raises:
            KeyframeError: when the disk does not take it.
        """
        write_keyframes(as_path(path, "keyframe file", KeyframeError), self.robot, self.start, self.keyframes)

    @classmethod
    def load(
        cls,
        path: str | Path,
        robot: RobotJoints,
        *,
        split: bool = False,
        timing: Timing = Timing(),
        tell: Callable[[LongInterval], object] | None = None,
    ) -> KeyframeSequence:
        """Read a JSON file.

        Args:
            path: the file; its format is described in ``docs/keyframes.md``.
            robot: whose keyframes are expected.
            split: split intervals that are too long by :func:`split_long_intervals`; by default they are refused.
            timing: of the policy that is to chase them.
            tell: called with each interval that is split.

        Raises:
            KeyframeError: naming file, keyframe and field.
        """
        start, keyframes = read_keyframes(as_path(path, "keyframe file", KeyframeError), robot)
        start = start or standing(robot)
        try:
            parts = split_long_intervals(start, keyframes, timing) if split else keyframes
            sequence = cls(robot, start, parts, timing)
        except KeyframeError as error:
            raise KeyframeError(f"keyframe file {str(path)!r}: {error}") from None
        if tell is not None:
            for interval in long_intervals(start, keyframes, timing):
                tell(interval)
        return sequence

    @classmethod
    def from_motion(
        cls,
        motion: MotionClip,
        times: Sequence[float],
        robot: Robot,
        *,
        begin: float = 0.0,
        names: Sequence[str | None] | None = None,
        timing: Timing = Timing(),
    ) -> KeyframeSequence:
        """Return keyframes of a motion clip, in the clip's world frame.

        Args:
            motion: the clip.
            times: seconds in the clip, strictly increasing, after ``begin``.
            robot: whose motion it is.
            begin: second of the clip that is time 0 of the sequence; its pose is the start.
            names: of the keyframes.
            timing: of the policy that is to chase them.

        Raises:
            MotionError: when the clip is broken.
            KeyframeError: naming keyframe and field; also for a time outside the clip.

        >>> from plat.robots import G1
        >>> from plat.motions.generation import generate_named
        >>> clip = generate_named("generated:val/wave@4")[0]
        >>> len(KeyframeSequence.from_motion(clip, [0.5, 1.0, 2.0], G1))
        3
        """
        if not isinstance(times, Iterable):
            raise KeyframeError(f"times is {short(times)}, expected a list of seconds")
        times = list(times)
        poses = [Keyframe.from_motion(motion, time, robot) for time in times]
        labels = [None] * len(times) if names is None else as_names(names)
        if len(labels) != len(times):
            raise KeyframeError(
                f"names: {len(labels)} for {counted(len(times), 'keyframe')}, expected one for each or none"
            )
        keyframes = (
            replace(pose, time=round(pose.time - begin, 9), name=name) for pose, name in zip(poses, labels, strict=True)
        )
        return cls(robot, Keyframe.from_motion(motion, begin, robot).at(0.0), tuple(keyframes), timing)


def check_sequence(what: str, given: object) -> None:
    """Raise an error for what is no keyframe sequence.

    Raises:
        KeyframeError: beginning with ``what``.
    """
    if not isinstance(given, KeyframeSequence):
        raise KeyframeError(f"{what} is {short(given)}, expected a KeyframeSequence")


def split_long_intervals(
    start: Keyframe, keyframes: Sequence[Keyframe], timing: Timing = Timing()
) -> tuple[Keyframe, ...]:
    """Insert keyframes into intervals of more than ``timing.max_steps`` steps; return the new sequence of keyframes.

    Such an interval is split into as few equal parts as possible, to a control step, at poses of :func:`interpolate`.
    An added keyframe is named after the one that it leads to: ``wave 1/3``, ``wave 2/3``. It commands the same parts.
    The way begins where the robot probably is, see :func:`plat.keyframes.roots.as_arrived`.

    Raises:
        KeyframeError: for times that do not increase, or are none, and for what is no pose.

    >>> from plat.robots import G1
    >>> pose = standing(G1)
    >>> [keyframe.time for keyframe in split_long_intervals(pose, [pose.at(1.0), pose.at(3.5)])]
    [1.0, 1.82, 2.66, 3.5]
    """
    check_value("timing", timing, Timing)
    check_keyframe("start", start)
    keyframes = check_keyframes("keyframes", keyframes)
    result: list[Keyframe] = []
    check_time(start.time, "start: time")
    before = start
    for index, keyframe in enumerate(keyframes):
        label = _label(index, keyframe)
        check_time(keyframe.time, f"{label}: time")
        _check_order(before, keyframe, label, timing)
        first = timing.steps(before.time)
        steps = timing.steps(keyframe.time) - first
        parts = -(-steps // timing.max_steps)
        for part in range(1, parts):
            time = round((first + part * steps // parts) * timing.control_dt, 6)
            name = keyframe.name and f"{keyframe.name} {part}/{parts}"
            try:
                pose = interpolate(before, keyframe, time)
            except KeyframeError as error:
                raise KeyframeError(f"{label}: {error}") from None
            result.append(replace(pose, name=name, commands=keyframe.commands))
        result.append(keyframe)
        before = as_arrived(before, keyframe)
    return tuple(result)


def _between(poses: Sequence[Keyframe], time: float) -> Keyframe:
    """Return the pose at a time (s) between poses, or the one at the end that is nearest."""
    if not is_finite(time):
        raise KeyframeError(f"time is {short(time)}, expected a finite number of seconds")
    time = float(time)  # it may be an array without axes
    after = bisect_right([pose.time for pose in poses], time)
    if after in (0, len(poses)):
        return poses[min(after, len(poses) - 1)].at(time)
    return interpolate(poses[after - 1], poses[after], time)


def _label(index: int, keyframe: Keyframe) -> str:
    return f"keyframe {index}" + (f" ({keyframe.name!r})" if keyframe.name else "")


def _checked(keyframe: Keyframe, label: str, robot: RobotJoints) -> Keyframe:
    try:
        return keyframe.checked(robot)
    except KeyframeError as error:
        raise KeyframeError(f"{label}: {error}") from None


def _check_order(before: Keyframe, keyframe: Keyframe, label: str, timing: Timing) -> None:
    if timing.steps(keyframe.time) <= timing.steps(before.time):
        raise KeyframeError(
            f"{label}: time is {keyframe.time:g} s, expected at least {timing.control_dt:g} s after {before.time:g} s"
        )


def _check_length(
    before: Keyframe, keyframe: Keyframe, label: str, timing: Timing, keyframes: Sequence[Keyframe]
) -> None:
    steps = timing.steps(keyframe.time) - timing.steps(before.time)
    if steps > timing.max_steps:
        doubt = unit_doubt(keyframes)
        raise KeyframeError(
            f"{label}: time is {keyframe.time:g} s, {steps} control steps after {before.time:g} s, expected at most "
            f"{timing.max_steps} ({timing.longest:g} s): add a keyframe in between, have the interval split (--split "
            "of plat play, plat sim-to-sim and plat keyframes show), or use longer commands (--timing.max-steps of "
            f"plat keyframes, or another policy){doubt and f'; {doubt}'}"
        )
