"""Constraints of Kimodo and ARDY: keyframes of the whole body on the robot, read and written.

Source: nv-tlabs/kimodo, ``docs/source/user_guide/constraints.md``. The file is a list of objects. Those of type
``fullbody`` hold local rotations as axis times angle, and positions of the root, y up, at 30 frames a second.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from plat.errors import KeyframeError
from plat.files import replace_file
from plat.json_file import read_json
from plat.keyframes.keyframe import Keyframe, check_whole
from plat.motions.formats.links import link_count, links_of_qpos, qpos_of_links, world_rotations
from plat.rotations_np import quat_from_rotvec

if TYPE_CHECKING:
    from plat.robots.robot import Robot

__all__ = ["constraints_of", "read_constraints", "write_constraints"]

# Angles up to this far beyond a joint's limits are clipped (rad): rotations of a generated motion are not exact.
_SLACK = 0.35


def read_constraints(path: Path, robot: Robot, fps: float = 30.0) -> tuple[list[Keyframe], list[str]]:
    """Return the whole-body keyframes of a file of constraints in the order of their times, and what was left out.

    Angles that are a little beyond a joint's limits are clipped.

    Args:
        path: the file.
        robot: whose keyframes they are.
        fps: of the frames that it counts.

    Raises:
        KeyframeError: naming file and constraint, when it is broken, of another skeleton, or has no whole poses.
    """
    return constraints_of(read_json(path, KeyframeError, f"constraints {str(path)!r}"), path, robot, fps)


def constraints_of(content: Any, path: Path, robot: Robot, fps: float = 30.0) -> tuple[list[Keyframe], list[str]]:
    """Return the same of a file's JSON; ``path`` is for messages."""
    where = f"constraints {str(path)!r}"
    if not isinstance(content, list) or not all(isinstance(entry, dict) for entry in content):
        raise KeyframeError(f"{where}: expected a list of objects, each with a 'type'")
    keyframes: list[Keyframe] = []
    left_out: list[str] = []
    for number, entry in enumerate(content):
        if entry.get("type") == "fullbody":
            keyframes += _poses(entry, f"{where}: constraint {number}", robot, fps)
        else:
            left_out.append(f"constraint {number} of type {str(entry.get('type'))[:40]!r}")
    if not keyframes:
        raise KeyframeError(f"{where}: no constraint of type 'fullbody', expected at least one")
    return sorted(keyframes, key=lambda keyframe: keyframe.time), left_out


def write_constraints(path: Path, robot: Robot, keyframes: Sequence[Keyframe], fps: float = 30.0) -> None:
    """Write keyframes as one constraint of the whole body.

    Args:
        path: the file, which is replaced.
        robot: whose keyframes they are.
        keyframes: whole poses, on the nearest frame each.
        fps: of the frames that the file counts.

    Raises:
        KeyframeError: for a partial keyframe, two on one frame, or when the disk does not take the file.
    """
    check_whole(keyframes, f"constraints {str(path)!r}", "these constraints")
    frames = [round(keyframe.time * fps) for keyframe in keyframes]
    if len(set(frames)) != len(frames):
        raise KeyframeError(f"constraints {str(path)!r}: two keyframes on one frame of {fps:g} a second")
    local, root_pos = links_of_qpos(np.stack([keyframe.qpos for keyframe in keyframes]), robot)
    local = local * np.where(local[..., :1] < 0, -1.0, 1.0)
    length = np.linalg.norm(local[..., 1:], axis=-1, keepdims=True)
    rotvec = local[..., 1:] / np.maximum(length, 1e-12) * 2 * np.arctan2(length, local[..., :1])
    constraint = {
        "type": "fullbody",
        "frame_indices": frames,
        "local_joints_rot": rotvec.round(7).tolist(),
        "root_positions": root_pos.round(7).tolist(),
        "smooth_root_2d": root_pos[:, [0, 2]].round(7).tolist(),
    }
    try:
        replace_file(path, lambda part: part.write_text(json.dumps([constraint]) + "\n", encoding="utf-8"))
    except OSError as error:
        raise KeyframeError(f"constraints {str(path)!r} could not be written ({error.strerror or error})") from error


def _poses(entry: dict[str, Any], label: str, robot: Robot, fps: float) -> list[Keyframe]:
    arrays = {name: _array(entry, name, label) for name in ("frame_indices", "local_joints_rot", "root_positions")}
    frames, rotvec, root_pos = arrays.values()
    if frames.ndim != 1:
        raise KeyframeError(f"{label}: 'frame_indices' has shape {frames.shape}, expected one number for each pose")
    count, links = len(frames), link_count(robot)
    if rotvec.shape != (count, links, 3) or root_pos.shape != (count, 3):
        raise KeyframeError(
            f"{label}: 'local_joints_rot' has shape {rotvec.shape} and 'root_positions' {root_pos.shape}, expected "
            f"{(count, links, 3)} and {(count, 3)}, the links of {robot.name!r}"
        )
    qpos = qpos_of_links(world_rotations(quat_from_rotvec(rotvec), robot), root_pos, robot)
    low, high = np.asarray(robot.joint_range).T
    clipped = qpos[:, 7:].clip(low, high)
    if (beyond := float(np.abs(clipped - qpos[:, 7:]).max(initial=0))) > _SLACK:
        raise KeyframeError(f"{label}: {beyond:.2f} rad beyond a joint's limits; is it of {robot.name!r}?")
    qpos[:, 7:] = clipped
    return [Keyframe.from_qpos(float(frame) / fps, pose) for frame, pose in zip(frames, qpos, strict=True)]


def _array(entry: dict[str, Any], name: str, label: str) -> np.ndarray:
    try:
        array = np.array(entry[name], dtype=np.float64)
    except KeyError:
        raise KeyframeError(f"{label}: no {name!r}") from None
    except (ValueError, TypeError, OverflowError):
        raise KeyframeError(f"{label}: {name!r} is no array of numbers") from None
    if not np.isfinite(array).all() or array.size == 0:
        raise KeyframeError(f"{label}: {name!r} is empty or holds a value that is not finite")
    return array
