"""Acclaim captures: a skeleton (.asf) and its motion (.amc), as CMU and HDM05 have them."""

import math
import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from plat.errors import MotionError
from plat.files import decoded
from plat.motions.formats.clock import numbering_fault
from plat.motions.formats.foreign import refuse_foreign
from plat.motions.formats.rate import RATES, rates_in_name
from plat.motions.formats.units import Angles
from plat.motions.retargeting.mocap import LARGEST_RADIANS, Mocap, check_extent, may_be_radians, reads_better
from plat.rotations_np import axis_rotation
from plat.words import counted

__all__ = ["find_asf", "read_amc", "skeletons_beside"]

# of CMU and HDM05; the files do not say it
_USUAL_FPS = 120.0
# HDM05 ends its names in take and rate; of CMU's, subject and trial, 14_60 is no rate
_OF_HDM05 = re.compile(r"HDM.*_\d{2,3}_(\d+)", re.IGNORECASE)
# what a value of a frame may move: along or about an axis, or a bone's length, which is left as it is
_FREEDOM = frozenset(("tx", "ty", "tz", "rx", "ry", "rz", "l"))


@dataclass
class _Bone:
    name: str
    direction: np.ndarray = field(default_factory=lambda: np.zeros(3))
    length: float = 0.0
    axis: np.ndarray = field(default_factory=lambda: np.eye(3))
    dof: tuple[str, ...] = ()
    parent: str = ""


@dataclass
class _Skeleton:
    bones: dict[str, _Bone]
    degrees: bool
    notes: tuple[str, ...] = ()


def find_asf(path: Path) -> Path:
    """Return the skeleton of an ``.amc``: beside it, called as it or as the beginning of its name, or the only one.

    Raises:
        MotionError: where there is none, or several and none is called so.
    """
    beside = skeletons_beside(path)
    called = [file for file in beside if _begins(path, file)]
    if called:
        return max(called, key=lambda file: len(file.stem))
    if len(beside) == 1:
        return beside[0]
    found = f"{len(beside)} of them ({', '.join(file.name for file in beside[:3])})" if beside else "none"
    raise MotionError(
        f"AMC file {str(path)!r}: expected its skeleton (.asf) beside it, called as it or as its name begins, "
        f"found {found}"
    )


def _begins(path: Path, skeleton: Path) -> bool:
    """Return whether a file's name begins as its skeleton's: 144_37.amc is of 144.asf, and not of 14.asf."""
    return re.match(re.escape(skeleton.stem.lower()) + r"(?![^\W_])", path.stem.lower()) is not None


def skeletons_beside(path: Path) -> list[Path]:
    """Return the ``.asf`` files in the folder of a file, in the order of their names."""
    # names alone: a folder of thousands of captures is listed once for each of them
    names = sorted(name for name in os.listdir(path.parent) if name.lower().endswith(".asf"))
    return [path.with_name(name) for name in names]


