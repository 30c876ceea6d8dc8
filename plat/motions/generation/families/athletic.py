"""Motion families that ask for strength and room: jumps, high kicks, deep squats, low work, arms anywhere."""

import mujoco
import numpy as np

from plat.motions.checks.collision import self_penetration
from plat.motions.generation.families.legs import lift_foot, lower_foot, place_beside
from plat.motions.generation.families.upper_body import arm
from plat.motions.generation.gait import Gait, take_steps
from plat.motions.generation.script import LEFT, RIGHT, SIDES, MotionScript
from plat.robots import G1

__all__ = ["arms", "fetch", "high_kick", "hop", "jump", "low_work", "squat_deep"]

_GRAVITY = 9.81

# Angles of the left arm (rad): nearly all that the joints can do, but not behind the back.
_WHOLE = {
    "shoulder_pitch": (-3.0, 1.0),
    "shoulder_roll": (-0.3, 2.2),
    "shoulder_yaw": (-1.6, 1.6),
    "elbow": (-1.0, 2.0),
    "wrist_roll": (-1.8, 1.8),
    "wrist_pitch": (-1.2, 1.2),
    "wrist_yaw": (-1.2, 1.2),
}
_LOW = {**_WHOLE, "shoulder_pitch": (-1.4, 0.2), "shoulder_roll": (0.0, 0.9), "shoulder_yaw": (-0.8, 0.8)}
_CLEARANCE_STEPS = 6  # poses on the way that are looked at for collisions
_TRIES = 50
_FASTEST_ARM = 2.5  # rad/s, mean over a move


def jump(script: MotionScript, rng: np.random.Generator) -> None:
    """Write one to three jumps with both feet: up, forward, back, aside or with a turn, 3 to 20 cm high."""
    for number in range(rng.integers(1, 4)):
        way = rng.choice(("up", "forward", "aside", "turn", "back"))
        ahead = {"forward": rng.uniform(0.1, 0.5), "back": -rng.uniform(0.05, 0.2)}.get(str(way), 0.0)
        aside = rng.choice((-1, 1)) * rng.uniform(0.05, 0.25) if way == "aside" else 0.0
        turn = rng.choice((-1, 1)) * rng.uniform(0.3, 1.2) if way == "turn" else 0.0
        if number:
            script.wait(rng.uniform(0.1, 0.5))
        _leap(script, rng, rng.uniform(0.03, 0.2), ahead, aside, turn)


def hop(script: MotionScript, rng: np.random.Generator) -> None:
    """Write a series of small quick jumps with both feet, on the spot or traveling."""
    height, count = rng.uniform(0.015, 0.05), int(rng.integers(3, 8))
    flight, ground = np.sqrt(8 * height / _GRAVITY), rng.uniform(0.22, 0.35)
    ahead, aside, turn = rng.uniform(-0.05, 0.1), rng.uniform(-0.06, 0.06), rng.uniform(-0.2, 0.2)
    crouch, speed = rng.uniform(0.01, 0.03), _GRAVITY * flight / 2
    _brace(script, rng, 0.5)
    script.rise(0.0)
    script.wait(0.5)
    script.rise(-crouch - 0.02)
    script.wait(0.3)
    for _ in range(count):
        _fly(script, flight, speed, crouch, _moved(script, ahead, aside, turn), tuck=rng.uniform(0.0, 0.02))
        script.wait(ground)
    script.rise(-crouch)
    script.wait(0.2)
    _stand_up(script, 0.7)


