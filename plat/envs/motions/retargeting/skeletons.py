"""Which joints of a BVH file are which joints of a human, and where its metres and its up are."""

from collections.abc import Iterable
from dataclasses import dataclass, fields
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from plat.envs.motions.retargeting.bvh import Bvh
from plat.errors import MotionError

__all__ = ["ROLES", "SIDES", "Human", "SkeletonMap", "builtin_maps", "find_map", "load_map", "read_human"]

SIDES = ("left", "right")
ROLES = (
    *("hips", "spine", "chest", "neck"),
    *(f"{side}_{joint}" for side in SIDES for joint in ("hip", "knee", "ankle", "toe")),
    *(f"{side}_{joint}" for side in SIDES for joint in ("shoulder", "elbow", "wrist")),
)
"""Joints of a human that retargeting looks at."""

_UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254}
_AXES = {"x": 0, "y": 1, "z": 2}
# Thigh and shin together of any human, in m: tells the units apart.
_LEG_LENGTH = (0.45, 1.3)


@dataclass(frozen=True)
class SkeletonMap:
    """How to read the joints of one kind of skeleton.

    Args:
        name: what reports call it.
        joints: one of :data:`ROLES` to the name of a joint, or of an end site (``<joint>_end``).
        units: of the file's lengths, ``m``, ``cm``, ``mm`` or ``inch``; ``auto`` takes the one that makes the legs
            as long as human legs are.
        up: axis of the file's world that points up, ``x``, ``y`` or ``z``; ``auto`` takes the one along which the
            hips are furthest above the ankles, on average.
        pelvis_pitch: degrees by which the line from ``hips`` to ``spine`` leans back in upright standing.
        torso_pitch: degrees by which the line from ``chest`` to ``neck`` leans back in upright standing.

    Raises:
        MotionError: for a role that is missing or unknown, or a value that is not one of these.
    """

    name: str
    joints: dict[str, str]
    units: str = "auto"
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
        for field, known in (("units", _UNITS), ("up", _AXES)):
            if getattr(self, field) not in ("auto", *known):
                raise MotionError(f"{where}: {field!r} is {getattr(self, field)!r}, expected auto, {', '.join(known)}")
        for field in ("pelvis_pitch", "torso_pitch"):
            if not isinstance(getattr(self, field), (int, float)):
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
    folder = resources.files("plat.envs.motions.retargeting") / "skeletons"
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
    if skeleton.up == "auto":
        above = np.mean([raw["hips"] - raw[f"{side}_ankle"] for side in SIDES], (0, 1))
        up = int(np.argmax(above))
        if above[up] < 2 * np.delete(abs(above), up).max():
            raise MotionError(f"{where}: which axis is up is not to be told from the pose; state 'up' in a map")
    else:
        up = _AXES[skeleton.up]
    bones = [(raw[f"{side}_{a}"], raw[f"{side}_{b}"]) for side in SIDES for a, b in (("hip", "knee"), ("knee", "ankle"))]
    leg = float(sum(np.linalg.norm(end - start, axis=1).mean() for start, end in bones) / 2)
    if skeleton.units == "auto":
        fitting = [unit for unit in ("m", "cm", "mm") if _LEG_LENGTH[0] < leg * _UNITS[unit] < _LEG_LENGTH[1]]
        if not fitting:
            raise MotionError(f"{where}: legs of {leg:.4g} are human in neither m, cm nor mm; state 'units' in a map")
        unit = _UNITS[fitting[0]]
    else:
        unit = _UNITS[skeleton.units]
    # a cyclic change of axes is a rotation, so that left stays left
    axes = [(up + 1) % 3, (up + 2) % 3, up]
    origin = np.append(raw["hips"][0, axes[:2]], 0.0)
    positions = {role: unit * (position[:, axes] - origin) for role, position in raw.items()}
    ankles = [f"{side}_ankle" for side in SIDES]
    return Human(positions, {role: bvh.rotations[:, indices[role]][:, axes] for role in ankles}, unit * leg)