def read_amc(path: str | Path, fps: float | None = None, angles: Angles | None = None) -> Mocap:
    """Read an ``.amc`` and the ``.asf`` beside it, and work out where the joints are.

    Every joint is called as the bone that begins in it, the end of a bone ``<bone>_end``. Bones may stand in any
    order, and those without any values keep their rest pose. A last frame that lacks some is left out. Angles are in
    degrees or radians, as the files say, unless the motion shows the other.

    Args:
        path: the file.
        fps: frames a second, where the user states them; else the name does, or they are 120, or 120 over the step of
            the frames' numbers.
        angles: their unit, where the user states it; the rest pose has that of the skeleton's file.

    Raises:
        MotionError: naming file and line, when one of the two is missing or broken, or the frames are not in order.
    """
    path = Path(path)
    beside = find_asf(path)
    skeleton = _read_asf(beside)
    frames, step, degrees = _read_frames(path, skeleton)
    check_extent(f"AMC file {str(path)!r}", 2 * len(skeleton.bones), len(frames), path.stat().st_size)
    notes = [*skeleton.notes]
    notes += [] if _begins(path, beside) else [f"skeleton {beside.name}, the only one beside it"]
    missing, cut = _missing(path, skeleton, frames)
    if cut:
        frames = frames[:-1]
        notes.append("the last frame left out: the file ends within it")
    told = skeleton.degrees if degrees is None else degrees
    if angles is not None:
        told = angles == "degrees"
    elif _other_unit(skeleton, frames, told):
        notes.append(f"angles in {'radians' if told else 'degrees'} and not as stated, as the motion shows")
        told = not told
    if fps is None:
        last = _OF_HDM05.fullmatch(path.stem)
        try:
            stated = rates_in_name(path.stem)
        except MotionError as error:
            raise MotionError(f"AMC file {str(path)!r}: {error}") from None
        stated = stated or ([float(last[1])] if last and float(last[1]) in RATES else [])
        fps = stated[-1] if stated else _USUAL_FPS / step
        of_all = f" {_USUAL_FPS:g} and frames are numbered in steps of {step}" if step > 1 else ""
        notes.append(
            "fps from the file name"
            if stated
            else f"{fps:g} fps assumed, as CMU and HDM05 have{of_all} (else: plat motions convert --fps)"
        )
    if missing:
        notes.append(f"no values for {', '.join(missing[:5])}{' ...' if len(missing) > 5 else ''}: rest pose")
    return _posed(skeleton, frames, np.pi / 180 if told else 1.0, fps, tuple(notes))


def _lines(path: Path, kind: str) -> Iterator[tuple[int, list[str]]]:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise MotionError(f"{kind} file {str(path)!r}: cannot be read ({error})") from error
    try:
        refuse_foreign(data[:64], path.suffix.lower())
    except MotionError as error:
        raise MotionError(f"{kind} file {str(path)!r}: {error}") from None
    for number, line in enumerate(decoded(data).splitlines(), 1):
        words = line.split("#", 1)[0].replace("(", " ").replace(")", " ").split()
        if words:
            yield number, words


def _read_asf(path: Path) -> _Skeleton:
    bones = {"root": _Bone("root", dof=("tx", "ty", "tz", "rx", "ry", "rz"))}
    degrees, section, order = True, "", ""
    orientation = np.zeros(3)
    bone: _Bone | None = None
    where = f"ASF file {str(path)!r}, line "
    for number, words in _lines(path, "ASF"):
        key = words[0].lower()
        try:
            if key.startswith(":"):
                section = key
            elif section == ":units" and key == "angle":
                degrees = not words[1].lower().startswith("rad")
            elif section == ":root" and key == "order":
                bones["root"].dof = _freedom(words[1:])
            elif section == ":root" and key == "orientation":
                orientation = _three(words[1:4])
            elif section == ":root" and key == "axis":
                order = words[1].lower()
            elif section == ":bonedata" and key == "begin":
                bone = _Bone("")
            elif section == ":bonedata" and bone is not None:
                bone = _bone_line(bone, words, degrees)
                if bone.name and key == "end":
                    bones[bone.name] = bone
            elif section == ":hierarchy" and key not in ("begin", "end"):
                for child in words[1:]:
                    bones[child].parent = words[0]
        except (KeyError, ValueError, IndexError):
            raise MotionError(f"{where}{number}: {' '.join(words)[:60]!r} is not understood") from None
    lost = [name for name, one in bones.items() if name != "root" and one.parent not in bones]
    if len(bones) < 2 or lost:
        raise MotionError(f"ASF file {str(path)!r}: expected :bonedata and a :hierarchy of all bones; lost: {lost[:5]}")
    turns = "".join(what[1] for what in bones["root"].dof if what.startswith("r"))
    # programs differ in what they do with these, and CMU and HDM05 have none
    notes = ["the root's 'orientation' in the skeleton left out"] if orientation.any() else []
    if order and order != turns:
        notes.append(f"the root turns about {turns.upper()}, as its 'order' lists them, and not {order.upper()}")
    return _Skeleton(_parents_first(bones), degrees, tuple(notes))


