"""Keyframes of MuJoCo's model files: ``<key>`` elements, read and written.

Source: MuJoCo's XML reference, ``keyframe``. A key's positions are those of all joints in the model's order, with seven
numbers for a free joint. Angles are in radians whatever the compiler settings.
"""

from __future__ import annotations

import os
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING
from xml.sax.saxutils import quoteattr

import numpy as np

from plat.errors import KeyframeError
from plat.files import replace_file
from plat.json_file import short
from plat.keyframes.keyframe import Keyframe, check_whole
from plat.motions.formats.spellings import match_joint

if TYPE_CHECKING:
    from plat.robots.robot import Robot

__all__ = ["read_mjcf_keys", "write_mjcf_keys"]

_MAX_BYTES = 16 << 20
_LONGEST_NAME = 80
# letters that no XML file can have
_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_WIDTHS = {"free": 7, "ball": 4, "slide": 1, "hinge": 1}


def read_mjcf_keys(path: Path, robot: Robot) -> list[Keyframe]:
    """Return the keys of an MJCF file, at their own times.

    Joints are matched by name where the file, or one that it includes, has the robot's bodies; joints of other things
    are left out. Else the positions stand in the robot's order.

    Raises:
        KeyframeError: naming file and key, when the file is broken, has no keys, or they are of another robot.
    """
    where = f"MJCF file {str(path)!r}"
    root = _model(path, where, set())
    columns = _columns(root, robot, where)
    keyframes = []
    for number, key in enumerate(root.findall("./keyframe/key")):
        name = key.get("name")
        label = f"{where}: key {name if name and len(name) <= _LONGEST_NAME else number}"
        if key.get("qpos") is None:
            raise KeyframeError(f"{label} has no 'qpos', expected the positions of all joints")
        qpos = _numbers(key.get("qpos", ""), label)
        if columns is None and len(qpos) != 7 + len(robot.joint_names):
            raise KeyframeError(
                f"{label} has {len(qpos)} positions, expected {7 + len(robot.joint_names)} for {robot.name!r}"
            )
        if columns is not None and len(qpos) <= max(columns):
            raise KeyframeError(f"{label} has {len(qpos)} positions, fewer than the joints of the file")
        time, *more = _numbers(key.get("time", "0"), label) or [0.0]
        if more:
            raise KeyframeError(f"{label} has {1 + len(more)} times, expected one")
        picked = qpos if columns is None else [qpos[column] for column in columns]
        keyframes.append(Keyframe.from_qpos(time, np.array(picked), name))
    if not keyframes:
        raise KeyframeError(f"{where}: no keys, expected <keyframe> with at least one <key>")
    return keyframes


def write_mjcf_keys(path: Path, robot: Robot, keyframes: Sequence[Keyframe]) -> None:
    """Write keyframes as an MJCF file to include in the robot's model.

    MuJoCo takes a name once: those that come again are numbered.

    Raises:
        KeyframeError: for a partial keyframe, or when the disk does not take the file.
    """
    check_whole(keyframes, f"MJCF file {str(path)!r}", "MJCF keys")
    said = _NOT_XML.sub("?", f"keyframes of {robot.name}, joints in the order: {' '.join(robot.joint_names)}")
    # XML has no two hyphens in a comment
    lines = [f"<!-- {re.sub('-(?=-)', '- ', said)} -->", "<mujoco>", "  <keyframe>"]
    names = _different([keyframe.name or f"key{number}" for number, keyframe in enumerate(keyframes)])
    for keyframe, name in zip(keyframes, names, strict=True):
        qpos = " ".join(f"{value:.9g}" for value in keyframe.qpos)
        lines.append(f'    <key name={quoteattr(name)} time="{keyframe.time:.9g}" qpos="{qpos}"/>')
    lines += ["  </keyframe>", "</mujoco>", ""]
    try:
        replace_file(path, lambda part: part.write_text("\n".join(lines), encoding="utf-8"))
    except OSError as error:
        raise KeyframeError(f"MJCF file {str(path)!r} could not be written ({error.strerror or error})") from error


