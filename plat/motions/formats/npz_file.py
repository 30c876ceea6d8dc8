"""NumPy archives: plat's own, those of trackers and of retargeters."""

import contextlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from plat.errors import MotionError
from plat.json_file import parse_json, read_json, short
from plat.motions.clip import ASSUMED_RATE, MotionClip
from plat.motions.formats.archive import read_archive, states_rate, take_rate, take_rates
from plat.motions.formats.clock import contradicting_name, evenly_timed, stated_rates, times_of_fields
from plat.motions.formats.columns import is_pose, place_first
from plat.motions.formats.common import (
    MotionFile,
    QuatOrder,
    ReadOptions,
    arrange_joints,
    make_clip,
    number,
    of_motion,
    other_angles,
    strings,
)
from plat.motions.formats.foreign import refuse_human_body, refuse_old_arrays
from plat.motions.formats.joint_columns import is_root, listed_joints, texts
from plat.motions.formats.joint_orders import in_robot_order
from plat.motions.formats.kimodo import KIMODO_FPS, has_links, read_kimodo
from plat.motions.formats.manifest import stated_above
from plat.motions.formats.pace import rate_of_file
from plat.motions.formats.plat_file import ASSUMED, RESERVED, is_marked
from plat.motions.formats.quaternion_order import settle_joint_order, settle_quat_order
from plat.motions.formats.spellings import array_meaning
from plat.motions.formats.tracker_file import read_tracker
from plat.motions.formats.unnamed_joints import without_wrists
from plat.words import counted

__all__ = ["ALIASES", "read_npz"]

ALIASES = {
    # NVIDIA's AMP of Isaac Lab
    "dof_positions": "joint_pos",
    "dof_names": "joint_names",
    "body_positions": "body_pos_w",
    "body_rotations": "body_quat_w",
    # SOMA on the G1
    "robot_joint_pos": "joint_pos",
    "robot_joint_names": "joint_names",
    "robot_root_pos": "root_pos",
    "robot_root_quat": "root_quat",
    "robot_body_names": "body_names",
    "robot_body_pos": "body_pos_w",
    "robot_body_quat": "body_quat_w",
    # HoloMotion
    "ref_dof_pos": "joint_pos",
    "ref_global_translation": "body_pos_w",
    "ref_global_rotation_quat": "body_quat_w",
    "global_translation": "body_pos_w",
    "global_rotation_quat": "body_quat_w",
    # GMR and others as an archive
    "dof_pos": "joint_pos",
    "root_rot": "root_quat",
    "root_trans": "root_pos",
    "root_trans_offset": "root_pos",
    "base_pos": "root_pos",
    "root_position": "root_pos",
    "base_quat": "root_quat",
    "root_orientation": "root_quat",
    "root_quaternion": "root_quat",
    "dof": "joint_pos",
    "joint_positions": "joint_pos",
}
"""Arrays of a robot's motion by another name, with the name that plat knows them by."""
# what loco-mujoco writes beside the motion: its model, and what follows from the motion
_LOCO = frozenset(
    (
        *("split_points", "qvel", "xpos", "xquat", "cvel", "subtree_com", "site_xpos", "site_xmat", "body_names"),
        *("site_names", "metadata", "njnt", "jnt_type", "nbody", "body_rootid", "body_weldid", "body_mocapid"),
        *("body_pos", "body_quat", "body_ipos", "body_iquat", "nsite", "site_bodyid", "site_pos", "site_quat"),
    )
)
# columns of arrays by these names
_WIDTHS = {"root_pos": 3, "root_quat": 4}
# what HoloMotion calls the frame rate in its metadata
_META_RATE = "motion_fps"
# columns of an object behind the robot's
_BESIDE = 7
# a clip has so many frames
_LEAST_FRAMES = 2
# clips of an archive that are looked at before all are
_EXAMINED = 10
# what clips are called where one is called qpos
_NUMBERED = re.compile(r"qpos(_\d+)?")


