"""Families of motion: each writes a phrase onto a script, from the resting posture and back to it."""

from collections.abc import Callable

import numpy as np

from plat.motions.generation.families.agile import cut, halt, run, shuffle, stumble
from plat.motions.generation.families.athletic import arms, fetch, high_kick, hop, jump, low_work, squat_deep
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

__all__ = ["FAMILIES", "GROUPS", "NOT_FOLLOWED", "ON_QUICK_FEET", "WIDE_FAMILIES", "Family", "sequence"]

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
"""Every kind of motion of the plain sets, by name."""

WIDE_FAMILIES: dict[str, Family] = {
    "run": run,
    "arms": arms,
    "jump": jump,
    "lowwork": low_work,
    "cut": cut,
    "fetch": fetch,
    "halt": halt,
    "highkick": high_kick,
    "stumble": stumble,
    "deepsquat": squat_deep,
    "shuffle": shuffle,
    "hop": hop,
}
"""Wider and harder kinds of motion by name; sets hold them only where they are asked for."""

ON_QUICK_FEET = frozenset(("run", "jump", "cut", "halt", "stumble", "shuffle", "hop"))
"""Families whose feet roll, fly and land: weight may leave the soles a little, as in running."""

GROUPS: dict[str, tuple[str, ...]] = {"wide": tuple(WIDE_FAMILIES), "all": (*FAMILIES, *WIDE_FAMILIES)}
"""Names that stand for several families."""

NOT_FOLLOWED: dict[str, tuple[str, ...]] = {
    "expert-g1": ("run", "cut", "halt", "jump", "highkick", "lowwork", "arms", "fetch"),
    "expert-model-g1": (),
}
"""Families of which an expert that comes with plat loses half of the clips or more, by its name.

Measured on the set ``val`` by ``benchmarks/dense.py`` and ``benchmarks/generated.py``.
"""
