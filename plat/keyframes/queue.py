"""Queue of keyframes that other programs fill while a robot moves."""

import threading
from bisect import bisect_left, insort
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from plat.bounds import check_robot, check_value, is_finite
from plat.errors import KeyframeError
from plat.json_file import short
from plat.keyframes.keyframe import Keyframe, RobotJoints, check_keyframe
from plat.keyframes.sequence import Command
from plat.spec.timing import Timing

__all__ = ["Answer", "KeyframeQueue"]

Answer = Literal["queued", "late", "too soon", "too far"]


class KeyframeQueue:
    """Queue of keyframes by time of arrival; threads may share it. It commands like a keyframe sequence.

    The earliest keyframe whose arrival has not passed is commanded. One that is farther away than the policy's longest
    command is commanded as soon as it comes within reach; until then nothing is.

    Args:
        robot: whose keyframes they are.
        timing: of the policy.

    >>> from plat.keyframes import standing
    >>> from plat.robots import G1
    >>> queue = KeyframeQueue(G1)
    >>> queue.put(standing(G1).at(0.5), now=0.2)
    'queued'
    >>> queue.command(0.2).steps_left, queue.command(0.5)
    (15, None)
    >>> queue.put(standing(G1).at(0.1), now=0.2)
    'late'
    """

    def __init__(self, robot: RobotJoints, timing: Timing = Timing()):
        check_robot(robot)
        check_value("timing", timing, Timing)
        self.robot = robot
        """Whose keyframes they are."""
        self.timing = timing
        """Of the policy."""
        self._lock = threading.Lock()
        self._queue: list[Keyframe] = []
        self._index = 0

    def __getstate__(self) -> dict[str, Any]:
        with self._lock:
            return {**vars(self), "_queue": list(self._queue), "_lock": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state, _lock=threading.Lock())  # a copy is shared by threads of its own

    def __len__(self) -> int:
        return len(self._queue)

    def put(self, keyframe: Keyframe, now: float, *, replace_all: bool = False) -> Answer:
        """Add a keyframe; say whether it was taken.

        Args:
            keyframe: its time is that of the arrival (s, the robot's clock).
            now: time of the robot's clock (s).
            replace_all: forget all others if this one is taken, as a teleoperator does at every frame. Otherwise it
                takes the place of one with the same control step, if there is one.

        Returns:
            ``"queued"``; or why not: ``"late"``, when its arrival has passed; ``"too soon"``, when it is the control
            step at hand; ``"too far"``, when it comes later than a minute from now.

        Raises:
            KeyframeError: for a pose that is not the robot's, or a time that is not finite.
        """
        if not is_finite(now):
            raise KeyframeError(f"now is {short(now)} s, expected the time of the robot's clock")
        check_keyframe("keyframe", keyframe)
        checked = keyframe.checked(self.robot)
        steps = self.timing.steps(checked.time) - self.timing.steps(now)
        if steps <= 0:
            return "late" if steps < 0 else "too soon"
        if checked.time - now > _LONGEST_WAIT:
            return "too far"
        with self._lock:
            if replace_all:
                self._queue.clear()
            arrivals = [self.timing.steps(each.time) for each in self._queue]
            place = bisect_left(arrivals, self.timing.steps(checked.time))
            if place < len(arrivals) and arrivals[place] == self.timing.steps(checked.time):
                self._queue[place] = checked
            else:
                insort(self._queue, checked, key=lambda each: each.time)
        return "queued"

    def cancel(self) -> int:
        """Forget all keyframes; return how many there were."""
        with self._lock:
            count = len(self._queue)
            self._queue.clear()
        return count

    def stay(self, pose: Keyframe, now: float, seconds: float = 0.5) -> None:
        """Forget all keyframes and command one pose, for example where the robot is: what a cancellation means.

        The pose may be a measured one: an angle beyond its joint's range is taken to be at the end of it.

        Args:
            pose: to stay in.
            now: time of the robot's clock (s).
            seconds: until its arrival. It is after the next control step at the earliest, and no farther away than the
                policy's longest command.

        Raises:
            KeyframeError: for a pose that is not the robot's, or no time; all keyframes are forgotten nevertheless.
        """
        staying: list[Keyframe] = []
        try:
            if not (is_finite(now) and is_finite(seconds)):
                raise KeyframeError(f"now is {short(now)} s and seconds {short(seconds)}, expected finite numbers")
            check_keyframe("pose", pose)
            step, after = self.timing.steps(now), self.timing.steps(now + self.timing.control_dt)
            arrival = min(max(step + self.timing.steps(seconds), after + 1), step + self.timing.max_steps)
            time = arrival * self.timing.control_dt
            staying.append(replace(pose, time=time, joint_pos=self._within(pose.joint_pos)).checked(self.robot))
        finally:
            with self._lock:
                self._queue[:] = staying

    def command(self, time: float) -> Command | None:
        """Return the command at a time (s); None when there is none within reach. Times do not go back."""
        step = self.timing.steps(time)
        with self._lock:
            while self._queue and self.timing.steps(self._queue[0].time) <= step:
                self._queue.pop(0)
                self._index += 1
            if not self._queue:
                return None
            left = self.timing.steps(self._queue[0].time) - step
            if left > self.timing.max_steps:
                return None
            return Command(self._index, self._queue[0], left, left)

    def _within(self, joint_pos: np.ndarray) -> np.ndarray:
        """Return angles within the joints' ranges; what are no angles stays as it is, to be refused."""
        low, high = np.asarray(self.robot.joint_range, dtype=np.float64).T
        try:
            angles = np.asarray(joint_pos, dtype=np.float64)
        except (TypeError, ValueError):
            return joint_pos
        if angles.shape != low.shape or not np.isfinite(angles).all():
            return joint_pos
        return angles.clip(low, high)


_LONGEST_WAIT = 60.0  # s: a clock that is off by hours shows here