def _bone_line(bone: _Bone, words: list[str], degrees: bool) -> _Bone:
    key = words[0].lower()
    if key == "name":
        bone.name = words[1]
    elif key == "direction":
        bone.direction = _three(words[1:4])
    elif key == "length":
        bone.length = float(words[1])
        if not math.isfinite(bone.length):
            raise ValueError(words[1])
    elif key == "axis":
        angles = _three(words[1:4]) * (np.pi / 180 if degrees else 1.0)
        bone.axis = _product(zip((words[4] if len(words) > 4 else "XYZ").lower(), angles[:, None], strict=True))[0]
    elif key == "dof":
        bone.dof = _freedom(words[1:])
    return bone


def _three(words: list[str]) -> np.ndarray:
    values = np.array([float(word) for word in words])
    if values.shape != (3,) or not np.isfinite(values).all():
        raise ValueError(words)
    return values


def _freedom(words: list[str]) -> tuple[str, ...]:
    freedom = tuple(word.lower() for word in words)
    if not set(freedom) <= _FREEDOM:
        raise ValueError(words)
    return freedom


def _parents_first(bones: dict[str, _Bone]) -> dict[str, _Bone]:
    ordered = {"root": bones["root"]}
    while len(ordered) < len(bones):
        more = {name: bone for name, bone in bones.items() if name not in ordered and bone.parent in ordered}
        if not more:
            raise MotionError("ASF: the hierarchy has a circle")
        ordered |= more
    return ordered


def _missing(path: Path, skeleton: _Skeleton, frames: list[dict[str, list[float]]]) -> tuple[list[str], bool]:
    """Return the bones without values, and whether the last frame lacks some that all others have.

    Raises:
        MotionError: where another frame lacks some.
    """
    moved = {name for name, bone in skeleton.bones.items() if bone.dof}
    seen = set().union(*frames)
    broken = [number for number, row in enumerate(frames, 1) if seen - row.keys()]
    cut = broken == [len(frames)] and len(frames) > 1
    if broken and not cut:
        lost = sorted(seen - frames[broken[0] - 1].keys())
        raise MotionError(
            f"AMC file {str(path)!r}: the {broken[0]}. frame lacks {', '.join(map(repr, lost[:3]))}, which others have"
        )
    return sorted(moved - seen), cut


def _read_frames(path: Path, skeleton: _Skeleton) -> tuple[list[dict[str, list[float]]], int, bool | None]:
    """Return bone to values for every frame, the step of their numbers, and whether the file says degrees."""
    frames: list[dict[str, list[float]]] = []
    numbers: list[int] = []
    degrees: bool | None = None
    where = f"AMC file {str(path)!r}, line "
    for number, words in _lines(path, "AMC"):
        if words[0].startswith(":"):
            degrees = {":degrees": True, ":radians": False}.get(words[0].lower(), degrees)
        elif len(words) == 1 and words[0].isdecimal():
            frames.append({})
            numbers.append(int(words[0]))
        else:
            bone = skeleton.bones.get(words[0])
            if bone is None or not frames:
                expected = "a bone of the skeleton" if frames else "a frame's number"
                raise MotionError(f"{where}{number}: {' '.join(words)[:60]!r}, expected {expected}")
            try:
                values = [float(word) for word in words[1:]]
            except ValueError:
                values = []
            if len(values) != len(bone.dof) or not all(map(math.isfinite, values)):
                raise MotionError(
                    f"{where}{number}: {' '.join(words)[:60]!r}, expected {counted(len(bone.dof), 'number')}"
                )
            frames[-1][words[0]] = values
    if not frames:
        raise MotionError(f"AMC file {str(path)!r}: no frames")
    if not any("root" in row for row in frames):
        raise MotionError(f"AMC file {str(path)!r}: no values of 'root'")
    if fault := numbering_fault(np.array(numbers, np.float64)):
        after, what = fault
        raise MotionError(f"AMC file {str(path)!r}: frame {numbers[after]} is followed by {numbers[after + 1]}: {what}")
    return frames, max(numbers[1] - numbers[0], 1) if len(numbers) > 1 else 1, degrees


