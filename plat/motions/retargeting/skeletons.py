"""Which joints of a capture are which joints of a human, and where its meters and its up are."""

import math
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from plat.errors import MotionError
from plat.files import write_file
from plat.json_file import short
from plat.motions.retargeting.yaml_file import read_yaml

__all__ = ["ROLES", "SIDES", "UNITS", "SkeletonMap", "load_map", "save_map"]

SIDES = ("left", "right")
ROLES = (
    *("hips", "spine", "chest", "neck"),
    *(f"{side}_{joint}" for side in SIDES for joint in ("hip", "knee", "ankle", "toe")),
    *(f"{side}_{joint}" for side in SIDES for joint in ("shoulder", "elbow", "wrist")),
)
"""Joints of a human that retargeting looks at."""

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048, "in/0.45": 0.0254 / 0.45}
"""Meters a unit; the last is what CMU's captures count in."""

_AXES = ("x", "y", "z")


@dataclass(frozen=True)
class SkeletonMap:
    """How to read the joints of one kind of skeleton.

    Args:
        name: what reports call it.
        joints: one of :data:`ROLES` to the name of a joint, or of an end site (``<joint>_end``).
        units: of the file's lengths, one of :data:`UNITS` or the meters that a unit has; ``auto`` takes the one that
            makes the legs as long as human legs are. A unit that makes them something else gives way.
        up: axis of the file's world that points up, ``x``, ``y`` or ``z``; ``auto`` takes the one along which the
            body stands over a floor. An axis that contradicts the motion gives way, or the file is refused.
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
                f"{where}: 'joints' lacks {sorted(set(ROLES) - given)} and has the unknown "
                f"{short(sorted(map(str, given - set(ROLES))))}"
            )
        for role, name in self.joints.items():
            if not isinstance(name, str) or not name:
                raise MotionError(f"{where}: 'joints': {role!r} is {short(name)}, expected the name of a joint")
        if self.units not in ("auto", *UNITS) and not (_is_number(self.units) and float(self.units) > 0):
            raise MotionError(
                f"{where}: 'units' is {short(self.units)}, expected auto, m, cm, mm, in, ft, in/0.45 or meters a unit"
            )
        if self.up not in ("auto", *_AXES):
            raise MotionError(f"{where}: 'up' is {short(self.up)}, expected auto, x, y or z")
        for field in ("pelvis_pitch", "torso_pitch"):
            if not _is_number(getattr(self, field)):
                raise MotionError(f"{where}: {field!r} is {short(getattr(self, field))}, expected degrees")


def load_map(path: str | Path) -> SkeletonMap:
    """Read a skeleton map from a YAML file with the fields of :class:`SkeletonMap`, its name being the file's.

    Raises:
        MotionError: when the file cannot be read or has a wrong field.
    """
    where = f"skeleton map {str(path)!r}"
    content = read_yaml(Path(path), where)
    known = {field.name for field in fields(SkeletonMap)} - {"name"}
    if not isinstance(content, dict) or "joints" not in content or not set(content) <= known:
        raise MotionError(f"{where}: expected the field 'joints' and any of {sorted(known - {'joints'})}")
    for field in ("units", "pelvis_pitch", "torso_pitch"):
        if field in content and field not in UNITS:
            content[field] = _number_of(content[field])
    return SkeletonMap(name=Path(path).stem, **content)


def _number_of(value: Any) -> Any:
    """Return the number that a text is, or the text."""
    try:
        return float(value)
    except (TypeError, ValueError):
        return value


def save_map(path: str | Path, skeleton: SkeletonMap, comment: str) -> None:
    """Write a skeleton map as YAML that :func:`load_map` reads, under a comment of one line.

    Raises:
        OutputError: when the disk does not take it, or its name.
    """
    lines = [f"# {comment}", "joints:", *(f"  {role}: {_quoted(name)}" for role, name in skeleton.joints.items())]
    fields_after = ("units", "up", "pelvis_pitch", "torso_pitch")
    lines += [f"{field}: {getattr(skeleton, field)}" for field in fields_after]
    text = "\n".join((*lines, ""))
    write_file(Path(path), lambda part: part.write_text(text, encoding="utf-8"), "skeleton map")


def _quoted(name: str) -> str:
    return "'" + name.replace("'", "''") + "'"


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and math.isfinite(value)
