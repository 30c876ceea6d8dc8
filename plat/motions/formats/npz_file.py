"""NumPy archives: plat's own, and those of BeyondMimic, mjlab and holosoma."""

import math
import zipfile
from io import BytesIO
from pathlib import Path

import numpy as np
import torch

from plat.errors import MotionError
from plat.motions.clip import MotionClip
from plat.motions.formats.common import MotionFile, ReadOptions, arrange_joints, make_clip, number, strings
from plat.motions.formats.decompress import size_limit
from plat.motions.formats.quaternion_order import doubt_quat_order
from plat.robots.kinematics import ForwardKinematics
from plat.robots.robot import Robot

__all__ = ["read_npz"]

# Bodies that a tracker's file records as they are (m): its robot may differ from ours by some millimetres.
_SAME_PLACE = 0.01
_CHECKED_FRAMES = 50


def read_npz(path: Path, options: ReadOptions) -> MotionFile:
    """Read ``.npz``: with ``joint_pos`` a tracker's file, else plat's own."""
    arrays = _arrays(path)
    if "fps" not in arrays and options.fps is None:
        raise MotionError("no array 'fps', expected the frames a second")
    stated = arrays.pop("fps", None)
    fps = number(stated, "fps") if options.fps is None else options.fps
    names = strings(arrays.pop("joint_names"), "joint_names") if "joint_names" in arrays else None
    if "joint_pos" in arrays:
        return _tracker_file(path, arrays, fps, names, options)
    return _plat_file(path, arrays, fps, names, options)


def _plat_file(
    path: Path, arrays: dict[str, np.ndarray], fps: float, names: list[str] | None, options: ReadOptions
) -> MotionFile:
    """One array a clip, ``[T, 7 + J]``, named by the clip; a clip called ``qpos`` is named by the file."""
    robot = options.robot
    if not arrays:
        raise MotionError(f"no clips, expected one array (frames, {7 + robot.num_joints}) each")
    clips = []
    notes: list[str] = []
    for name, qpos in arrays.items():
        if qpos.ndim != 2 or qpos.shape[1] != 7 + robot.num_joints:
            MotionClip(name, qpos, fps).checked(robot)  # says what is wrong
        joint_pos, notes = arrange_joints(qpos[:, 7:], names, robot, name)
        label = path.stem if name == "qpos" else name
        order = options.quat_order or "wxyz"
        clips.append(make_clip(label, qpos[:, :3], qpos[:, 3:7], joint_pos, fps, robot, order, (name, name)))
    return MotionFile(path, "plat npz", clips, tuple(notes))


def _tracker_file(
    path: Path, arrays: dict[str, np.ndarray], fps: float, names: list[str] | None, options: ReadOptions
) -> MotionFile:
    """``joint_pos`` with the joints, or with root position, quaternion and joints, and body poses in the world."""
    robot, joint_pos = options.robot, arrays["joint_pos"]
    if joint_pos.ndim != 2:
        raise MotionError(f"'joint_pos' has shape {joint_pos.shape}, expected (frames, joints)")
    if joint_pos.shape[1] == 7 + robot.num_joints:
        root_pos, root_quat, joint_pos = joint_pos[:, :3], joint_pos[:, 3:7], joint_pos[:, 7:]
        fields = ("joint_pos[:, :3]", "joint_pos[:, 3:7]")
    else:
        for name, width in (("body_pos_w", 3), ("body_quat_w", 4)):
            shape = arrays[name].shape if name in arrays else ()
            if len(shape) != 3 or shape[0] != len(joint_pos) or shape[1] < 1 or shape[2] != width:
                raise MotionError(
                    f"array {name!r} has shape {shape}, expected ({len(joint_pos)}, bodies, {width}) with the root in "
                    f"it, because 'joint_pos' has {joint_pos.shape[1]} columns and not {7 + robot.num_joints}"
                )
        root = _root_index(arrays, robot)
        root_pos, root_quat = arrays["body_pos_w"][:, root], arrays["body_quat_w"][:, root]
        fields = (f"body_pos_w[:, {root}]", f"body_quat_w[:, {root}]")
    notes = []
    order = options.quat_order or "wxyz"
    if names is None:
        names, note = _find_joint_order(arrays.get("body_pos_w"), root_pos, root_quat, joint_pos, order, robot)
        notes.append(note)
    arranged, more = arrange_joints(joint_pos, names, robot, "joint_pos")
    clip = make_clip(path.stem, root_pos, root_quat, arranged, fps, robot, order, fields)
    doubts = [] if options.quat_order else doubt_quat_order(clip, order, options.soles)
    return MotionFile(path, "tracker npz", [clip], (f"quaternion {order}", *doubts, *notes, *more))


