"""Generated motions for the G1 from parameters and a seed, offline and without a data set."""

import logging
import zlib
from itertools import count

import numpy as np

from plat.bounds import as_names, check_robot, is_finite
from plat.errors import MotionError, RobotError
from plat.json_file import short
from plat.motions.checks.validation import validate_motion
from plat.motions.clip import MotionClip
from plat.motions.generation.families import FAMILIES, GROUPS, NOT_FOLLOWED, ON_QUICK_FEET, WIDE_FAMILIES, Family
from plat.motions.generation.script import MotionScript
from plat.motions.generation.solver import DT, Solver
from plat.motions.generation.soundness import QUICK_FEET, SoundnessLimits, measure_soundness
from plat.motions.generation.whole_body import WholeBody
from plat.progress import Progress
from plat.robots import G1, Robot

__all__ = [
    "FAMILIES",
    "GROUPS",
    "NOT_FOLLOWED",
    "PREFIX",
    "SPLITS",
    "WIDE_FAMILIES",
    "generate_motions",
    "generate_named",
]

PREFIX = "generated:"
"""What the name of a generated set begins with, where motion files are asked for."""

SPLITS = ("train", "val", "test")
"""Sets of motions that share no seed."""

LONGEST = 1e5
"""Most seconds of motion that are generated at a time; more than a day of them."""

_ATTEMPTS = 20
_LOG = logging.getLogger(__name__)


def generate_motions(
    split: str, seconds: float = 240.0, families: tuple[str, ...] = (), robot: Robot = G1
) -> list[MotionClip]:
    """Generate clips of all families in turn until there is enough motion.

    Each clip begins and ends at rest and is sound by :class:`plat.motions.generation.soundness.SoundnessLimits`:
    feet do not slip, the zero-moment point of all bodies is over the feet, no joint limit is broken, and no
    bodies intersect. Other draws are rejected (and logged at level DEBUG). The same arguments give the
    same clips on every machine up to rounding.

    Wide families are judged by :data:`plat.motions.generation.soundness.QUICK_FEET` where feet roll and fly, and
    :func:`plat.motions.validate_motion` has to call every clip *use*.

    Args:
        split: ``"train"``, ``"val"`` or ``"test"``: sets that share no seed.
        seconds: smallest total length of the motion.
        families: names from :data:`FAMILIES`, :data:`WIDE_FAMILIES` and :data:`GROUPS` (``"wide"`` or ``"all"``). By
            default all of :data:`FAMILIES`.
        robot: the robot.

    Raises:
        MotionError: for a split or family that there is not.
        RobotError: for a robot that does not have the joints of the G1.

    >>> [clip.name for clip in generate_motions("val", seconds=8)]
    ['stand_val_000', 'reach_val_000']
    """
    if split not in SPLITS:
        raise MotionError(f"generated motions: no set {split!r}, expected one of {SPLITS}")
    if not (is_finite(seconds) and 0 < seconds <= LONGEST):
        raise MotionError(f"generated motions: {short(seconds)} s, expected above 0 and at most {LONGEST:,g} s")
    known = {**FAMILIES, **WIDE_FAMILIES}
    # each once: a family in two of the names would give clips of one name, the same motion
    families = tuple(dict.fromkeys(member for name in as_names(families) for member in GROUPS.get(name, (name,))))
    unknown = sorted(set(families) - set(known))
    if unknown:
        raise MotionError(f"generated motions: no family {unknown}, expected some of {sorted({*known, *GROUPS})}")
    check_robot(robot)
    if robot.joint_names != G1.joint_names:
        raise RobotError(
            f"robot {robot.name!r}: motions are generated for the joints of the G1 only, expected motion files "
            "of this robot, or keyframes where these are enough"
        )
    solver = Solver(WholeBody(robot))
    clips: list[MotionClip] = []
    total = 0.0
    with Progress("generating motions", total=round(seconds), unit="s") as progress:
        for number, family in ((number, family) for number in count() for family in families or FAMILIES):
            name = f"{family}_{split}_{number:03d}"
            qpos = _sound(name, known[family], solver, family in WIDE_FAMILIES, family in ON_QUICK_FEET)
            clips.append(MotionClip(name, qpos, 1 / DT))
            total += clips[-1].duration
            progress.update(round(total))
            if total >= seconds:
                break
    return clips


def generate_named(name: str, robot: Robot = G1) -> list[MotionClip]:
    """Generate the clips of ``generated:SPLIT``, ``generated:SPLIT@SECONDS``, or either with ``/FAMILY+FAMILY`` after
    SPLIT. ``wide`` stands for all wide families, and ``all`` for all there are.

    Raises:
        MotionError: for a name of another form, or a split or family that there is not.

    >>> [clip.name for clip in generate_named("generated:train/bow+wave@8")]
    ['bow_train_000', 'wave_train_000']
    """
    split, _, seconds = name.removeprefix(PREFIX).partition("@")
    split, _, families = split.partition("/")
    chosen = tuple(families.split("+")) if families else ()
    if not seconds:
        return generate_motions(split, families=chosen, robot=robot)
    try:
        duration = float(seconds)
    except ValueError:
        raise MotionError(f"{name!r}: {seconds!r} after the @, expected seconds, as in generated:train@600") from None
    return generate_motions(split, duration, chosen, robot)


def _sound(name: str, family: Family, solver: Solver, inspected: bool, quick: bool) -> np.ndarray:
    """Return the first sound draw of a family.

    ``inspected`` draws have to pass the checks of motion files as well, and ``quick`` ones move on quick feet.
    """
    limits = QUICK_FEET if quick else SoundnessLimits()
    # the name is the seed, so that a set of other size or families holds the same clips
    rng = np.random.default_rng(zlib.crc32(name.encode()))
    for _ in range(_ATTEMPTS):
        script = MotionScript(*_posture(rng))
        script.wait(0.4)
        family(script, rng)
        script.wait(0.4)
        try:
            qpos = solver.poses(script.draft(DT)).astype(np.float32)
            faults = measure_soundness(solver.robot, qpos, DT, limits).faults(limits)
            if inspected and not faults:
                faults = list(validate_motion(MotionClip(name, qpos, 1 / DT), solver.robot).reasons)
        except MotionError as error:
            faults = [str(error)]
        if not faults:
            return qpos
        _LOG.debug("motion %r rejected and drawn again: %s", name, "; ".join(faults))
    raise MotionError(f"motion {name!r}: {_ATTEMPTS} draws and none is sound; the last: {'; '.join(faults)}")


def _posture(rng: np.random.Generator) -> tuple[np.ndarray, dict[str, float]]:
    """Return a stance ``[2, 3]`` (m, m, rad) and resting values to start from."""
    width, splay = rng.uniform(0.09, 0.125), rng.uniform(0.0, 0.12)
    home = {"pelvis_height": -rng.uniform(0.0, 0.025), "waist_pitch": rng.uniform(0.0, 0.06)}
    arms = {"shoulder_pitch": rng.uniform(0.1, 0.3), "elbow": rng.uniform(0.5, 1.1)}
    outward = rng.uniform(0.15, 0.3)
    for side, sign in (("left", 1), ("right", -1)):
        home |= {f"{side}_{joint}": angle for joint, angle in arms.items()}
        home[f"{side}_shoulder_roll"] = sign * outward
    return np.array([[0.0, width, splay], [0.0, -width, -splay]]), home