def read_npz(path: Path, options: ReadOptions) -> MotionFile:
    """Read ``.npz``: with ``joint_pos`` a tracker's file, else plat's own or a retargeter's, with ``qpos``.

    A ``meta.json`` beside it, as HDMI writes it, gives what the archive does not say.
    """
    stored = read_archive(path)
    if is_marked(stored):
        return _own(path, stored, options)
    arrays, notes = _known(stored)
    _rename(arrays)
    refuse_human_body(arrays)
    refuse_old_arrays(stored)
    if arrays.get("root_pos") is not None and "root_rot" in stored:
        arrays.setdefault("scalar_first", np.array(False))  # as GMR has it
    notes += [*_add_metadata(arrays), *_add_meta(path, arrays, options)]
    if not states_rate(arrays) and (stated := stated_above(path, arrays)):
        arrays = {**stated, **arrays}
        notes.append(f"{', '.join(stated)} from manifest.json")
    names = _names(arrays, options)
    links = has_links(arrays, options.robot)
    if links and options.fps is None and not states_rate(arrays) and not stated_rates(path, []):
        arrays["fps"] = np.array(KIMODO_FPS)
        notes.append("fps as Kimodo writes it")
    times = [*times_of_fields(arrays).values()][:1] if options.fps is None else []
    rates = take_rates(arrays, options.fps, path)
    fps = rates[0][0]
    if links:
        file = read_kimodo(path, arrays, fps, options)
    elif "joint_pos" in arrays:
        file = read_tracker(path, arrays, fps, names, options)
        qpos = arrays.get("qpos")
        if qpos is not None and qpos.ndim == 2 and other_angles(file.clips[0].qpos[:, 7:], qpos[:, 7:]):
            notes.append("'qpos' left out, which has another motion than 'joint_pos'")
    else:
        file = _clips(path, arrays, fps, names, options)
    clips = file.clips
    fps, told = rate_of_file(path, rates, _some(clips), options.robot)
    clips = [replace(clip, fps=fps) for clip in clips]
    clips = [evenly_timed(clip, times[0]) for clip in clips] if times else clips
    return replace(file, clips=clips, notes=(*notes, *told, *file.notes))


def _names(arrays: dict[str, np.ndarray], options: ReadOptions) -> list[str] | None:
    """Take the names of the joints out of the arrays; those of another array only where none is called so."""
    if "joint_names" in arrays:
        return strings(arrays.pop("joint_names"), "joint_names")
    widths = {array.shape[-1] for array in arrays.values() if array.ndim > 1 and array.dtype.kind in "fiu"}
    names = listed_joints(arrays, {count - off for count in widths for off in (0, 7)}, options.robot)
    for name in [name for name, array in arrays.items() if names and texts(array) == names]:
        del arrays[name]
    return names


def _own(path: Path, arrays: dict[str, np.ndarray], options: ReadOptions) -> MotionFile:
    """Read an archive that is marked as plat's own: its clips have any names, and these are the clips' names."""
    stated = take_rate(arrays, options.fps)
    fps = stated[0]
    names = strings(arrays["joint_names"], "joint_names") if "joint_names" in arrays else None
    assumed = set(strings(arrays.get(ASSUMED, []), ASSUMED)) if options.fps is None else set()
    arrays = {name: array for name, array in arrays.items() if name not in RESERVED}
    widths = _widths(names, options)
    fitting = {name: array for name, array in arrays.items() if _is_motion(array, widths)}
    file = _read(path, arrays, fitting, {name: name for name in fitting}, fps, names, options, marked=True)
    named = contradicting_name(path, [stated])
    if len(named) == 1 and assumed >= {clip.name for clip in file.clips}:  # what a name states beats what was assumed
        stated, assumed = named[0], set()
    fps, told = rate_of_file(path, [stated], _some(file.clips), options.robot)
    clips = [
        replace(clip, fps=fps, notes=((ASSUMED_RATE,) * (clip.name in assumed) + clip.notes)) for clip in file.clips
    ]
    return replace(file, clips=clips, notes=(*told, *file.notes), marked=True)


