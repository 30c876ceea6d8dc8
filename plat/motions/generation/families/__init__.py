"""Families of motion: each writes a phrase onto a script, from the resting posture and back to it."""

from collections.abc import Callable

import numpy as np

from plat.motions.generation.families.legs import balance, bow, kick, lunge, squat, weight_shift
from plat.motions.generation.families.upper_body import gesture, punch, reach, stand, twist, wave
from plat.motions.generation.families.walking import (
    crouch_walk,
    step_in_place,
    turn,
    walk,
    walk_backward,
    walk_sideways,
)
from plat.motions.generation.script import MotionScript

__all__ = ["FAMILIES", "Family", "sequence"]

Family = Callable[[MotionScript, np.random.Generator], None]
"""Writes one phrase; every parameter comes from the generator."""

_PHRASES: dict[str, Family] = {
    "stand": stand,
    "reach": reach,
    "walk": walk,
    "squat": squat,
    "wave": wave,
    "bow": bow,
    "step": step_in_place,
    "turn": turn,
    "lunge": lunge,
    "twist": twist,
    "sideways": walk_sideways,
    "kick": kick,
    "gesture": gesture,
    "backward": walk_backward,
    "punch": punch,
    "shift": weight_shift,
    "crouch": crouch_walk,
    "balance": balance,
}


def sequence(script: MotionScript, rng: np.random.Generator) -> None:
    """Write three to five phrases of other families, blended into each other."""
    names = rng.choice(list(_PHRASES), size=rng.integers(3, 6), replace=False)
    for name in names:
        _PHRASES[name](script, rng)
        script.wait(rng.uniform(0.0, 0.4))


FAMILIES: dict[str, Family] = {**_PHRASES, "sequence": sequence}
"""Every kind of motion by name."""
