"""Tiny files of every format, written from a clip."""

import gzip
import pickle
import sys
import types
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from unittest import mock

import mujoco
import numpy as np
import torch

from plat.motions import MotionClip, save_csv, save_motions
from plat.robots import G1, ForwardKinematics
from plat.rotations import quat_multiply, quat_rotate

# joints of the G1 breadth first, as Isaac Lab numbers them
ISAAC_ORDER = [
    *("left_hip_pitch", "right_hip_pitch", "waist_yaw", "left_hip_roll", "right_hip_roll", "waist_roll"),
    *("left_hip_yaw", "right_hip_yaw", "waist_pitch", "left_knee", "right_knee"),
    *("left_shoulder_pitch", "right_shoulder_pitch", "left_ankle_pitch", "right_ankle_pitch"),
    *("left_shoulder_roll", "right_shoulder_roll", "left_ankle_roll", "right_ankle_roll"),
    *("left_shoulder_yaw", "right_shoulder_yaw", "left_elbow", "right_elbow"),
    *("left_wrist_roll", "right_wrist_roll", "left_wrist_pitch", "right_wrist_pitch"),
    *("left_wrist_yaw", "right_wrist_yaw"),
]
WITHOUT_WRISTS = [index for index, name in enumerate(G1.joint_names) if "wrist" not in name]


def bowing_clip(frames: int = 40, heading: float = 0.0) -> MotionClip:
    """A bow from the hips on feet that stand exactly still; every arm joint has an angle of its own."""
    qpos = np.tile(G1.default_qpos, (frames, 1))
    lean = 0.2 * (1 - np.cos(np.linspace(0, 2 * np.pi, frames)))
    qpos[:, 3], qpos[:, 5] = np.cos(lean / 2), np.sin(lean / 2)
    for side in ("left", "right"):
        qpos[:, 7 + G1.joint_names.index(f"{side}_hip_pitch")] -= lean
    qpos[:, 7 + 15 :] += np.linspace(0.05, 0.2, 14) * (1 + lean[:, None])
    foot = ForwardKinematics(G1, G1.feet)(*torch.from_numpy(qpos).split((3, 4, 29), -1))[0][:, 0].numpy()
    qpos[:, :3] += [0, 0.1, 0.035] - foot  # 0.035: from the ankle to the sole
    return turned(MotionClip("bow", qpos.astype(np.float32), 50.0), heading)


def turned(clip: MotionClip, angle: float) -> MotionClip:
    """The clip somewhere else, turned about the vertical."""
    qpos = torch.from_numpy(clip.qpos).double().clone()
    turn = torch.tensor([np.cos(angle / 2), 0, 0, np.sin(angle / 2)], dtype=torch.float64)
    qpos[:, :3] = quat_rotate(turn, qpos[:, :3])
    qpos[:, 3:7] = quat_multiply(turn.expand(len(qpos), 4), qpos[:, 3:7])
    return MotionClip(clip.name, qpos.numpy(), clip.fps)


def body_poses(clip: MotionClip) -> tuple[np.ndarray, np.ndarray]:
    pos, quat = ForwardKinematics(G1)(*torch.from_numpy(clip.qpos).split((3, 4, 29), -1))
    return pos.numpy(), quat.numpy()


def link_arrays(clip: MotionClip) -> dict[str, np.ndarray]:
    """Arrays as Kimodo and ARDY write them for the G1: y up, z forward, ends of feet and hands behind the last link."""
    model = G1.shared_model
    data = mujoco.MjData(model)
    axes = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    links = [1]
    for joint, name in enumerate(G1.joint_names, start=1):
        links += [int(model.jnt_bodyid[joint])] * (1 + name.endswith(("ankle_roll", "wrist_yaw")))
    rotations, places = [], []
    for qpos in clip.qpos:
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        rotations.append(axes @ data.xmat[links].reshape(-1, 3, 3) @ axes.T)
        places.append(data.xpos[links] @ axes.T)
    joints = np.array(places)
    return {"global_rot_mats": np.array(rotations), "posed_joints": joints, "root_positions": joints[:, 0]}


def write_plat(path: Path, clip: MotionClip) -> None:
    save_motions(path, [clip])


def write_csv(path: Path, clip: MotionClip, order: str = "wxyz") -> None:
    columns = [*range(3), *((3, 4, 5, 6) if order == "wxyz" else (4, 5, 6, 3)), *range(7, 36)]
    np.savetxt(path, clip.qpos[:, columns], delimiter=",", fmt="%.7g")


def write_headed_csv(path: Path, clip: MotionClip) -> None:
    save_csv(path.parent, clip).rename(path)


