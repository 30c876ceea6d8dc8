"""Motion families of walking and turning."""

from collections.abc import Iterator

import numpy as np

from plat.motions.generation.gait import Gait, take_steps
from plat.motions.generation.script import LEFT, RIGHT, MotionScript

__all__ = ["crouch_walk", "step_in_place", "turn", "walk", "walk_backward", "walk_sideways"]


def walk(script: MotionScript, rng: np.random.Generator) -> None:
    """Write walking forward at 0.2 to 1.0 m/s, straight or in a curve, with swinging arms."""
    speed = rng.uniform(0.2, 1.0)
    step_time = rng.uniform(0.62, 0.72) - 0.25 * speed
    curve = rng.uniform(-0.6, 0.6) * step_time if rng.random() < 0.5 else 0.0
    gait = Gait(
        step_time=step_time,
        double_support=rng.uniform(0.2, 0.27),
        clearance=rng.uniform(0.04, 0.07),
        roll=0.05 * speed,
        heel_off=rng.uniform(0.3, 0.5) * speed,
        toes_up=rng.uniform(0.1, 0.25) * speed,
    )
    _go(script, rng, gait, count=int(rng.integers(5, 11)), ahead=speed * step_time, turn=curve)


def walk_backward(script: MotionScript, rng: np.random.Generator) -> None:
    """Write walking backward at 0.2 to 0.5 m/s."""
    speed, step_time = rng.uniform(0.2, 0.5), rng.uniform(0.55, 0.7)
    gait = Gait(step_time=step_time, clearance=rng.uniform(0.04, 0.06))
    _go(script, rng, gait, count=int(rng.integers(4, 9)), ahead=-speed * step_time, turn=0.0)


def crouch_walk(script: MotionScript, rng: np.random.Generator) -> None:
    """Write walking forward with bent knees and a leaning trunk."""
    depth, seconds = rng.uniform(0.05, 0.12), rng.uniform(0.9, 1.3)
    lean = {"pelvis_pitch": rng.uniform(0.5, 1.5) * depth, "waist_pitch": rng.uniform(0.0, 1.5) * depth}
    script.shift({"pelvis_height": -depth, **lean}, seconds)
    script.wait(seconds)
    speed, step_time = rng.uniform(0.2, 0.6), rng.uniform(0.55, 0.7)
    gait = Gait(step_time=step_time, clearance=rng.uniform(0.04, 0.06), roll=0.05 * speed, heel_off=0.4 * speed)
    _go(script, rng, gait, count=int(rng.integers(4, 9)), ahead=speed * step_time, turn=0.0)
    script.rest(seconds)
    script.wait(seconds)


def walk_sideways(script: MotionScript, rng: np.random.Generator) -> None:
    """Write side steps at 0.1 to 0.25 m/s; the range of the ankle roll limits the speed."""
    lead, width = int(rng.integers(2)), rng.uniform(0.1, 0.18)
    aside = width if lead == LEFT else -width
    gait = Gait(step_time=rng.uniform(0.36, 0.5), clearance=rng.uniform(0.04, 0.06))
    _go(script, rng, gait, count=2 * int(rng.integers(2, 5)), first=lead, aside=aside)


def turn(script: MotionScript, rng: np.random.Generator) -> None:
    """Write a turn on the spot, step by step, by 0.6 to 1.6 rad."""
    way = rng.choice((-1.0, 1.0))
    gait = Gait(step_time=rng.uniform(0.5, 0.65), clearance=rng.uniform(0.04, 0.06))
    # the inner foot begins
    _go(
        script,
        rng,
        gait,
        count=2 * int(rng.integers(2, 4)),
        first=LEFT if way > 0 else RIGHT,
        turn=way * rng.uniform(0.3, 0.55),
    )


def step_in_place(script: MotionScript, rng: np.random.Generator) -> None:
    """Write stepping from foot to foot on the spot."""
    gait = Gait(step_time=rng.uniform(0.5, 0.8), clearance=rng.uniform(0.03, 0.09))
    _go(script, rng, gait, count=2 * int(rng.integers(2, 5)))


def _go(
    script: MotionScript,
    rng: np.random.Generator,
    gait: Gait,
    *,
    count: int,
    first: int | None = None,
    ahead: float = 0.0,
    aside: float = 0.0,
    turn: float = 0.0,
) -> None:
    """Write steps of equal length from the present stance; ``ahead``, ``aside`` (m) and ``turn`` (rad) are per step.

    Going aside or on the spot, the second foot of each pair closes up; going ahead, feet pass each other, with half
    a step to set off and half a one to come to rest.
    """
    begin = script.now
    first = int(rng.integers(2)) if first is None else first
    take_steps(script, list(_places(script.feet, count, first, ahead, aside, turn)), gait)
    if ahead:
        script.swing_arms(rng.uniform(0.5, 1.1), begin)


def _places(
    feet: np.ndarray, count: int, first: int, ahead: float, aside: float, turn: float
) -> Iterator[tuple[int, np.ndarray]]:
    middle, yaw = feet[:, :2].mean(0), feet[:, 2].mean()
    offset = (feet[:, :2] - middle) @ np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    splay = feet[:, 2] - yaw
    for number in range(count + (1 if ahead else 0)):
        foot = (first + number) % 2
        leads = ahead != 0.0 or number % 2 == 0
        share = 0.5 if ahead and number in (0, count - 1) else 1.0
        if leads and number < count:
            yaw += turn
            cosine, sine = np.cos(yaw), np.sin(yaw)
            middle = middle + share * np.array([cosine * ahead - sine * aside, sine * ahead + cosine * aside])
        cosine, sine = np.cos(yaw), np.sin(yaw)
        x, y = middle + np.array([[cosine, -sine], [sine, cosine]]) @ offset[foot]
        yield foot, np.array([x, y, yaw + splay[foot]])
