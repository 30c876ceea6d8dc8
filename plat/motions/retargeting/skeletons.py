"""Which joints of a BVH file are which joints of a human, and where its metres and its up are."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from plat.errors import MotionError
from plat.motions.retargeting.bvh import Bvh

__all__ = ["ROLES", "SIDES", "Human", "SkeletonMap", "builtin_maps", "find_map", "load_map", "read_human"]

SIDES = ("left", "right")
ROLES = (
    *("hips", "spine", "chest", "neck"),
    *(f"{side}_{joint}" for side in SIDES for joint in ("hip", "knee", "ankle", "toe")),
    *(f"{side}_{joint}" for side in SIDES for joint in ("shoulder", "elbow", "wrist")),
)
"""Joints of a human that retargeting looks at."""

_UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
_AXES = {"x": 0, "y": 1, "z": 2}
# Thigh and shin together of any human, in m: tells the units apart.
_LEG_LENGTH = (0.45, 1.3)


@dataclass(frozen=True)
class SkeletonMap:
    """How to read the joints of one kind of skeleton.

    Args:
        name: what reports call it.
        joints: one of :data:`ROLES` to the name of a joint, or of an end site (``<joint>_end``).
        units: of the file's lengths, ``m``, ``cm``, ``mm`` or the metres that a unit has; ``auto`` takes the one of
            the three that makes the legs as long as human legs are.
        up: axis of the file's world that points up, ``x``, ``y`` or ``z``; ``auto`` takes the one along which the
            hips are furthest above the ankles, on average.
        pelvis_pitch: degrees by which the line from ``hips`` to ``spine`` leans back in upright standing.
        torso_pitch: degrees by which the line from ``chest`` to ``neck`` leans back in upright standing.

    Raises:
        MotionError: for a role that is missing or unknown, or a value that is not one of these.
    """

    name: str
    joints: dict[str, str]
    units: str | float = "auto"
    up: str = "auto"
    pelvis_pitch: float = 0.0
    torso_pitch: float = 0.0

    def __post_init__(self) -> None:
        where = f"skeleton map {self.name!r}"
        if not isinstance(self.joints, dict) or set(self.joints) != set(ROLES):
            given = set(self.joints) if isinstance(self.joints, dict) else set()
            raise MotionError(
                f"{where}: 'joints' lacks {sorted(set(ROLES) - given)} and has the unknown {sorted(given - set(ROLES))}"
            )
        if self.units not in ("auto", *_UNITS) and not (_is_number(self.units) and float(self.units) > 0):
            raise MotionError(f"{where}: 'units' is {self.units!r}, expected auto, m, cm, mm or metres a unit")
        if self.up not in ("auto", *_AXES):
            raise MotionError(f"{where}: 'up' is {self.up!r}, expected auto, x, y or z")
        for field in ("pelvis_pitch", "torso_pitch"):
            if not _is_number(getattr(self, field)):
                raise MotionError(f"{where}: {field!r} is {getattr(self, field)!r}, expected degrees")


def load_map(path: str | Path) -> SkeletonMap:
    """Read a skeleton map from a YAML file with the fields of :class:`SkeletonMap`, its name being the file's.

    Raises:
        MotionError: when the file cannot be read or has a wrong field.
    """
    try:
        import yaml
    except ImportError as error:
        raise MotionError("retargeting needs: pip install 'plat-rl[retarget]'") from error
    where = f"skeleton map {str(path)!r}"
    try:
        content: Any = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise MotionError(f"{where}: not a readable YAML file ({error})") from error
    known = {field.name for field in fields(SkeletonMap)} - {"name"}
    if not isinstance(content, dict) or "joints" not in content or not set(content) <= known:
        raise MotionError(f"{where}: expected the field 'joints' and any of {sorted(known - {'joints'})}")
    return SkeletonMap(name=Path(path).stem, **content)


@cache
def builtin_maps() -> tuple[SkeletonMap, ...]:
    """The maps that come with plat.

    >>> [skeleton.name for skeleton in builtin_maps()]
    ['bandai', 'lafan1']
    """
    folder = resources.files("plat.motions.retargeting") / "skeletons"
    with resources.as_file(folder) as path:
        return tuple(load_map(file) for file in sorted(path.glob("*.yaml")))


def find_map(names: Iterable[str], where: str) -> SkeletonMap:
    """The map that comes with plat whose joints all occur among ``names``; ``where`` is for the error message.

    Raises:
        MotionError: when none fits.
    """
    names = list(names)
    for skeleton in builtin_maps():
        if set(skeleton.joints.values()) <= set(names):
            return skeleton
    known = ", ".join(skeleton.name for skeleton in builtin_maps())
    raise MotionError(
        f"{where}: its joints are those of none of the known skeletons ({known}); write a map for them (--map), "
        f"see docs/retargeting.md. Its joints are: {', '.join(names[:60])}"
    )


@dataclass(frozen=True)
class Human:
    """The motion of a human over T frames, in m, the z axis up, beginning over the origin.

    Attributes:
        positions: role to ``[T, 3]``.
        rotations: of the ankles' joints, role to ``[T, 3, 3]`` (joint to world, the joint's axes being the file's).
        leg: thigh and shin together, mean of both sides and all frames.
    """

    positions: dict[str, np.ndarray]
    rotations: dict[str, np.ndarray]
    leg: float


def read_human(bvh: Bvh, skeleton: SkeletonMap, where: str) -> Human:
    """Look up the joints that retargeting needs; ``where`` is for the error messages.

    Raises:
        MotionError: when a joint of the map is missing, or units or up axis are not to be told.
    """
    missing = sorted(set(skeleton.joints.values()) - set(bvh.names))
    if missing:
        raise MotionError(f"{where}: lacks the joints {missing} of skeleton map {skeleton.name!r}")
    indices = {role: bvh.names.index(name) for role, name in skeleton.joints.items()}
    raw = {role: bvh.positions[:, index] for role, index in indices.items()}
    up = _up(raw, where) if skeleton.up == "auto" else _AXES[skeleton.up]
    joints = np.array([[raw[f"{side}_{joint}"] for joint in ("hip", "knee", "ankle")] for side in SIDES])
    leg = float(2 * np.linalg.norm(np.diff(joints, axis=1), axis=-1).mean())
    if leg == 0:
        raise MotionError(f"{where}: legs without length; are hips, knees and ankles of the skeleton map right?")
    unit = _unit(leg, where) if skeleton.units == "auto" else float(_UNITS.get(str(skeleton.units), skeleton.units))
    # a cyclic change of axes is a rotation, so that left stays left
    axes = [(up + 1) % 3, (up + 2) % 3, up]
    origin = np.append(raw["hips"][0, axes[:2]], 0.0)
    positions = {role: unit * (position[:, axes] - origin) for role, position in raw.items()}
    ankles = [f"{side}_ankle" for side in SIDES]
    return Human(positions, {role: bvh.rotations[:, indices[role]][:, axes] for role in ankles}, unit * leg)


def _up(raw: dict[str, np.ndarray], where: str) -> int:
    """The axis along which the hips are furthest above the ankles."""
    above = np.mean([raw["hips"] - raw[f"{side}_ankle"] for side in SIDES], (0, 1))
    up = int(np.argmax(above))
    if above[up] < 2 * np.delete(abs(above), up).max():
        raise MotionError(f"{where}: which axis is up is not to be told from the poses; state 'up' in a map")
    return up


def _unit(leg: float, where: str) -> float:
    """Metres a unit that make a leg as long as a human's."""
    for unit in _UNITS.values():
        if _LEG_LENGTH[0] < unit * leg < _LEG_LENGTH[1]:
            return unit
    raise MotionError(f"{where}: legs of {leg:.4g} are human in neither m, cm nor mm; state 'units' in a map")


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and math.isfinite(value)