def _other_unit(skeleton: _Skeleton, frames: list[dict[str, list[float]]], degrees: bool) -> bool:
    """Return whether angles are in radians for degrees, or in degrees for radians, by their size."""
    bones = skeleton.bones.items()
    turns = [(name, k) for name, bone in bones for k, what in enumerate(bone.dof) if what.startswith("r")]
    angles = np.array([[row[name][k] if name in row else 0.0 for name, k in turns] for row in frames])
    if not (may_be_radians(angles) if degrees else np.abs(angles).max(initial=0.0) > LARGEST_RADIANS):
        return False
    one, other = (_posed(skeleton, frames, unit, _USUAL_FPS, ()) for unit in (1.0, np.pi / 180))
    return reads_better(one.positions, other.positions, one.parents) == degrees


def _posed(
    skeleton: _Skeleton, frames: list[dict[str, list[float]]], radians: float, fps: float, notes: tuple[str, ...]
) -> Mocap:
    """Return where the joints are: a bone turns in its own axes, and points along its direction of the rest pose."""
    bones = list(skeleton.bones.values())
    names = [bone.name for bone in bones]
    begins: dict[str, np.ndarray] = {}
    ends: dict[str, np.ndarray] = {}
    turns: dict[str, np.ndarray] = {}
    for bone in bones:
        values = np.array([row.get(bone.name, [0.0] * len(bone.dof)) for row in frames]).reshape(len(frames), -1)
        moves = [(what[1], radians * values[:, k]) for k, what in enumerate(bone.dof) if what.startswith("r")]
        turn = bone.axis @ _product(moves, len(frames)) @ bone.axis.T
        if bone.parent:
            begins[bone.name], turns[bone.name] = ends[bone.parent], turns[bone.parent] @ turn
        else:
            place = np.zeros((len(frames), 3))
            for k, what in enumerate(bone.dof):
                if what.startswith("t"):
                    place[:, "xyz".index(what[1])] = values[:, k]
            begins[bone.name], turns[bone.name] = place, turn
        ends[bone.name] = begins[bone.name] + turns[bone.name] @ (bone.length * bone.direction)
    rest: dict[str, np.ndarray] = {}
    for bone in bones:
        rest[bone.name] = (rest[bone.parent] if bone.parent else np.zeros(3)) + bone.length * bone.direction
    starts = [rest[bone.parent] if bone.parent else np.zeros(3) for bone in bones]
    parents = [names.index(bone.parent) if bone.parent else -1 for bone in bones]
    return Mocap(
        names=(*names, *(f"{name}_end" for name in names[1:])),
        parents=(*parents, *range(1, len(names))),
        positions=np.stack([*begins.values(), *(ends[name] for name in names[1:])], 1),
        rotations=np.stack([*turns.values(), *(turns[name] for name in names[1:])], 1),
        fps=fps,
        rest=np.array([*starts, *(rest[name] for name in names[1:])]),
        notes=notes,
    )


def _product(moves: Iterable[tuple[str, np.ndarray]], count: int = 1) -> np.ndarray:
    """Return the rotations ``[T, 3, 3]`` that turn about fixed axes one after the other."""
    rotation: np.ndarray = np.broadcast_to(np.eye(3), (count, 3, 3))
    for axis, angle in moves:
        rotation = axis_rotation("xyz".index(axis), angle) @ rotation
    return rotation
