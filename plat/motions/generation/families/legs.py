"""Motion families of the whole body over planted feet: squats, bows, lunges, kicks and balance."""

import numpy as np

from plat.motions.generation.families.upper_body import arm
from plat.motions.generation.gait import Gait, take_steps
from plat.motions.generation.script import LEFT, RIGHT, SIDES, MotionScript

__all__ = ["balance", "bow", "kick", "lift_foot", "lower_foot", "lunge", "place_beside", "squat", "weight_shift"]


def squat(script: MotionScript, rng: np.random.Generator) -> None:
    """Write a squat, held for a moment; the arms come forward for balance."""
    for _ in range(rng.integers(1, 3)):
        depth, seconds = rng.uniform(0.08, 0.32), rng.uniform(1.0, 1.7)
        lean = rng.uniform(0.8, 1.8) * depth
        down = {"pelvis_height": -depth, "pelvis_pitch": lean, "waist_pitch": rng.uniform(0.3, 0.9) * depth}
        forward = rng.uniform(1.5, 4.5) * depth
        script.shift({**down, "left_shoulder_pitch": -forward, "right_shoulder_pitch": -forward}, seconds)
        script.wait(seconds + rng.uniform(0.1, 0.8))
        seconds = rng.uniform(1.0, 1.6)
        script.rest(seconds)
        script.wait(seconds + rng.uniform(0.1, 0.4))


def bow(script: MotionScript, rng: np.random.Generator) -> None:
    """Write a bow: the trunk bends forward from hips and waist."""
    seconds = rng.uniform(0.9, 1.6)
    hang = rng.uniform(0.0, 0.5)
    bend = {"pelvis_pitch": rng.uniform(0.15, 0.55), "waist_pitch": rng.uniform(0.15, 0.45)}
    script.shift({**bend, "left_shoulder_pitch": -hang, "right_shoulder_pitch": -hang}, seconds)
    script.wait(seconds + rng.uniform(0.3, 1.0))
    seconds = rng.uniform(0.9, 1.6)
    script.rest(seconds)
    script.wait(seconds)


def weight_shift(script: MotionScript, rng: np.random.Generator) -> None:
    """Write weight shifts from foot to foot, and forward and back."""
    for _ in range(rng.integers(3, 6)):
        seconds = rng.uniform(0.9, 1.5)
        right = rng.uniform(0.05, 0.95)
        script.weigh(script.under(right, rng.uniform(-0.03, 0.04)), seconds)
        script.shift({"pelvis_roll": 0.12 * (right - 0.5), "waist_roll": -0.15 * (right - 0.5)}, seconds)
        script.shift({"pelvis_height": -rng.uniform(0.0, 0.05), "waist_yaw": rng.uniform(-0.2, 0.2)}, seconds)
        script.wait(seconds + rng.uniform(0.1, 0.5))
    seconds = rng.uniform(0.9, 1.3)
    script.weigh(script.under(0.5), seconds)
    script.rest(seconds)
    script.wait(seconds + 0.3)


def lunge(script: MotionScript, rng: np.random.Generator) -> None:
    """Write a lunge: a long step forward or aside, down, up, and back."""
    foot = int(rng.integers(2))
    home = script.feet[foot].copy()
    clearance = rng.uniform(0.04, 0.07)
    if rng.random() < 0.65:
        length, depth = rng.uniform(0.25, 0.42), rng.uniform(0.05, 0.18)
        out = place_beside(script, foot, length, -0.03)
        gait = Gait(step_time=rng.uniform(0.55, 0.75), clearance=clearance, onset=rng.uniform(0.4, 0.5))
        heel = rng.uniform(0.8, 1.2) * length + 1.5 * depth
    else:
        apart = float(np.linalg.norm(script.feet[LEFT, :2] - script.feet[RIGHT, :2]))
        out, depth, heel = place_beside(script, foot, 0.0, rng.uniform(0.26, 0.3) - apart), rng.uniform(0.03, 0.08), 0.0
        # quick, so that the weight stays near the middle: an ankle cannot tilt far sideways
        gait = Gait(step_time=rng.uniform(0.45, 0.55), clearance=clearance, onset=rng.uniform(0.25, 0.35))
    take_steps(script, [(foot, out)], gait)
    seconds = rng.uniform(0.9, 1.4)
    # the heel of the foot that stayed rises once the weight has passed its toes
    script.move({f"{SIDES[1 - foot]}_foot_pitch": heel}, seconds, -0.6 * gait.onset)
    script.shift({"pelvis_height": -depth, "waist_pitch": rng.uniform(0, 0.25)}, seconds)
    script.shift(arm(LEFT, {"shoulder_pitch": -rng.uniform(0, 0.8)}) | arm(RIGHT, {"shoulder_pitch": 0.0}), seconds)
    script.wait(seconds + rng.uniform(0.2, 0.8))
    seconds = rng.uniform(0.9, 1.3)
    script.rest(seconds)
    script.wait(seconds)
    take_steps(script, [(foot, home)], gait)


