"""Motion families on quick feet: running, sharp turns, sudden stops, quick side steps, and stumbles that are caught."""

from collections.abc import Callable

import numpy as np

from plat.motions.generation.families.upper_body import arm
from plat.motions.generation.interpolation import minimum_jerk
from plat.motions.generation.script import LEFT, RIGHT, MotionScript
from plat.motions.generation.strides import Course, Strides, take_strides

__all__ = ["cut", "halt", "run", "shuffle", "stumble"]


def run(script: MotionScript, rng: np.random.Generator) -> None:
    """Write running at 1.2 to 3 m/s, straight or in a wide curve, from standing and back to it."""
    speed = rng.uniform(1.2, 3.0)
    pace = _running(rng, speed)
    gain, brake, steady = (
        int(n) for n in (rng.integers(3, 5) + 1.5 * speed, rng.integers(3, 5) + 1.5 * speed, rng.integers(2, 7))
    )
    period = pace.step_time
    ahead = _plateau(speed, 0.0, gain * period, (gain + steady) * period, brake * period)
    curve = rng.uniform(-0.5, 0.5) if rng.random() < 0.5 else 0.0
    turning = _plateau(curve, 0.5 * gain * period, gain * period, (gain + steady) * period, period)
    _on_the_run(script, rng, Course(ahead, turning=turning), pace, gain + steady + brake + 2, speed)


def cut(script: MotionScript, rng: np.random.Generator) -> None:
    """Write a sharp turn by 0.7 to 2.4 rad while walking fast or running: slower into it, fast out of it."""
    speed = rng.uniform(0.6, 2.0)
    pace = _running(rng, speed)
    period, gain, steady = pace.step_time, int(rng.integers(3, 6)), int(rng.integers(2, 5))
    angle = rng.choice((-1, 1)) * rng.uniform(0.7, 2.4)
    steps = 2 + abs(angle) * (0.6 + 0.4 * speed)
    slow = rng.uniform(0.35, 0.7)
    into = (gain + steady) * period
    through = steps * period
    first = _plateau(speed, 0.0, gain * period, into - period, 2 * period)
    second = _plateau(slow * speed, into - period, 2 * period, into + through, 2 * period)
    third = _plateau(
        rng.uniform(0.7, 1.0) * speed, into + through, 2 * period, into + through + (2 + steady) * period, 0
    )
    away = into + through + (2 + steady) * period
    brake = int(rng.integers(4, 6) + speed) * period
    turning = _plateau(1.0, into, 0.5 * through, into + 0.5 * through, 0.5 * through)
    scale = angle / (0.5 * through)

    def ahead(time: np.ndarray) -> np.ndarray:
        tail = third(np.minimum(time, away - 1e-9))
        return first(time) + second(time) + tail * (1 - minimum_jerk((time - away) / brake))

    course = Course(ahead, turning=lambda time: scale * turning(time))
    _on_the_run(script, rng, course, pace, int(np.ceil((away + brake) / period)) + 2, speed)


def halt(script: MotionScript, rng: np.random.Generator) -> None:
    """Write a sudden stop from 0.7 to 2 m/s, within 1.5 to 3 steps: faster ones take longer."""
    speed = rng.uniform(0.7, 2.0)
    pace = _running(rng, speed)
    period = pace.step_time
    gain, steady = int(rng.integers(3, 5) + 1.5 * speed), int(rng.integers(2, 6))
    brake = rng.uniform(0.9, 1.4) + 0.8 * speed
    ahead = _plateau(speed, 0.0, gain * period, (gain + steady) * period, brake * period)
    _on_the_run(script, rng, Course(ahead), pace, int(np.ceil(gain + steady + brake)) + 1, speed)


def shuffle(script: MotionScript, rng: np.random.Generator) -> None:
    """Write quick side steps to one side and back, or only there, at 0.15 to 0.45 m/s."""
    speed, period = rng.choice((-1, 1)) * rng.uniform(0.15, 0.45), rng.uniform(0.28, 0.4)
    flight = rng.choice((0.0, rng.uniform(0.04, 0.08)))
    strides = Strides(
        step_time=period,
        flight=flight,
        full_speed=0.3,
        clearance=(rng.uniform(0.03, 0.06), 0.03),
        crouch=rng.uniform(0.03, 0.07),
        width=0.5 * abs(speed) * period + rng.uniform(-0.02, 0.02),
        onset=0.4,
    )
    steps = [2 * int(rng.integers(2, 5)) for _ in range(rng.integers(1, 3))]
    _guard(script, rng, 0.5)
    for number, count in enumerate(steps):
        way = speed if number == 0 else -speed
        aside = _plateau(way, 0.0, 2 * period, count * period, 2 * period)
        first = LEFT if way > 0 else RIGHT
        take_strides(script, Course(np.zeros_like, aside), strides, count + 3, first)
    _settle(script)