def write_tracker(path: Path, clip: MotionClip, order: list[str] | None = None, named: bool = True) -> None:
    """29 columns, as BeyondMimic and mjlab write them."""
    pos, quat = body_poses(clip)
    listed = order or list(G1.joint_names)
    names = {"joint_names": [f"{name}_joint" for name in listed]} if named else {}
    joints = clip.qpos[:, [7 + G1.joint_names.index(name) for name in listed]]
    np.savez_compressed(path, fps=[clip.fps], joint_pos=joints, body_pos_w=pos, body_quat_w=quat, **names)


def write_full_tracker(path: Path, clip: MotionClip) -> None:
    """36 columns, as holosoma writes them."""
    pos, _ = body_poses(clip)
    np.savez(path, fps=clip.fps, joint_pos=clip.qpos, body_pos_w=pos, joint_names=G1.joint_names)


def gmr_fields(clip: MotionClip) -> dict[str, object]:
    root_pos, root_quat, joint_pos = np.split(clip.qpos.astype(np.float64), (3, 7), axis=1)
    rot = root_quat[:, [1, 2, 3, 0]]
    return {"fps": np.float64(clip.fps), "root_pos": root_pos, "root_rot": rot, "dof_pos": joint_pos, "links": ["a"]}


def write_gmr(path: Path, clip: MotionClip, protocol: int = 4) -> None:
    path.write_bytes(pickle.dumps(gmr_fields(clip), protocol))


def asap_motions(clip: MotionClip, names: tuple[str, ...] = ("first", "second")) -> dict[str, object]:
    fields = gmr_fields(clip)
    motion = {
        "root_trans_offset": fields["root_pos"],
        "root_rot": fields["root_rot"],
        "dof": np.asfortranarray(np.float32(fields["dof_pos"])[:, WITHOUT_WRISTS]),
        "fps": int(clip.fps),
    }
    return dict.fromkeys(names, motion)


def write_asap(
    path: Path, clip: MotionClip, compress: Callable[[bytes], bytes] = lambda data: data, aligned: bool = True
) -> None:
    path.write_bytes(compress(joblib_bytes(asap_motions(clip), aligned)))


def write_gzipped_asap(path: Path, clip: MotionClip) -> None:
    write_asap(path, clip, gzip.compress)


class NumpyArrayWrapper:
    """Stands where joblib's class of that name would."""


NumpyArrayWrapper.__module__ = "joblib.numpy_pickle"


class _JoblibPickler(pickle._Pickler):
    """Writes arrays as joblib does: a wrapper that describes one, then its bytes outside of any frame."""

    def __init__(self, file, aligned: bool):
        super().__init__(file, 4)
        self._file, self._aligned = file, aligned

    def save(self, obj, save_persistent_id=True):
        if not isinstance(obj, np.ndarray):
            super().save(obj, save_persistent_id)
            return
        wrapper = NumpyArrayWrapper()
        fortran = obj.flags.f_contiguous and not obj.flags.c_contiguous
        wrapper.subclass, wrapper.shape, wrapper.dtype = np.ndarray, obj.shape, obj.dtype
        wrapper.order, wrapper.allow_mmap = "F" if fortran else "C", True
        if self._aligned:
            wrapper.numpy_array_alignment_bytes = 16
        super().save(wrapper)
        self.framer.commit_frame(force=True)
        if self._aligned:
            padding = -(self._file.tell() + 1) % 16
            self._file.write(bytes([padding]) + b"\xff" * padding)
        self._file.write(obj.tobytes("A"))


def joblib_bytes(value: object, aligned: bool = True) -> bytes:
    module = types.ModuleType("joblib.numpy_pickle")
    module.NumpyArrayWrapper = NumpyArrayWrapper
    file = BytesIO()
    with mock.patch.dict(sys.modules, {"joblib": types.ModuleType("joblib"), module.__name__: module}):
        _JoblibPickler(file, aligned).dump(value)
    return file.getvalue()


# name of a file, and what writes it
WRITERS: dict[str, Callable[[Path, MotionClip], None]] = {
    "plat.npz": write_plat,
    "wxyz_50fps.csv": write_csv,
    "xyzw_50fps.csv": lambda path, clip: write_csv(path, clip, "xyzw"),
    "headed_50fps.csv": write_headed_csv,
    "mjlab.npz": write_tracker,
    "beyondmimic.npz": lambda path, clip: write_tracker(path, clip, ISAAC_ORDER, named=False),
    "holosoma.npz": write_full_tracker,
    "gmr.pkl": write_gmr,
    "asap.pkl": write_asap,
    "asap_gzip.pkl": write_gzipped_asap,
}