def balance(script: MotionScript, rng: np.random.Generator) -> None:
    """Write balancing on one leg, the other foot lifted a little or high, arms out."""
    foot = int(rng.integers(2))
    seconds = rng.uniform(0.9, 1.3)
    _onto(script, 1 - foot, seconds)
    out = rng.uniform(0.2, 1.0)
    script.shift(arm(LEFT, {"shoulder_roll": out}) | arm(RIGHT, {"shoulder_roll": out}), seconds)
    script.wait(0.8 * seconds)
    seconds = rng.uniform(0.8, 1.2)
    lift_foot(
        script, foot, seconds, up=rng.uniform(0.06, 0.25), forward=rng.uniform(-0.15, 0.15), inward=rng.uniform(0, 0.04)
    )
    script.wait(seconds + rng.uniform(0.8, 3.0))
    lower_foot(script, foot, rng)


def kick(script: MotionScript, rng: np.random.Generator) -> None:
    """Write one or two kicks to the front, the back or the side."""
    foot = int(rng.integers(2))
    seconds = rng.uniform(0.9, 1.2)
    _onto(script, 1 - foot, seconds)
    script.shift(arm(LEFT, {"shoulder_roll": 0.3}) | arm(RIGHT, {"shoulder_roll": 0.3}), seconds)
    script.wait(0.8 * seconds)
    way = rng.choice(("front", "front", "side", "back"))
    for _ in range(rng.integers(1, 3)):
        chamber = rng.uniform(0.5, 0.7)
        lift_foot(script, foot, chamber, up=rng.uniform(0.1, 0.16))
        script.wait(chamber)
        out = rng.uniform(0.45, 0.65)
        if way == "front":
            lift_foot(script, foot, out, up=rng.uniform(0.15, 0.42), forward=rng.uniform(0.25, 0.45))
            script.shift({"waist_pitch": -0.1}, out)
        elif way == "back":
            lift_foot(script, foot, out, up=rng.uniform(0.12, 0.25), forward=-rng.uniform(0.2, 0.35))
            script.shift({"waist_pitch": 0.15}, out)
        else:
            lift_foot(script, foot, out, up=rng.uniform(0.12, 0.22), inward=-rng.uniform(0.15, 0.3))
        script.wait(out + rng.uniform(0.0, 0.15))
        lift_foot(script, foot, 0.6, up=0.1)
        script.shift({"waist_pitch": 0.0}, 0.6)
        script.wait(0.6)
    lower_foot(script, foot, rng)


def place_beside(script: MotionScript, foot: int, forward: float, outward: float) -> np.ndarray:
    """Return a place ``[3]`` relative to a foot's position."""
    x, y, yaw = script.feet[foot]
    heading, sideways = script.feet[:, 2].mean(), outward * (1 if foot == LEFT else -1)
    cosine, sine = np.cos(heading), np.sin(heading)
    return np.array([x + cosine * forward - sine * sideways, y + sine * forward + cosine * sideways, yaw])


def _onto(script: MotionScript, standing: int, seconds: float) -> None:
    """Write a weight shift onto one foot."""
    script.weigh(script.under(float(standing)), seconds)


def lift_foot(
    script: MotionScript, foot: int, seconds: float, up: float, forward: float = 0.0, inward: float = 0.0
) -> None:
    side, sign = SIDES[foot], (-1 if foot == LEFT else 1)
    # the sole leaves the floor before it goes anywhere
    script.move({f"{side}_foot_up": up}, seconds)
    script.move(
        {f"{side}_foot_forward": forward, f"{side}_foot_sideways": sign * inward}, 0.85 * seconds, 0.15 * seconds
    )


def lower_foot(script: MotionScript, foot: int, rng: np.random.Generator) -> None:
    side, seconds = SIDES[foot], rng.uniform(0.8, 1.1)
    script.move({f"{side}_foot_forward": 0.0, f"{side}_foot_sideways": 0.0}, 0.85 * seconds)
    script.move({f"{side}_foot_up": 0.0}, seconds)
    script.wait(seconds)
    seconds = rng.uniform(0.7, 1.0)
    script.weigh(script.under(0.5), seconds)
    script.rest(seconds)
    script.wait(seconds + 0.3)
