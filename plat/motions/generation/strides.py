"""Strides: footsteps, flights and weight from the velocity that the body is to have."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from plat.motions.generation.script import LEFT, SIDES, SOLE_CENTER, MotionScript

__all__ = ["Course", "Strides", "take_strides"]

_GRAVITY, _COM_HEIGHT = 9.81, 0.67  # m/s^2, m
_TICK = 0.01  # s
_SHORTEST_FLIGHT = 0.03  # s
_FIRST_SWING = 0.7  # of a step's time


@dataclass(frozen=True)
class Course:
    """Velocity over time: functions of the seconds ``[n]`` since the first foot leaves the floor."""

    ahead: Callable[[np.ndarray], np.ndarray]
    """speed along the heading ``[n]`` (m/s)"""
    aside: Callable[[np.ndarray], np.ndarray] = np.zeros_like
    """speed to the left of the heading ``[n]`` (m/s)"""
    turning: Callable[[np.ndarray], np.ndarray] = np.zeros_like
    """how fast the heading turns to the left ``[n]`` (rad/s)"""


@dataclass(frozen=True)
class Strides:
    """Parameters of strides."""

    step_time: float
    """seconds from landing to landing"""
    flight: float = 0.0
    """seconds in the air per step, at full speed; negative: with both feet on the floor"""
    full_speed: float = 1.0
    """speed from which on ``flight`` is full; standing, both feet are down for a quarter of ``step_time`` (m/s)"""
    clearance: tuple[float, float] = (0.05, 0.0)
    """height of the swinging sole: at rest (m), and more per m/s"""
    heel_off: float = 0.0
    """pitch of the foot when it leaves the floor, per m/s (rad)"""
    crouch: float = 0.02
    """how far the center of mass is lowered (m)"""
    sink: float = 0.0
    """how much lower it is where the body slows down, per m/s^2 (m)"""
    width: float = 0.0
    """how much further apart than at rest the feet go (m)"""
    onset: float = 0.5
    """duration of the first weight shift and of the last (s)"""
    roll: float = 0.0
    """how far the weight rolls forward under a foot, per m/s up to 1 m/s (m)"""


class _Path:
    """Course in the world, sampled: places, headings and accelerations."""

    def __init__(self, course: Course, seconds: float, place: np.ndarray, yaw: float):
        self._time = np.arange(round(seconds / _TICK) + 2) * _TICK
        ahead, aside = course.ahead(self._time), course.aside(self._time)
        self._yaw = yaw + np.cumsum(course.turning(self._time)) * _TICK
        cosine, sine = np.cos(self._yaw), np.sin(self._yaw)
        velocity = np.stack((cosine * ahead - sine * aside, sine * ahead + cosine * aside), -1)
        self._place = place + np.cumsum(velocity, 0) * _TICK
        self._acceleration = np.gradient(velocity, _TICK, axis=0)
        self._speed, self._ahead = np.hypot(ahead, aside), ahead

    def _mean(self, values: np.ndarray, time: float, width: float) -> np.ndarray:
        inside = np.abs(self._time - np.clip(time, 0, self._time[-1])) <= width / 2
        return values[inside].mean(0)

    def speed(self, time: float, width: float) -> float:
        return float(self._mean(self._speed, time, width))

    def ahead(self, time: float, width: float) -> float:
        return float(self._mean(self._ahead, time, width))

    def slowing(self, time: float, width: float) -> float:
        """Return how fast the speed falls (m/s^2), 0 where it does not."""
        return max(0.0, (self.speed(time - width, width) - self.speed(time + width, width)) / (2 * width))

    def end(self) -> tuple[np.ndarray, float]:
        """Return place ``[2]`` and heading at the end."""
        return self._place[-1], float(self._yaw[-1])

    def support(self, time: float, width: float) -> tuple[np.ndarray, float]:
        """Return where the pendulum is to be supported at a time ``[2]`` (m), and the heading there (rad)."""
        lead = self._mean(self._acceleration, time, width) * _COM_HEIGHT / _GRAVITY
        return self._mean(self._place, time, 2.5 * _TICK) - lead, float(self._mean(self._yaw, time, 2.5 * _TICK))


@dataclass(frozen=True)
class _Landing:
    foot: int
    place: np.ndarray
    land: float
    lift: float
    """when the foot leaves the floor again"""
    ahead: float
    low: float
    """height of the center of mass when the foot lands (m)"""


def take_strides(script: MotionScript, course: Course, strides: Strides, count: int, first: int) -> None:
    """Write strides along a course, from standing to standing; time advances to their end.

    A foot lands where the pendulum over it gives the body the acceleration of the course. Where feet are down for less
    than a step, the body flies in between. The last two feet come to stand side by side.

    Args:
        script: script to write to.
        course: where to go; it has to be at rest before ``(count - 0.3) * step_time``.
        strides: parameters.
        count: number of landings, 2 at least.
        first: the foot (0 left, 1 right) that goes first; the other one bears the weight before.
    """
    period, begin = strides.step_time, script.now + strides.onset
    path = _Path(course, (count + 1) * period, script.feet[:, :2].mean(0), float(script.feet[:, 2].mean()))
    land = begin + period * (np.arange(count + 2) - 1 + _FIRST_SWING)
    gaps = [_gap(strides, path.speed(time - begin - period / 2, period)) for time in land[1:]]
    landings = _landings(script, path, strides, land, gaps, first, begin)
    for number, landing in enumerate(landings[1:], 1):
        leave = begin if number == 1 else landings[number - 2].lift
        speed = path.speed(landing.land - period - begin, period)
        _swing(script, strides, landing, leave, speed, rolled=number > 1)
    _write_weight(script, strides, landings)
    _write_height(script, strides, begin, landings, gaps)
    script.now = float(land[count]) + period + strides.onset
    script.rise(0.0)


def _gap(strides: Strides, speed: float) -> float:
    """Return the seconds from lift-off to the next landing at a speed; negative: both feet are on the floor."""
    share = min(1.0, speed / strides.full_speed)
    gap = -0.25 * strides.step_time * (1 - share) + strides.flight * share
    return gap if gap > _SHORTEST_FLIGHT else min(gap, 0.0)


def _landings(
    script: MotionScript,
    path: _Path,
    strides: Strides,
    land: np.ndarray,
    gaps: list[float],
    first: int,
    begin: float,
) -> list[_Landing]:
    """Return all landings; the first is of the foot that stands at the beginning."""
    count, heading = len(land) - 2, script.feet[:, 2].mean()
    half = (script.feet[LEFT, :2] - script.feet[1 - LEFT, :2]) @ np.array([-np.sin(heading), np.cos(heading)]) / 2
    splay = script.feet[:, 2] - heading
    landings = []
    for number in range(count + 1):
        foot = (first + number + 1) % 2
        middle = (land[number] + land[number + 1] - gaps[number]) / 2 - begin
        apart = half
        if number >= count - 1:
            base, yaw = path.end()
        else:
            base, yaw = path.support(middle, strides.step_time)
            apart = half + strides.width / 2
        normal = np.array([-np.sin(yaw), np.cos(yaw)]) * (1 if foot == LEFT else -1)
        place = np.array([*(base + apart * normal), yaw + splay[foot]]) if number else script.feet[foot].copy()
        lift = land[number + 1] - gaps[number]
        ahead = path.ahead(middle, strides.step_time)
        low = -strides.crouch - strides.sink * path.slowing(land[number] - begin, strides.step_time)
        landings.append(_Landing(foot, place, float(land[number]), float(lift), ahead, low))
    return landings


def _swing(script: MotionScript, strides: Strides, landing: _Landing, leave: float, speed: float, rolled: bool) -> None:
    seconds, pitch = landing.land - leave, strides.heel_off * speed if rolled else 0.0
    clearance = strides.clearance[0] + strides.clearance[1] * speed
    script.step(landing.foot, landing.place, seconds, clearance, leave - script.now, snatched=True)
    if pitch > 0:
        channel, rising = f"{SIDES[landing.foot]}_foot_pitch", 0.28 * strides.step_time
        script.move({channel: pitch}, 1.6 * rising, leave - rising - script.now)
        script.move({channel: 0.0}, 0.55 * seconds, leave + 0.4 * seconds - script.now)


def _write_weight(script: MotionScript, strides: Strides, landings: list[_Landing]) -> None:
    """Write the zero-moment point: under the foot that stands alone, from behind its middle to before it."""
    arrived = script.now
    for number, landing in enumerate(landings):
        alone = max(landing.land, landings[number - 1].lift) if number else script.now + strides.onset
        roll = strides.roll * float(np.clip(landing.ahead, -1, 1))
        script.weigh(_sole(landing.place, -roll if number else 0.0), alone - arrived, arrived - script.now)
        if number == len(landings) - 1:
            script.weigh(script.under(0.5), strides.onset, alone - script.now)
            break
        leaves = min(landing.lift, landings[number + 1].land)
        script.weigh(_sole(landing.place, roll), leaves - alone, alone - script.now)
        arrived = leaves


def _write_height(
    script: MotionScript, strides: Strides, begin: float, landings: list[_Landing], gaps: list[float]
) -> None:
    """Write the height of the center of mass: parabolas in flight, low between them."""
    script.rise(0.0)
    script.rise(-strides.crouch, delay=begin - script.now)
    for number in range(1, len(landings)):
        flight = gaps[number - 1]
        time = landings[number].land - script.now
        if flight > 0:
            speed = _GRAVITY * flight / 2
            script.rise(landings[number].low, speed, -_GRAVITY, time - flight)
            script.rise(landings[number].low, -speed, -_GRAVITY, time)
        else:
            script.rise(landings[number].low, delay=time)


def _sole(place: np.ndarray, forward: float) -> np.ndarray:
    return place[:2] + (SOLE_CENTER + forward) * np.array([np.cos(place[2]), np.sin(place[2])])
