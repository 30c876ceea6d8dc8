"""Editable timeline: poses, their times, and the selection."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from plat.errors import KeyframeError
from plat.keyframes import Keyframe, KeyframeSequence, RobotJoints, standing
from plat.spec.timing import Timing

__all__ = ["NEW_INTERVAL", "Timeline"]

NEW_INTERVAL = 0.6
"""Seconds that a new keyframe gives to arrive in it."""


@dataclass(frozen=True, eq=False)
class Timeline:
    """Timeline of a start pose and keyframes, one of them selected. Every edit returns a new timeline.

    A keyframe keeps its interval from the pose before it: inserting, removing and stretching move all later
    keyframes in time. Intervals are whole control steps and never longer than ``timing.max_steps`` of them, so there is
    nothing to split and, other than being empty, nothing that :class:`plat.keyframes.KeyframeSequence` refuses.

    Args:
        robot: whose keyframes they are.
        start: the pose at time 0.
        keyframes: in the order of their times.
        selected: 0 for the start, else the number of a keyframe, counted from 1.
        timing: of the policies that are to chase them.

    >>> from plat.robots import G1
    >>> timeline = Timeline.empty(G1)
    >>> for _ in range(3):
    ...     timeline = timeline.inserted(timeline.pose.qpos, 0.5)
    >>> [keyframe.time for keyframe in timeline.select(1).removed().keyframes]
    [0.5, 1.0]
    """

    robot: RobotJoints
    start: Keyframe
    keyframes: tuple[Keyframe, ...] = ()
    selected: int = 0
    timing: Timing = Timing()

    @classmethod
    def empty(cls, robot: RobotJoints, timing: Timing = Timing()) -> Timeline:
        """Return the timeline of a standing robot without keyframes."""
        return cls(robot, standing(robot), timing=timing)

    @classmethod
    def of(cls, sequence: KeyframeSequence) -> Timeline:
        """Return the timeline of a sequence, the first keyframe selected."""
        return cls(sequence.robot, sequence.start, sequence.keyframes, 1, sequence.timing)

    def sequence(self) -> KeyframeSequence:
        """Return the sequence to play and save.

        Raises:
            KeyframeError: while there is no keyframe.
        """
        return KeyframeSequence(self.robot, self.start, self.keyframes, self.timing)

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
        """Return the seconds from the previous pose to the selected one; 0 for the start."""
        return self.timing.control_dt * self._steps()[self.selected - 1] if self.selected else 0.0

    def select(self, number: int) -> Timeline:
        """Select another pose; numbers beyond the ends select the ends."""
        return replace(self, selected=min(max(number, 0), len(self.keyframes)))

    def posed(self, qpos: np.ndarray) -> Timeline:
        """Replace the selected pose by ``[7 + J]``; its time and name stay."""
        pose = Keyframe.from_qpos(self.pose.time, qpos, self.pose.name)
        frames = [*self.poses]
        frames[self.selected] = pose
        return replace(self, start=frames[0], keyframes=tuple(frames[1:]))

    def renamed(self, name: str) -> Timeline:
        """Rename the selected keyframe; an empty name removes it."""
        self._check_keyframe("renamed")
        frames = [*self.keyframes]
        frames[self.selected - 1] = replace(self.pose, name=name.strip() or None)
        return replace(self, keyframes=tuple(frames))

    def inserted(self, qpos: np.ndarray, interval: float = NEW_INTERVAL, name: str | None = None) -> Timeline:
        """Insert a keyframe ``[7 + J]`` ``interval`` seconds after the selected pose, and select it."""
        frames, steps = [*self.keyframes], self._steps()
        frames.insert(self.selected, Keyframe.from_qpos(0.0, qpos, name))
        steps.insert(self.selected, self._allowed(interval))
        return self._spaced(frames, steps, self.selected + 1)

    def removed(self) -> Timeline:
        """Remove the selected keyframe and select its successor.

        Raises:
            KeyframeError: for the start.
        """
        self._check_keyframe("removed")
        frames, steps = [*self.keyframes], self._steps()
        del frames[self.selected - 1], steps[self.selected - 1]
        return self._spaced(frames, steps, min(self.selected, len(frames)))

    def moved(self, places: int) -> Timeline:
        """Move the selected keyframe later (or earlier) in the order, with its interval; it stays selected.

        Raises:
            KeyframeError: for the start.
        """
        self._check_keyframe("moved")
        frames, steps = [*self.keyframes], self._steps()
        here = self.selected - 1
        there = min(max(here + places, 0), len(frames) - 1)
        frames.insert(there, frames.pop(here))
        steps.insert(there, steps.pop(here))
        return self._spaced(frames, steps, there + 1)

    def stretched(self, interval: float) -> Timeline:
        """Set the selected keyframe's interval from the previous pose (s); later keyframes move along.

        Raises:
            KeyframeError: for the start.
        """
        self._check_keyframe("moved in time")
        steps = self._steps()
        steps[self.selected - 1] = self._allowed(interval)
        return self._spaced(self.keyframes, steps, self.selected)

    def retimed(self, number: int, time: float) -> Timeline:
        """Move keyframe ``number`` to a time (s), limited by its neighbors; no other one moves."""
        steps = self._steps()
        before, longest = sum(steps[: number - 1]), self.timing.max_steps
        if number < len(steps):
            both = steps[number - 1] + steps[number]
            span = range(max(1, both - longest), min(longest, both - 1) + 1)
        else:
            both = None
            span = range(1, longest + 1)
        steps[number - 1] = min(max(self.timing.steps(time) - before, span[0]), span[-1])
        if both is not None:
            steps[number] = both - steps[number - 1]
        return self._spaced(self.keyframes, steps, self.selected)

    def _steps(self) -> list[int]:
        """Return the control steps from each pose to the next."""
        arrivals = [self.timing.steps(pose.time) for pose in self.poses]
        return [after - before for before, after in pairwise(arrivals)]

    def _spaced(self, frames: Sequence[Keyframe], steps: Sequence[int], selected: int) -> Timeline:
        arrivals = np.cumsum(steps).tolist()
        timed = tuple(
            frame.at(round(step * self.timing.control_dt, 6)) for frame, step in zip(frames, arrivals, strict=True)
        )  # rounded, so that files hold 0.6 and not 0.6000000000000001
        return replace(self, keyframes=timed, selected=selected)

    def _check_keyframe(self, what: str) -> None:
        if self.selected == 0:
            raise KeyframeError(f"the start pose cannot be {what}: select a keyframe")

    def _allowed(self, interval: float) -> int:
        """Return the control steps nearest to an interval (s) that a command can be long."""
        return min(max(self.timing.steps(interval), 1), self.timing.max_steps)