def stumble(script: MotionScript, rng: np.random.Generator) -> None:
    """Write a stumble that is caught: the body falls some way, and four to six quick steps get under it."""
    speed, period = rng.uniform(0.4, 1.0), rng.uniform(0.26, 0.36)
    way = rng.choice((0.0, 0.0, np.pi, 0.5 * np.pi, -0.5 * np.pi)) + rng.uniform(-0.4, 0.4)
    reach = np.array([1.0, 0.6])  # aside feet cannot go as far
    fast = speed * reach * np.array([np.cos(way), np.sin(way)])
    fast[0] *= 1.0 if fast[0] > 0 else 0.7
    count = int(rng.integers(4, 7))
    fall, catch = rng.uniform(0.8, 1.4) * period, (count - 2.2) * period
    strides = Strides(
        step_time=period,
        flight=rng.uniform(-0.05, 0.05),
        full_speed=0.8,
        clearance=(rng.uniform(0.03, 0.06), 0.05),
        heel_off=0.25 if fast[0] > 0.2 else 0.0,
        crouch=rng.uniform(0.02, 0.08),
        width=rng.uniform(0.02, 0.1) + 1.2 * abs(fast[1]) * period,
        onset=rng.uniform(0.25, 0.4),
        roll=0.03,
    )
    script.wait(rng.uniform(0.2, 1.0))
    seconds = strides.onset + fall
    flung = {
        channel: angle
        for side in (LEFT, RIGHT)
        for channel, angle in arm(
            side,
            {
                "shoulder_pitch": rng.uniform(-1.4, 0.3),
                "shoulder_roll": rng.uniform(0.4, 1.3),
                "elbow": rng.uniform(-0.2, 0.8),
            },
        ).items()
    }
    lean = {"pelvis_pitch": 0.25 * fast[0], "waist_pitch": rng.uniform(0.1, 0.35) * fast[0]}
    tilt = {"pelvis_roll": -0.15 * fast[1], "waist_roll": -0.3 * fast[1], "waist_yaw": rng.uniform(-0.3, 0.3)}
    script.move(flung, seconds, rng.uniform(0.0, 0.15))
    script.shift({**lean, **tilt}, seconds)
    profile = _plateau(1.0, 0.0, fall, fall, catch)
    course = Course(lambda time: fast[0] * profile(time), lambda time: fast[1] * profile(time))
    first = int(rng.integers(2)) if abs(fast[1]) < 0.1 else (LEFT if fast[1] > 0 else RIGHT)
    began = script.now
    take_strides(script, course, strides, count, first)
    settle = 0.6 * (script.now - began)
    script.rest(settle, -settle + 0.3)
    script.wait(0.4)


def _plateau(value: float, begin: float, gain: float, until: float, brake: float) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function of time (s) that goes from 0 to a value in ``gain`` seconds, and back after ``until``."""

    def profile(time: np.ndarray) -> np.ndarray:
        up = minimum_jerk((time - begin) / gain)
        return value * (up - minimum_jerk((time - until) / brake)) if brake > 0 else value * up

    return profile


def _running(rng: np.random.Generator, speed: float) -> Strides:
    step_time = rng.uniform(0.47, 0.52) - 0.085 * speed
    return Strides(
        step_time=step_time,
        flight=float(np.clip(0.05 * speed - 0.02, -0.1, 0.13)) + rng.uniform(-0.01, 0.01),
        full_speed=speed,
        clearance=(0.05, rng.uniform(0.03, 0.06)),
        heel_off=rng.uniform(0.3, 0.4),
        crouch=0.01 + 0.018 * speed + 0.02 * max(0.0, speed - 2),
        sink=0.02,
        width=-0.01 * min(speed, 2.0),
        onset=rng.uniform(0.4, 0.5),
        roll=0.065,
    )


def _guard(script: MotionScript, rng: np.random.Generator, seconds: float) -> None:
    pose = {"elbow": rng.uniform(-0.4, 0.5), "shoulder_pitch": rng.uniform(-0.4, 0.1), "shoulder_roll": 0.25}
    script.shift({"waist_pitch": rng.uniform(0.0, 0.15)}, seconds)
    script.move(arm(LEFT, pose) | arm(RIGHT, pose), seconds)


def _on_the_run(
    script: MotionScript, rng: np.random.Generator, course: Course, strides: Strides, count: int, speed: float
) -> None:
    """Write strides with bent, swinging arms and a trunk that leans forward."""
    bent = {"elbow": rng.uniform(-0.1, 0.3), "shoulder_pitch": rng.uniform(0.1, 0.3)}
    script.shift({"pelvis_pitch": 0.03 * speed, "waist_pitch": rng.uniform(0.02, 0.05) * speed}, 0.9)
    script.move(arm(LEFT, bent) | arm(RIGHT, bent), 0.9)
    begin = script.now
    take_strides(script, course, strides, count, int(rng.integers(2)))
    script.swing_arms(rng.uniform(0.5, 0.8) / max(1.0, 0.6 * speed), begin)
    _settle(script)


def _settle(script: MotionScript) -> None:
    script.rest(0.8, -0.3)
    script.wait(0.5)
