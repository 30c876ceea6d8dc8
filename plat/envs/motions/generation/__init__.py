"""Motions for the G1 from parameters and a seed, offline and with no data set behind them."""

import zlib

import numpy as np

from plat.envs.motions.clip import MotionClip
from plat.envs.motions.generation.families import DT, FAMILIES, Studio
from plat.envs.motions.generation.whole_body import WholeBody
from plat.envs.robot import G1, Robot
from plat.errors import MotionError

__all__ = ["SPLITS", "generate_motions"]

SPLITS = ("train", "val", "test")
"""Sets of motions that share no seed."""


def generate_motions(
    split: str, seconds: float = 240.0, families: tuple[str, ...] = (), robot: Robot = G1
) -> list[MotionClip]:
    """Clips that go round the families until there is enough motion.

    Feet stand still where they stand, soles touch the floor, the centre of mass is where balance wants it (standing
    still or by the zero-moment point of the steps), and no joint limit is broken. The same arguments give the same
    clips on every machine up to rounding.

    Args:
        split: ``"train"``, ``"val"`` or ``"test"``: sets that share no seed.
        seconds: at least this much motion in all.
        families: names from :data:`plat.envs.motions.generation.families.FAMILIES`; by default all.
        robot: the robot.

    Raises:
        MotionError: for a split or family that there is not.

    >>> [clip.name for clip in generate_motions("val", seconds=8)]
    ['stand_val_000', 'reach_val_000']
    """
    if split not in SPLITS:
        raise MotionError(f"generated motions: no set {split!r}, expected one of {SPLITS}")
    unknown = sorted(set(families) - set(FAMILIES))
    if unknown:
        raise MotionError(f"generated motions: no family {unknown}, expected some of {sorted(FAMILIES)}")
    studio = Studio(WholeBody(robot))
    clips: list[MotionClip] = []
    total, number = 0.0, 0
    while True:
        for family in families or FAMILIES:
            name = f"{family}_{split}_{number:03d}"
            # the name is the seed, so that a set of other size or families holds the same clips
            rng = np.random.default_rng(zlib.crc32(name.encode()))
            clips.append(MotionClip(name, FAMILIES[family](studio, rng), 1 / DT))
            total += clips[-1].duration
            if total >= seconds:
                return clips
        number += 1