def high_kick(script: MotionScript, rng: np.random.Generator) -> None:
    """Write one to three fast, high kicks to the front, the side or the back, or with the knee."""
    foot = int(rng.integers(2))
    seconds = rng.uniform(0.8, 1.1)
    script.weigh(script.under(float(1 - foot)), seconds)
    _brace(script, rng, seconds)
    script.wait(seconds)
    way = rng.choice(("front", "front", "knee", "side", "back"))
    for _ in range(rng.integers(1, 4)):
        chamber = rng.uniform(0.5, 0.65)
        lift_foot(script, foot, chamber, up=rng.uniform(0.1, 0.2))
        script.wait(chamber)
        out = rng.uniform(0.38, 0.6)
        if way == "front":
            lift_foot(script, foot, out, up=rng.uniform(0.3, 0.52), forward=rng.uniform(0.3, 0.45))
            script.shift({"waist_pitch": -rng.uniform(0.0, 0.2), "pelvis_pitch": -rng.uniform(0.0, 0.25)}, out)
        elif way == "knee":
            lift_foot(script, foot, out, up=rng.uniform(0.3, 0.45), forward=rng.uniform(0.0, 0.12))
        elif way == "back":
            lift_foot(script, foot, out, up=rng.uniform(0.2, 0.35), forward=-rng.uniform(0.25, 0.4))
            script.shift({"waist_pitch": 0.2, "pelvis_pitch": rng.uniform(0.1, 0.3)}, out)
        else:
            lift_foot(script, foot, out, up=rng.uniform(0.2, 0.4), inward=-rng.uniform(0.2, 0.4))
            script.shift({"waist_roll": (1 if foot == RIGHT else -1) * -rng.uniform(0.0, 0.2)}, out)
        script.wait(out + rng.uniform(0.0, 0.1))
        lift_foot(script, foot, 0.5, up=0.12)
        script.shift({"waist_pitch": 0.0, "pelvis_pitch": 0.0, "waist_roll": 0.0}, 0.5)
        script.wait(0.5)
    lower_foot(script, foot, rng)


def squat_deep(script: MotionScript, rng: np.random.Generator) -> None:
    """Write one to three quick or deep squats, arms to the front, to the head or down."""
    for _ in range(rng.integers(1, 4)):
        depth, seconds = rng.uniform(0.2, 0.36), rng.uniform(0.55, 1.3)
        lean = rng.uniform(0.9, 2.0) * depth
        script.shift(
            {"pelvis_height": -depth, "pelvis_pitch": lean, "waist_pitch": rng.uniform(0.2, 1.0) * depth}, seconds
        )
        pitch, elbow = rng.uniform(-1.6, 0.1), rng.uniform(-0.3, 1.0)
        for side in (LEFT, RIGHT):
            script.move(arm(side, {"shoulder_pitch": pitch, "elbow": elbow}), seconds)
        script.wait(seconds + rng.uniform(0.0, 0.8))
        seconds = rng.uniform(0.6, 1.2)
        script.rest(seconds)
        script.wait(seconds + rng.uniform(0.05, 0.3))


def low_work(script: MotionScript, rng: np.random.Generator) -> None:
    """Write work near the floor: low on both legs, the trunk bent, hands from place to place."""
    depth, seconds = rng.uniform(0.12, 0.34), rng.uniform(1.0, 1.6)
    script.shift(
        {
            "pelvis_height": -depth,
            "pelvis_pitch": rng.uniform(0.3, 0.7),
            "waist_pitch": rng.uniform(0.1, 0.45),
        },
        seconds,
    )
    held = _free_arms(script, rng, _LOW, None, seconds)
    script.wait(seconds)
    for _ in range(rng.integers(2, 6)):
        seconds = rng.uniform(0.7, 1.4)
        script.weigh(script.under(rng.uniform(0.25, 0.75), rng.uniform(-0.01, 0.03)), seconds)
        script.shift(
            {
                "pelvis_height": -np.clip(depth + rng.uniform(-0.08, 0.08), 0.08, 0.36),
                "waist_yaw": rng.uniform(-0.6, 0.6),
                "waist_roll": rng.uniform(-0.2, 0.2),
                "pelvis_yaw": rng.uniform(-0.15, 0.15),
            },
            seconds,
        )
        held = _free_arms(script, rng, _LOW, held, seconds)
        script.wait(seconds + rng.uniform(0.0, 0.5))
    _home(script, rng.uniform(1.0, 1.6))