def _some(clips: Sequence[MotionClip]) -> Sequence[MotionClip]:
    """Return some clips of a file, from its first to its last."""
    return clips[:: max(1, len(clips) // _EXAMINED)]


def _known(stored: Mapping[str, np.ndarray]) -> tuple[dict[str, np.ndarray], list[str]]:
    """Return arrays by the names that plat knows them by, and notes on those that another one of that meaning beats."""
    listed = list(ALIASES)
    arrays: dict[str, np.ndarray] = {}
    notes: list[str] = []
    for name in sorted(stored, key=lambda name: listed.index(name) if name in ALIASES else -1):
        known = ALIASES.get(name, name)
        if known not in arrays:
            arrays[known] = stored[name]
        elif not np.array_equal(arrays[known], stored[name]):
            notes.append(f"array {short(name)} left out, which another one is read for")
    return arrays, notes


def _rename(arrays: dict[str, np.ndarray]) -> None:
    """Give root and joints the names that plat knows them by, where their own names and shapes say what they are."""
    for name in list(arrays):
        known, array = array_meaning(name), arrays[name]
        if not known or known in arrays or array.ndim != 2 or array.shape[1] != _WIDTHS.get(known, array.shape[1]):
            continue
        arrays[known] = arrays.pop(name)
        if known == "root_quat" and "xyzw" in name.lower():
            arrays.setdefault("scalar_first", np.array(False))


def _add_metadata(arrays: dict[str, np.ndarray]) -> list[str]:
    """Add the frame rate that an array ``metadata`` of JSON says, as HoloMotion writes it."""
    told = arrays.get("metadata")
    if told is None or told.size != 1 or told.dtype.kind not in "SU":
        return []
    alone = not states_rate(arrays)
    with contextlib.suppress(MotionError):  # the rate is missed anyhow where it is in no text that can be read
        meta = parse_json(strings(told, "metadata")[0].encode(), MotionError, "'metadata'")
        if isinstance(meta, dict) and type(meta.get(_META_RATE)) in (int, float):
            arrays[_META_RATE] = np.array(meta[_META_RATE])
            return [f"fps from {_META_RATE!r} of its metadata"] if alone else []
    return []


def _add_meta(path: Path, arrays: dict[str, np.ndarray], options: ReadOptions) -> list[str]:
    """Add what a ``meta.json`` beside the archive says and the archive does not."""
    beside = path.with_name("meta.json")
    if not beside.is_file():
        return []
    try:
        meta: Any = read_json(beside, MotionError, "the 'meta.json' beside it")
    except MotionError:
        if states_rate(arrays):  # any data set may have such a file, and this archive does not need it
            return ["the 'meta.json' beside it left out: it cannot be read"]
        raise
    if not isinstance(meta, dict):
        return []
    added = []
    for name in ("fps", "joint_names", "body_names"):
        if name in meta and name not in arrays:
            value = meta[name]
            fits = isinstance(value, list) and all(isinstance(entry, str) for entry in value)
            if not (type(value) in (int, float) if name == "fps" else fits):
                expected = "a number" if name == "fps" else "a list of names"
                raise MotionError(f"the 'meta.json' beside it: {name!r} is {short(value)}, expected {expected}")
            arrays[name] = np.array(value)
            added.append(name)
    conflicts = type(meta.get("fps")) in (int, float) and "fps" not in added and options.fps is None
    if conflicts and abs(number(arrays["fps"], "fps") - number(meta["fps"], "fps")) > 0.5:
        raise MotionError(
            f"it states {number(arrays['fps'], 'fps'):g} frames a second and the 'meta.json' beside it "
            f"{number(meta['fps'], 'fps'):g}; state which: plat motions convert --fps"
        )
    return [f"{', '.join(added)} from meta.json"] if added else []


def _clips(
    path: Path, arrays: dict[str, np.ndarray], fps: float, names: list[str] | None, options: ReadOptions
) -> MotionFile:
    """One array a clip, ``[T, 7 + J]``, named by the clip; a clip called ``qpos`` is named by the file.

    Where there is a ``qpos``, the clips are this and ``qpos_1``, ``qpos_2``, ... Other arrays of its width are none.
    """
    widths = _widths(names, options)
    fitting = {name: array for name, array in arrays.items() if _is_motion(array, widths)}
    if "qpos" in arrays and arrays["qpos"].ndim == 3:
        fitting = _of_batch(arrays["qpos"])
    elif "qpos" in fitting:
        fitting = {name: array for name, array in fitting.items() if _NUMBERED.fullmatch(name)}
    elif "qpos" in arrays:
        fitting = {"qpos": arrays["qpos"]}
    known = _LOCO if "split_points" in arrays else frozenset()
    beside = {name: array for name, array in arrays.items() if name not in known and name != "qpos"}
    if "split_points" in arrays and list(fitting) == ["qpos"] and _is_motion(fitting["qpos"], widths):
        fitting = _split(fitting["qpos"], arrays["split_points"])
    labels = {name: name.replace("qpos", path.stem, 1) if name.startswith("qpos") else name for name in fitting}
    return _read(path, beside, fitting, labels, fps, names, options)


def _read(
    path: Path,
    arrays: Mapping[str, np.ndarray],
    fitting: Mapping[str, np.ndarray],
    labels: Mapping[str, str],
    fps: float,
    names: list[str] | None,
    options: ReadOptions,
    marked: bool = False,
) -> MotionFile:
    """Read clips from arrays.

    Args:
        path: of the file.
        arrays: that it has.
        fitting: those of them that are clips.
        labels: names of the clips, by the names of their arrays.
        fps: frames a second.
        names: of the joints, where the file has them.
        options: what the user says.
        marked: whether plat wrote them.
    """
    if not fitting:
        for name, array in arrays.items():
            if name != "body_pos_w" and array.ndim == 3 and array.shape[1] > 1 and array.shape[2] == len("xyz"):
                raise MotionError(
                    f"{name!r} has shape {array.shape} and is no robot's motion; joint positions of a human are read "
                    "as 'joints' with the names of these joints beside them ('joint_names', toes among them), or "
                    "without names of the SMPL family (22 joints and more)"
                )
        told = ", ".join(f"{name!r} {array.shape}" for name, array in list(arrays.items())[:6]) or "nothing else"
        for name, qpos in list(arrays.items())[:1] if len(arrays) == 1 else []:
            MotionClip(name, qpos, fps).checked(options.robot)  # says what is wrong
        width = _widths(names, options)[0]
        raise MotionError(f"no clips, expected one array (frames, {width}) each; it has {told}")
    left_out = [name for name in arrays if name not in fitting]
    empty = [name for name, array in fitting.items() if array.ndim == 2 and len(array) < _LEAST_FRAMES]
    if empty and len(empty) == len(fitting):
        MotionClip(empty[0], fitting[empty[0]], fps).checked(options.robot)  # says what is wrong
    fitting = {name: array for name, array in fitting.items() if name not in empty}
    # a file has one convention: where some of its clips raise no doubt, the others are not looked at
    some = [] if marked else [*fitting][:: max(1, len(fitting) // _EXAMINED)]
    looked_at: dict[str, MotionClip] = {}
    for name in some:
        with contextlib.suppress(MotionError):
            looked_at[name] = _clip(labels[name], name, fitting[name], fps, names, options)
    doubtful = len(looked_at) < len(some) or any(clip.notes for clip in looked_at.values())
    clips, broken = [], []
    for name, qpos in fitting.items():
        try:
            found = looked_at.get(name) or _clip(labels[name], name, qpos, fps, names, options, doubtful, marked)
            clips.append(found)
        except MotionError as error:
            broken.append(of_motion(labels[name], error) if len(fitting) > 1 else error)
    if not clips:
        raise broken[0]
    notes = [f"{counted(len(left_out), 'other array')} left out ({', '.join(left_out[:3])})"] if left_out else []
    notes += [f"left out, with less than {_LEAST_FRAMES} frames: {', '.join(empty[:3])}"] if empty else []
    return MotionFile(path, "plat npz", clips, tuple(notes), broken=tuple(broken))


def _of_batch(qpos: np.ndarray) -> dict[str, np.ndarray]:
    """Return the motions of a batch ``[N, T, 7 + J]`` or ``[T, 1, 7 + J]``."""
    if qpos.shape[1] == 1:
        qpos = qpos.swapaxes(0, 1)
    return {"qpos" if len(qpos) == 1 else f"qpos_{number}": motion for number, motion in enumerate(qpos)}


def _split(qpos: np.ndarray, points: np.ndarray) -> dict[str, np.ndarray]:
    """Return the motions that stand one behind the other, by the first frame of each and the end of the last."""
    ends = [int(point) for point in points.ravel()]
    if ends != sorted(set(ends)) or len(ends) < 2 or ends[0] != 0 or ends[-1] != len(qpos):
        raise MotionError(f"'split_points' is {ends[:6]}, expected rising numbers from 0 to the {len(qpos)} frames")
    if len(ends) == 2:
        return {"qpos": qpos}
    return {f"qpos_{number}": qpos[start:end] for number, (start, end) in enumerate(pairwise(ends))}


def _clip(
    label: str,
    field: str,
    qpos: np.ndarray,
    fps: float,
    names: list[str] | None,
    options: ReadOptions,
    doubtful: bool = True,
    marked: bool = False,
) -> MotionClip:
    robot = options.robot
    full, beside = 7 + robot.num_joints, 7 + robot.num_joints + _BESIDE
    notes = []
    of_robot = names is None or len(names) <= robot.num_joints + 1
    if qpos.ndim == 2 and qpos.shape[1] == beside and qpos.dtype.kind in "fiu" and of_robot:
        if not (is_pose(place_first(qpos[:, full:])[0]) or (qpos[:, full:] == qpos[0, full:]).all()):
            # such as a hand, whose joints may stand among the robot's
            raise MotionError(
                f"{field!r} has {beside} columns and the last {_BESIDE} are no pose of an object (place and unit "
                f"quaternion); expected {full} (root xyz, quaternion wxyz, {robot.num_joints} joints), or 'joint_names'"
            )
        qpos = qpos[:, :full]
        notes.append("the last 7 columns left out (an object)")
    if qpos.ndim != 2 or qpos.dtype.kind not in "fiu" or qpos.shape[1] not in _widths(names, options):
        MotionClip(field, qpos, fps).checked(robot)  # says what is wrong
    joint_pos, more = arrange_joints(qpos[:, 7:], names, robot, field)
    if not marked:
        qpos, told = place_first(qpos)
        notes += told

    def read(joints: np.ndarray, order: QuatOrder, doubts: Sequence[str] = ()) -> MotionClip:
        told = (*doubts, *notes, *more)
        place, quat, fields = qpos[:, :3], qpos[:, 3:7], (field, field)
        return make_clip(label, place, quat, joints, fps, options, order, fields, told, marked=marked)

    stated = options.quat_order or "wxyz"
    if not doubtful:
        return read(joint_pos, stated)
    if names is None and joint_pos.shape[1] == qpos.shape[1] - 7:
        listed, found = settle_joint_order(joint_pos, lambda joints: read(joints, stated).qpos, options, stated)
        joint_pos, more = in_robot_order(joint_pos, listed, robot), [*more, *found]
    if options.quat_order is not None:
        return read(joint_pos, stated)
    order, doubts = settle_quat_order(lambda order: read(joint_pos, order).qpos, fps, options.soles, stated)
    return read(joint_pos, order, doubts)


def _widths(names: list[str] | None, options: ReadOptions) -> tuple[int, ...]:
    robot = options.robot
    joints = (
        robot.num_joints,
        len(without_wrists(robot)),
        *([len(names)] if names else []),
        *([len(names) - 1] if names and any(map(is_root, names)) else []),  # the root has a name in some, and no angle
    )
    return (*(7 + count for count in joints), 7 + robot.num_joints + _BESIDE)


def _is_motion(array: np.ndarray, widths: tuple[int, ...]) -> bool:
    return array.ndim == 2 and array.dtype.kind in "fiu" and array.shape[1] in widths