def _root_index(arrays: dict[str, np.ndarray], robot: Robot) -> int:
    if "body_names" not in arrays:
        return 0
    bodies = strings(arrays["body_names"], "body_names")
    if robot.keypoints[0] not in bodies:
        raise MotionError(f"'body_names' lacks {robot.keypoints[0]!r}, the root of {robot.name!r}")
    return bodies.index(robot.keypoints[0])


def _find_joint_order(
    body_pos_w: np.ndarray | None,
    root_pos: np.ndarray,
    root_quat: np.ndarray,
    joint_pos: np.ndarray,
    quat_order: str,
    robot: Robot,
) -> tuple[list[str], str]:
    """Names of the joints of a file that has none, from where its bodies are.

    BeyondMimic's files come out of Isaac Lab, which numbers joints breadth first; mjlab and MuJoCo number them depth
    first, and neither says so in the file. With the right order forward kinematics leads to the recorded bodies.
    """
    candidates = {"depth first": list(robot.joint_names), "breadth first": _breadth_first(robot)}
    if body_pos_w is None or joint_pos.shape[1] != robot.num_joints or body_pos_w.shape[:1] != joint_pos.shape[:1]:
        raise MotionError(
            "no array 'joint_names' and no 'body_pos_w' to find the order of the joints by; add 'joint_names', "
            f"{robot.num_joints} names in the order of the columns of 'joint_pos'"
        )
    frames = np.linspace(0, len(joint_pos) - 1, min(len(joint_pos), _CHECKED_FRAMES)).round().astype(int)
    quat = root_quat[frames][:, [3, 0, 1, 2]] if quat_order == "xyzw" else root_quat[frames]
    root_pos_w, root_quat_w, recorded = (
        torch.from_numpy(part.astype(np.float64)) for part in (root_pos[frames], quat, body_pos_w[frames])
    )
    kinematics = ForwardKinematics(robot, robot.keypoints)
    fitting = []
    for label, names in candidates.items():
        arranged, _ = arrange_joints(joint_pos[frames], names, robot, "joint_pos")
        pos_w, _ = kinematics(root_pos_w, root_quat_w, torch.from_numpy(arranged))
        # the nearest recorded body, whichever it is: files differ in which bodies they record
        error = torch.cdist(pos_w, recorded).amin(-1).mean(0).amax()
        if error < _SAME_PLACE:
            fitting.append(label)
    if len(fitting) != 1:
        found = "more than one usual order of joints fits" if fitting else "no usual order of joints fits"
        raise MotionError(
            f"no array 'joint_names', and {found} its 'body_pos_w'; add 'joint_names', {robot.num_joints} names in the "
            "order of the columns of 'joint_pos'"
        )
    return candidates[fitting[0]], f"no joint names, the bodies fit joints numbered {fitting[0]}"


def _breadth_first(robot: Robot) -> list[str]:
    """Joint names by their distance from the root, ties as in the robot's own order."""
    return sorted(robot.joint_names, key=robot.depth)


def _arrays(path: Path) -> dict[str, np.ndarray]:
    """The arrays of an archive, without objects in them, and none larger than the archive makes believable."""
    arrays = {}
    with zipfile.ZipFile(path) as archive:
        if sum(entry.file_size for entry in archive.infolist()) > size_limit(path.stat().st_size):
            raise MotionError("it unpacks to far more than its size, expected motions")
        for entry in archive.infolist():
            if entry.filename.endswith(".npy"):
                if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                    raise MotionError(f"{entry.filename!r} is compressed in a way that NumPy does not use")
                with archive.open(entry) as member:
                    # reading up to a size, and not to the end, holds a member to the size that it claims
                    arrays[entry.filename.removesuffix(".npy")] = _array(member.read(entry.file_size + 1))
    return arrays


def _array(data: bytes) -> np.ndarray:
    """An ``.npy`` file; its header cannot ask for more memory than there are bytes."""
    stream = BytesIO(data)
    version = np.lib.format.read_magic(stream)
    read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, fortran, dtype = read_header(stream)
    if dtype.hasobject:
        raise MotionError("an array holds Python objects, expected numbers")
    if math.prod(shape) * dtype.itemsize != len(data) - stream.tell():
        raise MotionError(f"an array of shape {shape} does not have the bytes for it")
    return np.frombuffer(data, dtype, offset=stream.tell()).reshape(shape, order="F" if fortran else "C")