def arms(script: MotionScript, rng: np.random.Generator) -> None:
    """Write arms that go anywhere in their range, slow and fast, while standing."""
    held = None
    for _ in range(rng.integers(4, 9)):
        seconds = rng.uniform(0.6, 1.6)
        held = _free_arms(script, rng, _WHOLE, held, seconds)
        if rng.random() < 0.5:
            script.move({"waist_yaw": rng.uniform(-0.5, 0.5), "waist_roll": rng.uniform(-0.15, 0.15)}, seconds)
        script.wait(seconds + rng.uniform(0.0, 0.5))
    _home(script, rng.uniform(1.0, 1.5))


def fetch(script: MotionScript, rng: np.random.Generator) -> None:
    """Write a step ahead or aside, a far reach high or low from there, and the step back."""
    foot = int(rng.integers(2))
    home = script.feet[foot].copy()
    ahead = rng.random() < 0.7
    out = (
        place_beside(script, foot, rng.uniform(0.15, 0.35), 0.0)
        if ahead
        else place_beside(script, foot, 0.0, rng.uniform(0.05, 0.11))
    )
    gait = Gait(step_time=rng.uniform(0.5, 0.7), clearance=rng.uniform(0.04, 0.07), onset=rng.uniform(0.35, 0.5))
    take_steps(script, [(foot, out)], gait)
    held = None
    for _ in range(rng.integers(1, 4)):
        seconds = rng.uniform(0.8, 1.5)
        low = rng.random() < 0.5
        lean = {"pelvis_pitch": rng.uniform(0.1, 0.45), "waist_pitch": rng.uniform(0.0, 0.4)} if low else {}
        script.shift(
            {
                "pelvis_height": -rng.uniform(0.05, 0.2) if low else -rng.uniform(0.0, 0.03),
                "pelvis_pitch": 0.0,
                "waist_pitch": rng.uniform(-0.1, 0.1),
                "waist_yaw": rng.uniform(-0.7, 0.7),
                **lean,
            },
            seconds,
        )
        held = _free_arms(script, rng, _LOW if low else _WHOLE, held, seconds)
        script.wait(seconds + rng.uniform(0.0, 0.5))
    _home(script, rng.uniform(0.9, 1.4))
    take_steps(script, [(foot, home)], gait)


def _leap(
    script: MotionScript, rng: np.random.Generator, height: float, ahead: float, aside: float, turn: float
) -> None:
    """Write one jump from standing to standing."""
    flight, speed = np.sqrt(8 * height / _GRAVITY), np.sqrt(2 * _GRAVITY * height)
    down, crouch = rng.uniform(0.45, 0.8), rng.uniform(0.0, 0.03)
    depth = 0.06 + 0.45 * height + rng.uniform(0.0, 0.04)
    # the push: from the lowest point up to the take-off, at about the mean speed
    push = 2.0 * (depth - crouch) / speed * rng.uniform(0.9, 1.05)
    backswing, upswing = rng.uniform(0.3, 0.8), rng.uniform(-1.6, -0.4)
    bow = rng.uniform(0.8, 2.0) * depth + 0.3 * max(0.0, ahead)
    script.shift({"pelvis_pitch": bow, "waist_pitch": 0.8 * bow}, down)
    for side in (LEFT, RIGHT):
        script.move(arm(side, {"shoulder_pitch": backswing}), down)
    script.rise(0.0)
    script.wait(down)
    script.rise(-depth, 0.0, 0.5 * speed / push)
    script.shift({"pelvis_pitch": 0.2 * bow, "waist_pitch": 0.2 * bow}, 1.2 * push)
    for side in (LEFT, RIGHT):
        script.move(arm(side, {"shoulder_pitch": upswing, "shoulder_roll": rng.uniform(0.2, 0.5)}), 1.3 * push)
    script.wait(push)
    _fly(script, flight, speed, crouch, _moved(script, ahead, aside, turn), tuck=rng.uniform(0.0, 0.2) * height)
    soft = 0.5 * depth + 0.5 * height
    landing = 2.2 * (soft - crouch + 0.01) / speed + 0.05
    script.shift({"pelvis_pitch": 0.7 * bow, "waist_pitch": 0.5 * bow}, landing + 0.2)
    script.wait(landing)
    script.rise(-soft - 0.03)
    _stand_up(script, rng.uniform(0.7, 1.1))