def _different(names: Sequence[str]) -> list[str]:
    """Return names with a number behind those that came before, and without letters that XML has not."""
    names = [_NOT_XML.sub("?", name) for name in names]
    found: list[str] = []
    for name in names:
        new, number = name, 1
        while new in found or (number > 1 and new in names):
            number += 1
            new = f"{name} {number}"
        found.append(new)
    return found


def _model(path: Path, where: str, seen: set[str], depth: int = 0) -> ElementTree.Element:
    """Return the root element of a file, with the content of the files that it includes in their places.

    MuJoCo takes each of them once.
    """
    seen.add(os.path.realpath(path))
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise KeyframeError(f"{where}: larger than {_MAX_BYTES >> 20} MiB")
        text = path.read_bytes()
        if b"<!ENTITY" in text:
            raise KeyframeError(f"{where}: it defines entities, which no MJCF needs")
        root = ElementTree.fromstring(text)
    except OSError as error:
        raise KeyframeError(f"{where}: cannot be read ({error})") from None
    except ElementTree.ParseError as error:
        raise KeyframeError(f"{where}: not readable XML ({error})") from None
    if root.tag not in ("mujoco", "mujocoinclude"):
        raise KeyframeError(f"{where}: begins with <{root.tag[:_LONGEST_NAME]}>, expected <mujoco>")
    for parent in list(root.iter()):
        parts: list[ElementTree.Element] = []
        for part in parent:
            other = path.parent / part.get("file", "") if part.tag == "include" else None
            if other is None:
                parts.append(part)
            # false for a name that is too long, too
            elif depth < 4 and os.path.isfile(other) and os.path.realpath(other) not in seen:
                parts += _model(other, where, seen, depth + 1)
        parent[:] = parts
    return root


def _columns(root: ElementTree.Element, robot: Robot, where: str) -> list[int] | None:
    """Return which positions are the root's and the robot's joints', in the robot's order; None without any joints."""
    found: dict[str, int] = {}
    free, start = None, 0
    for thing in root.findall("./worldbody/*"):
        own = None
        for joint in _joints(thing):
            kind = "free" if joint.tag == "freejoint" else joint.get("type", "hinge")
            if kind not in _WIDTHS or joint.tag not in ("joint", "freejoint"):
                raise KeyframeError(f"{where}: a joint of type {short(kind)}, expected one of {', '.join(_WIDTHS)}")
            name = match_joint(joint.get("name", ""), robot) if kind == "hinge" else None
            if kind == "free":
                own = start
            if name is not None:
                found[name], free = start, own  # other things may be free as well
            start += _WIDTHS[kind]
    if start == 0:
        return None
    missing = [name for name in robot.joint_names if name not in found]
    if missing or free is None:
        lacks = f"the joints {missing[:4]}" if missing else "a free joint of the root"
        raise KeyframeError(f"{where}: lacks {lacks}, expected the model of {robot.name!r}")
    return [*range(free, free + 7), *(found[name] for name in robot.joint_names)]


def _joints(thing: ElementTree.Element) -> Iterator[ElementTree.Element]:
    """Yield joints in MuJoCo's order: a body's own come before those of its children, wherever they stand in it."""
    bodies = [thing]
    while bodies:
        body = bodies.pop(0)
        waiting, children = [*body], []
        while waiting:
            part = waiting.pop(0)
            if part.tag.endswith("joint"):
                yield part
            elif part.tag == "body":
                children.append(part)
            else:  # a frame, whose content is the body's own
                waiting[:0] = part
        bodies[:0] = children


def _numbers(text: str, label: str) -> list[float]:
    try:
        return [float(word) for word in text.split()]
    except ValueError as error:
        raise KeyframeError(f"{label}: {str(error)[:_LONGEST_NAME]}") from None
