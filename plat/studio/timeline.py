"""Editable timeline: poses, their times, how long they are held, and the selection."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from plat.errors import KeyframeError
from plat.keyframes import Keyframe, KeyframeSequence, Parts, RobotJoints, interpolate, split_long_intervals, standing
from plat.keyframes.roots import as_arrived
from plat.spec.timing import Timing

__all__ = ["LONGEST_INTERVAL", "NEW_INTERVAL", "Timeline"]

NEW_INTERVAL = 0.6
"""Seconds that a new keyframe gives to arrive in it."""
LONGEST_INTERVAL = 30.0
"""Longest time between two keyframes, and longest hold (s), that edits make; those of files may be longer."""

# Ends the name of the keyframe that ends a hold, in files.
_HOLD = "(hold)"


@dataclass(frozen=True, eq=False)
class Timeline:
    """Timeline of a start pose and keyframes, one of them selected. Every edit returns a new timeline.

    A keyframe can be held: the robot stays in it until ``time + hold``. Its interval is the time from the end of the
    previous pose to its arrival. Inserting, removing and stretching keep all intervals and move later keyframes.

    Intervals are whole control steps. Those longer than a policy's longest command are split when it plays them, see
    :meth:`sequence`. So every timeline can be played unless it is empty.

    Args:
        robot: whose keyframes they are.
        start: the pose at time 0.
        keyframes: in the order of their times.
        selected: 0 for the start, else the number of a keyframe, counted from 1.
        timing: of the policies that are to chase them.
        holds: seconds that each keyframe is held; by default none is.
        origin: the same for all edits of each other; another one for keyframes that are read or begun anew.

    >>> from plat.robots import G1
    >>> timeline = Timeline.empty(G1)
    >>> for _ in range(3):
    ...     timeline = timeline.inserted(timeline.pose.qpos, 0.5)
    >>> [keyframe.time for keyframe in timeline.select(1).held(0.4).keyframes]
    [0.5, 1.4, 1.9]
    """

    robot: RobotJoints
    start: Keyframe
    keyframes: tuple[Keyframe, ...] = ()
    selected: int = 0
    timing: Timing = Timing()
    holds: tuple[float, ...] = ()
    origin: object = field(default_factory=object)

    def __post_init__(self) -> None:
        if len(self.holds) != len(self.keyframes):
            object.__setattr__(self, "holds", (0.0,) * len(self.keyframes))

    @classmethod
    def empty(cls, robot: RobotJoints, timing: Timing = Timing()) -> Timeline:
        """Return the timeline of a standing robot without keyframes."""
        return cls(robot, standing(robot), timing=timing)

    @classmethod
    def of(cls, start: Keyframe, keyframes: Sequence[Keyframe], robot: RobotJoints, timing: Timing) -> Timeline:
        """Return the timeline of the keyframes of a file, the first one selected.

        Raises:
            KeyframeError: for times that do not increase, or keyframes of another robot.
        """
        # for its checks
        KeyframeSequence(robot, start, split_long_intervals(start, keyframes, timing), timing)
        frames: list[Keyframe] = []
        holds: list[float] = []
        for frame in keyframes:
            if frames and _holds(frames[-1], frame):
                holds[-1] = round(frame.time - frames[-1].time, 6)
            else:
                frames.append(frame)
                holds.append(0.0)
        return cls(robot, start, tuple(frames), 1, timing, tuple(holds))

    def to_keyframes(self) -> tuple[Keyframe, ...]:
        """Return the keyframes, each hold as another keyframe in the same pose, for a file."""
        frames: list[Keyframe] = []
        for frame, hold in zip(self.keyframes, self.holds, strict=True):
            frames.append(frame)
            if hold:
                frames.append(replace(frame, time=round(frame.time + hold, 6), name=_hold_name(frame)))
        return tuple(frames)

    def sequence(self, timing: Timing | None = None) -> KeyframeSequence:
        """Return the sequence to play: with the ends of holds, and long intervals split.

        Args:
            timing: of the policy that plays; by default the timeline's own.

        Raises:
            KeyframeError: while there is no keyframe.
        """
        if not self.keyframes:
            raise KeyframeError("there are no keyframes yet: press A, or add a template")
        timing = timing or self.timing
        frames = split_long_intervals(self.start, self.to_keyframes(), timing)
        return KeyframeSequence(self.robot, self.start, frames, timing)

    def toward(self, time: float) -> int:
        """Return the number of the keyframe that is on its way or held at a time (s); after the end, the last one."""
        ends = [frame.time + hold + 1e-6 for frame, hold in zip(self.keyframes, self.holds, strict=True)]
        return min(int(np.searchsorted(ends, time)) + 1, len(self.keyframes))

    @property
    def poses(self) -> tuple[Keyframe, ...]:
        """Return the start and all keyframes."""
        return (self.start, *self.keyframes)

    @property
    def pose(self) -> Keyframe:
        """Return the selected pose."""
        return self.poses[self.selected]

    @property
    def labels(self) -> tuple[str, ...]:
        """Return the label of each pose: ``start``, then number and name."""
        return ("start", *(f"{number} {frame.name or ''}".strip() for number, frame in enumerate(self.keyframes, 1)))

    @property
    def interval(self) -> float:
        """Return the seconds from the end of the previous pose to the selected one; 0 for the start."""
        return round(self.timing.control_dt * self._gaps()[self.selected - 1], 6) if self.selected else 0.0

    @property
    def hold(self) -> float:
        """Return the seconds that the selected pose is held."""
        return self.holds[self.selected - 1] if self.selected else 0.0

    @property
    def duration(self) -> float:
        """Return the end of the last keyframe (s)."""
        return round(self.keyframes[-1].time + self.holds[-1], 6) if self.keyframes else 0.0

    def sample(self, time: float) -> Keyframe:
        """Return the pose at a time (s): held, or interpolated between keyframes."""
        before, end = self.start, 0.0
        for frame, hold in zip(self.keyframes, self.holds, strict=True):
            if time < frame.time:
                return interpolate(before.at(end), frame, max(time, end))
            before, end = frame, frame.time + hold
            if time <= end:
                break
        return before.at(time)

    def at(self, time: float) -> int | None:
        """Return the number of the pose that is arrived at at a time, to a control step; None between poses."""
        step = self.timing.steps(time)
        return next((number for number, pose in enumerate(self.poses) if self.timing.steps(pose.time) == step), None)

    def select(self, number: int) -> Timeline:
        """Select another pose; numbers beyond the ends select the ends."""
        return replace(self, selected=min(max(number, 0), len(self.keyframes)))

    def posed(self, qpos: np.ndarray) -> Timeline:
        """Replace the selected pose by ``[7 + J]``; its time and name stay."""
        pose = Keyframe.from_qpos(self.pose.time, qpos)
        new = replace(self.pose, root_pos=pose.root_pos, root_quat=pose.root_quat, joint_pos=pose.joint_pos)
        return self._with_pose(new)

    def renamed(self, name: str) -> Timeline:
        """Rename the selected keyframe; an empty name removes it."""
        self._check_keyframe("renamed")
        name = name.strip()
        while name.endswith(_HOLD):  # "(hold) (hold)" without its last would come back from a file as a hold
            name = name.removesuffix(_HOLD).strip()
        return self._with_pose(replace(self.pose, name=name or None))

    def commanding(self, commands: Parts | None) -> Timeline:
        """Set what the selected keyframe commands; None for the whole pose.

        Raises:
            KeyframeError: for the start.
        """
        self._check_keyframe("commanded in part")
        return self._with_pose(replace(self.pose, commands=commands))

    def inserted(
        self, pose: np.ndarray | Keyframe, interval: float = NEW_INTERVAL, name: str | None = None, hold: float = 0.0
    ) -> Timeline:
        """Insert a pose ``[7 + J]`` or a keyframe ``interval`` seconds after the selected one, and select it."""
        new = pose if isinstance(pose, Keyframe) else Keyframe.from_qpos(0.0, pose, name)
        frames, gaps, holds = [*self.keyframes], self._gaps(), self._hold_steps()
        frames.insert(self.selected, new)
        gaps.insert(self.selected, self._allowed(interval))
        holds.insert(self.selected, max(self._allowed(hold, 0), 0))
        return self._spaced(frames, gaps, holds, self.selected + 1)

    def inserted_at(self, time: float) -> Timeline:
        """Insert the interpolated pose at a time (s) and select it; no keyframe moves.

        It commands what the keyframe that it leads to does. Within a hold or on a keyframe there is no room: then the
        keyframe there is selected.
        """
        step = self.timing.steps(time)
        if step <= 0:
            return self.select(0)
        arrivals = [self.timing.steps(frame.time) for frame in self.keyframes]
        ends = [arrival + hold for arrival, hold in zip(arrivals, self._hold_steps(), strict=True)]
        for number, (arrival, end) in enumerate(zip(arrivals, ends, strict=True), 1):
            if arrival <= step <= end:
                return self.select(number)
        here = sum(end < step for end in ends)
        frames, gaps, holds = [*self.keyframes], self._gaps(), self._hold_steps()
        before = ends[here - 1] if here else 0
        leads_to = frames[min(here, len(frames) - 1)] if frames else self.start
        pose = replace(self.sample(step * self.timing.control_dt), name=None, commands=leads_to.commands)
        frames.insert(here, pose)
        gaps.insert(here, step - before)
        holds.insert(here, 0)
        if here + 1 < len(gaps):
            gaps[here + 1] -= step - before
        return self._spaced(frames, gaps, holds, here + 1)

    @property
    def ways(self) -> tuple[tuple[Keyframe, Keyframe], ...]:
        """Return, for each keyframe, the pose that the robot leaves for it, with its time, and the keyframe."""
        ways, before, end = [], self.start, 0.0
        for frame, hold in zip(self.keyframes, self.holds, strict=True):
            ways.append((before.at(end), frame))
            before, end = as_arrived(before, frame), frame.time + hold
        return tuple(ways)

    @property
    def way(self) -> tuple[Keyframe, Keyframe]:
        """Return that of :attr:`ways` to the selected keyframe.

        Raises:
            KeyframeError: for the start.
        """
        self._check_keyframe("gone to")
        return self.ways[self.selected - 1]

    def parted(self, middle: Keyframe) -> Timeline:
        """Insert a keyframe on the way to the selected one, which stays selected; no keyframe moves."""
        parted = self.inserted_at(middle.time)
        return parted._with_pose(middle.at(parted.pose.time)).select(self.selected + 1)

    def removed(self) -> Timeline:
        """Remove the selected keyframe and select its successor.

        Raises:
            KeyframeError: for the start.
        """
        self._check_keyframe("removed")
        frames, gaps, holds = [*self.keyframes], self._gaps(), self._hold_steps()
        for values in (frames, gaps, holds):
            del values[self.selected - 1]
        return self._spaced(frames, gaps, holds, min(self.selected, len(frames)))

    def moved(self, places: int) -> Timeline:
        """Move the selected keyframe later (or earlier) in the order, with interval and hold; it stays selected.

        Raises:
            KeyframeError: for the start.
        """
        self._check_keyframe("moved")
        frames, gaps, holds = [*self.keyframes], self._gaps(), self._hold_steps()
        here = self.selected - 1
        there = min(max(here + places, 0), len(frames) - 1)
        frames.insert(there, frames.pop(here))
        gaps.insert(there, gaps.pop(here))
        holds.insert(there, holds.pop(here))
        return self._spaced(frames, gaps, holds, there + 1)

    def stretched(self, interval: float) -> Timeline:
        """Set the selected keyframe's interval from the previous pose (s); later keyframes move along.

        Raises:
            KeyframeError: for the start.
        """
        self._check_keyframe("moved in time")
        gaps = self._gaps()
        gaps[self.selected - 1] = self._allowed(interval, had=gaps[self.selected - 1])
        return self._spaced(self.keyframes, gaps, self._hold_steps(), self.selected)

    def held(self, seconds: float) -> Timeline:
        """Set how long the selected keyframe is held (s); later keyframes move along.

        Raises:
            KeyframeError: for the start.
        """
        self._check_keyframe("held")
        holds = self._hold_steps()
        holds[self.selected - 1] = self._allowed(seconds, 0, holds[self.selected - 1])
        return self._spaced(self.keyframes, self._gaps(), holds, self.selected)

    def retimed(self, number: int, time: float) -> Timeline:
        """Move keyframe ``number`` to a time (s) between its neighbors; no other one moves."""
        gaps, holds = self._gaps(), self._hold_steps()
        before = sum(gaps[: number - 1]) + sum(holds[: number - 1])
        asked = self._allowed(self.timing.control_dt * (self.timing.steps(time) - before), had=gaps[number - 1])
        if number < len(gaps):
            both = gaps[number - 1] + gaps[number]
            asked = min(asked, both - 1)
            gaps[number] = both - asked
        gaps[number - 1] = asked
        return self._spaced(self.keyframes, gaps, holds, self.selected)

    def _with_pose(self, pose: Keyframe) -> Timeline:
        frames = [*self.poses]
        frames[self.selected] = pose
        return replace(self, start=frames[0], keyframes=tuple(frames[1:]))

    def _gaps(self) -> list[int]:
        """Return the control steps from the end of each pose to the arrival of the next."""
        gaps, end = [], 0
        for frame, hold in zip(self.keyframes, self._hold_steps(), strict=True):
            arrival = self.timing.steps(frame.time)
            gaps.append(arrival - end)
            end = arrival + hold
        return gaps

    def _hold_steps(self) -> list[int]:
        # of keyframes between control steps the end is rounded, as where they are played
        steps = self.timing.steps
        pairs = zip(self.keyframes, self.holds, strict=True)
        return [steps(frame.time + hold) - steps(frame.time) for frame, hold in pairs]

    def _spaced(self, frames: Sequence[Keyframe], gaps: Sequence[int], holds: Sequence[int], selected: int) -> Timeline:
        timed, end, control_dt = [], 0, self.timing.control_dt
        for frame, gap, hold in zip(frames, gaps, holds, strict=True):
            # rounded, so that files hold 0.6 and not 0.6000000000000001
            timed.append(frame.at(round((end + gap) * control_dt, 6)))
            end += gap + hold
        seconds = tuple(round(hold * control_dt, 6) for hold in holds)
        return replace(self, keyframes=tuple(timed), holds=seconds, selected=selected)

    def _check_keyframe(self, what: str) -> None:
        if self.selected == 0:
            raise KeyframeError(f"the start pose cannot be {what}: select a keyframe")

    def _allowed(self, seconds: float, least: int = 1, had: int = 0) -> int:
        """Return the control steps nearest to an interval or hold (s) that are allowed, where it had so many before."""
        return min(max(self.timing.steps(seconds), least), max(self.timing.steps(LONGEST_INTERVAL), had))


def _hold_name(frame: Keyframe) -> str:
    """Return the name in files of the keyframe that ends the hold of another one."""
    return f"{frame.name or ''} {_HOLD}".strip()


def _holds(before: Keyframe, frame: Keyframe) -> bool:
    """Return whether a keyframe of a file only ends the hold of the one before it: all but its time is the same."""
    same = before.commands == frame.commands or (before.whole and frame.whole)
    return frame.name == _hold_name(before) and same and np.array_equal(frame.qpos, before.qpos)