def _fly(
    script: MotionScript, seconds: float, speed: float, crouch: float, places: list[np.ndarray], tuck: float
) -> None:
    """Write a flight with both feet, from the take-off to the landing."""
    script.rise(-crouch, speed, -_GRAVITY)
    tips = 0.25 + 0.2 * speed
    for foot, side in enumerate(SIDES):
        channel = f"{side}_foot_pitch"
        script.move({channel: tips}, 0.18, -0.12)
        script.move({channel: 0.0}, 0.6 * seconds, 0.4 * seconds)
        script.step(foot, places[foot], seconds, _GRAVITY * seconds**2 / 8 + tuck, snatched=True)
    script.weigh(script.under(0.5), seconds)
    script.wait(seconds)
    script.rise(-crouch, -speed, -_GRAVITY)


def _moved(script: MotionScript, ahead: float, aside: float, turn: float) -> list[np.ndarray]:
    """Return where both feet stand after the stance has moved and turned about its middle."""
    middle, yaw = script.feet[:, :2].mean(0), script.feet[:, 2].mean()
    heading, left = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
    cosine, sine = np.cos(turn), np.sin(turn)
    offset = (script.feet[:, :2] - middle) @ np.array([[cosine, sine], [-sine, cosine]])
    place = middle + ahead * heading + aside * left + offset
    return [np.array([*place[foot], script.feet[foot, 2] + turn]) for foot in (LEFT, RIGHT)]


def _stand_up(script: MotionScript, seconds: float) -> None:
    script.rest(seconds)
    script.rise(0.0, delay=seconds)
    script.wait(seconds + 0.1)


def _brace(script: MotionScript, rng: np.random.Generator, seconds: float) -> None:
    out, elbow = rng.uniform(0.0, 0.5), rng.uniform(-0.3, 0.8)
    for side in (LEFT, RIGHT):
        script.move(arm(side, {"shoulder_roll": 0.2 + out, "elbow": elbow}), seconds)


def _home(script: MotionScript, seconds: float) -> None:
    script.weigh(script.under(0.5), seconds)
    script.rest(seconds)
    script.wait(seconds + 0.1)


def _free_arms(
    script: MotionScript,
    rng: np.random.Generator,
    ranges: dict[str, tuple[float, float]],
    held: dict[str, float] | None,
    seconds: float,
) -> dict[str, float]:
    """Write a move of one arm or both to where they touch nothing, there and on the way; return the arms' angles."""
    held = held or {
        name: script.home.get(name, 0.0) for side in (LEFT, RIGHT) for name in arm(side, dict.fromkeys(ranges, 0.0))
    }
    sides = [(LEFT,), (RIGHT,), (LEFT, RIGHT), (LEFT, RIGHT)][rng.integers(4)]
    for _ in range(_TRIES):
        target = dict(held)
        for side in sides:
            target |= arm(side, {joint: rng.uniform(*span) for joint, span in ranges.items()})
        # no faster than the joints and the balance like it
        if max(abs(target[name] - held[name]) for name in target) / seconds < _FASTEST_ARM and _free(held, target):
            script.move(target, seconds)
            return target
    return held


def _free(held: dict[str, float], target: dict[str, float]) -> bool:
    model = G1.shared_model
    data = mujoco.MjData(model)
    qpos = G1.default_qpos.copy()
    index = [7 + G1.joint_names.index(name) for name in target]
    begin, end = (np.array([pose[name] for name in target]) for pose in (held, target))
    for share in np.linspace(0, 1, _CLEARANCE_STEPS)[1:]:
        qpos[index] = begin + share * (end - begin)
        if self_penetration(model, qpos, data) > 0.0:
            return False
    return True
