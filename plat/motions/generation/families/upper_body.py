"""Motion families of arms and trunk over fixed feet."""

import numpy as np

from plat.motions.generation.script import LEFT, RIGHT, SIDES, MotionScript

__all__ = ["arm", "gesture", "punch", "reach", "stand", "twist", "wave"]

# Joints of an arm whose angle has the opposite sign on the right.
_MIRRORED = ("shoulder_roll", "shoulder_yaw", "wrist_roll", "wrist_yaw")

# Angles (rad) of an arm by ranges: roll is outward, yaw inward; an elbow of 0 is bent to a right angle.
_ANYWHERE = {
    "shoulder_pitch": (-2.2, 0.4),
    "shoulder_roll": (0.15, 1.2),
    "shoulder_yaw": (-0.5, 0.5),
    "elbow": (-0.3, 1.2),
    "wrist_roll": (-0.6, 0.6),
    "wrist_pitch": (-0.4, 0.4),
    "wrist_yaw": (-0.4, 0.4),
}
_RAISED = {**_ANYWHERE, "shoulder_pitch": (-1.6, -0.6), "shoulder_roll": (0.4, 1.1), "elbow": (-0.6, 0.3)}
_IN_FRONT = {
    "shoulder_pitch": (-0.9, -0.2),
    "shoulder_roll": (0.1, 0.5),
    "shoulder_yaw": (-0.5, 0.3),
    "elbow": (-0.5, 0.5),
    "wrist_roll": (-0.8, 0.8),
    "wrist_pitch": (-0.5, 0.5),
    "wrist_yaw": (-0.4, 0.4),
}
_GUARD = {
    "shoulder_pitch": (-0.5, -0.2),
    "shoulder_roll": (0.1, 0.25),
    "shoulder_yaw": (-0.3, 0.0),
    "elbow": (-0.7, -0.3),
}
_STRUCK = {
    "shoulder_pitch": (-1.6, -1.2),
    "shoulder_roll": (0.0, 0.15),
    "shoulder_yaw": (-0.1, 0.1),
    "elbow": (0.9, 1.3),
}


def arm(side: int, angles: dict[str, float]) -> dict[str, float]:
    """Return the channels of an arm from angles given as for the left one."""
    return {
        f"{SIDES[side]}_{joint}": -angle if side == RIGHT and joint in _MIRRORED else angle
        for joint, angle in angles.items()
    }


def _draw(rng: np.random.Generator, side: int, ranges: dict[str, tuple[float, float]]) -> dict[str, float]:
    return arm(side, {joint: rng.uniform(*span) for joint, span in ranges.items()})


def stand(script: MotionScript, rng: np.random.Generator) -> None:
    """Write standing with slow sways of the weight and of the gaze."""
    seconds = rng.uniform(3.5, 5.5)
    frequency = rng.uniform(0.15, 0.35)
    for channel, amplitude in (
        ("waist_yaw", 0.3),
        ("waist_roll", 0.06),
        ("waist_pitch", 0.08),
        ("pelvis_roll", 0.03),
        ("pelvis_height", 0.015),
        ("left_shoulder_pitch", 0.1),
        ("right_shoulder_pitch", 0.1),
    ):
        script.wave(channel, rng.uniform(-amplitude, amplitude), frequency, seconds, rng.uniform(0, 6), edge=1.0)
    script.wait(seconds)


def reach(script: MotionScript, rng: np.random.Generator) -> None:
    """Write reaching with one hand or both to several places, with the trunk turning and leaning along."""
    sides = [(LEFT,), (RIGHT,), (LEFT, RIGHT)][rng.integers(3)]
    for _ in range(rng.integers(2, 4)):
        seconds = rng.uniform(0.8, 1.4)
        for side in sides:
            script.move(_draw(rng, side, _ANYWHERE), seconds, rng.uniform(0, 0.1))
        lean = {"waist_yaw": rng.uniform(-0.7, 0.7), "waist_roll": rng.uniform(-0.15, 0.15)}
        script.move({**lean, "waist_pitch": rng.uniform(-0.1, 0.35)}, seconds)
        script.wait(seconds + rng.uniform(0.1, 0.6))
    _back_to_rest(script, rng)


def wave(script: MotionScript, rng: np.random.Generator) -> None:
    """Write waving with a raised hand."""
    side = int(rng.integers(2))
    up, hold = rng.uniform(0.8, 1.2), rng.uniform(1.5, 3.0)
    script.move({**_draw(rng, side, _RAISED), "waist_yaw": rng.uniform(-0.3, 0.3)}, up)
    script.wait(up)
    script.wave(f"{SIDES[side]}_shoulder_yaw", rng.uniform(0.2, 0.4), rng.uniform(0.8, 1.5), hold)
    script.wait(hold)
    _back_to_rest(script, rng)


def gesture(script: MotionScript, rng: np.random.Generator) -> None:
    """Write talking gestures with both hands before the body."""
    for _ in range(rng.integers(3, 6)):
        seconds = rng.uniform(0.5, 0.9)
        for side in (LEFT, RIGHT):
            if rng.random() < 0.8:
                script.move(_draw(rng, side, _IN_FRONT), seconds, rng.uniform(0, 0.15))
        script.move({"waist_yaw": rng.uniform(-0.25, 0.25), "waist_pitch": rng.uniform(0, 0.1)}, seconds)
        script.wait(seconds + rng.uniform(0.15, 0.5))
    _back_to_rest(script, rng)


def twist(script: MotionScript, rng: np.random.Generator) -> None:
    """Write twisting the trunk from side to side, arms held out or hanging."""
    seconds = rng.uniform(0.8, 1.3)
    out = rng.uniform(0.1, 1.1)
    for side in (LEFT, RIGHT):
        script.move(arm(side, {"shoulder_roll": 0.2 + out, "elbow": rng.uniform(0.2, 1.2)}), seconds)
    script.wait(seconds * 0.8)
    sign = rng.choice((-1, 1))
    for _ in range(rng.integers(2, 5)):
        seconds, angle = rng.uniform(0.9, 1.5), sign * rng.uniform(0.4, 1.0)
        script.move({"waist_yaw": angle, "pelvis_yaw": 0.25 * angle}, seconds)
        script.wait(seconds + rng.uniform(0.0, 0.3))
        sign = -sign
    _back_to_rest(script, rng)


def punch(script: MotionScript, rng: np.random.Generator) -> None:
    """Write alternating punches from a guard."""
    seconds = rng.uniform(0.7, 1.0)
    guard = [_draw(rng, side, _GUARD) for side in (LEFT, RIGHT)]
    for pose in guard:
        script.move(pose, seconds)
    script.move({"pelvis_height": script.home.get("pelvis_height", 0.0) - rng.uniform(0.0, 0.05)}, seconds)
    script.wait(seconds + 0.2)
    side = int(rng.integers(2))
    for _ in range(rng.integers(3, 7)):
        out, back = rng.uniform(0.3, 0.5), rng.uniform(0.4, 0.6)
        turn = rng.uniform(0.2, 0.5) * (-1 if side == LEFT else 1)
        script.move({**_draw(rng, side, _STRUCK), "waist_yaw": turn}, out)
        script.wait(out + 0.05)
        script.move({**guard[side], "waist_yaw": 0.0}, back)
        script.wait(back + rng.uniform(0.0, 0.4))
        side = 1 - side if rng.random() < 0.8 else side
    _back_to_rest(script, rng)


def _back_to_rest(script: MotionScript, rng: np.random.Generator) -> None:
    seconds = rng.uniform(0.8, 1.3)
    script.rest(seconds)
    script.wait(seconds)
