"""Every layout in every variation: each file is read right, or refused, and none is read wrong."""

import itertools
import json
import pickle
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from plat.errors import MotionError
from plat.motions import MotionClip, read_motion_files
from plat.robots import G1

from .writers import ISAAC_ORDER, body_poses, bowing_clip, joblib_bytes

_OTHER = {"left": "right", "right": "left"}
RIGHT_FIRST = [
    "_".join((_OTHER.get(side, side), *rest)) for side, *rest in (name.split("_", 1) for name in G1.joint_names)
]


@dataclass(frozen=True)
class Content:
    """What a file holds, and in which conventions."""

    place: np.ndarray
    quat: np.ndarray
    angles: np.ndarray
    bodies: np.ndarray
    body_quats: np.ndarray
    names: tuple[str, ...] = G1.joint_names
    fps: float = 50.0


def content(clip: MotionClip) -> Content:
    bodies, quats = body_poses(clip)
    place, quat, angles = np.split(clip.qpos.astype(float), (3, 7), axis=1)
    return Content(place, quat, angles, bodies, quats)


def scaled(factor: float) -> Callable[[Content], Content]:
    return lambda c: replace(c, place=factor * c.place, bodies=factor * c.bodies)


def listed(names: list[str]) -> Callable[[Content], Content]:
    columns = [G1.joint_names.index(name) for name in names]
    return lambda c: replace(c, angles=c.angles[:, columns], names=tuple(names))


def xyzw(c: Content) -> Content:
    return replace(c, quat=c.quat[:, [1, 2, 3, 0]], body_quats=c.body_quats[..., [1, 2, 3, 0]])


def y_up(c: Content) -> Content:
    def turned(quat: np.ndarray) -> np.ndarray:
        w, x, y, z = np.moveaxis(quat, -1, 0)
        return 0.5**0.5 * np.stack((w + x, x - w, y + z, z - y), -1)

    place, bodies = (part[..., [0, 2, 1]] * [1, 1, -1] for part in (c.place, c.bodies))
    return replace(c, place=place, bodies=bodies, quat=turned(c.quat), body_quats=turned(c.body_quats))


def renamed(c: Content) -> Content:
    """The world and every body with y up and z forward."""
    place, bodies = (part[..., [1, 2, 0]] for part in (c.place, c.bodies))
    quat, body_quats = (part[..., [0, 2, 3, 1]] for part in (c.quat, c.body_quats))
    return replace(c, place=place, bodies=bodies, quat=quat, body_quats=body_quats)


VARIATIONS: dict[str, Callable[[Content], Content]] = {
    "plain": lambda c: c,
    "xyzw": xyzw,
    "cm": scaled(100),
    "mm": scaled(1000),
    "degrees": lambda c: replace(c, angles=np.rad2deg(c.angles)),
    "y up": y_up,
    "breadth first": listed(ISAAC_ORDER),
    "right first": listed(RIGHT_FIRST),
    "sign": lambda c: replace(c, quat=-c.quat),
    "short quaternions": lambda c: replace(c, quat=0.9 * c.quat),
    "cm, xyzw": lambda c: scaled(100)(xyzw(c)),
    "y up, xyzw": lambda c: xyzw(y_up(c)),
    "y up, breadth first": lambda c: listed(ISAAC_ORDER)(y_up(c)),
    "alphabetical": listed(sorted(G1.joint_names)),
    "waist last": listed([*(n for n in G1.joint_names if "waist" not in n), "waist_yaw", "waist_roll", "waist_pitch"]),
    "y up, z forward": renamed,
    "without wrists": listed([name for name in G1.joint_names if "wrist" not in name]),
}


def csv(
    header: list[str] | None = None, separator: str = ",", named: bool = False, unit: float = 1, index: bool = False
):
    def write(folder: Path, c: Content) -> Path:
        rows = np.concatenate((c.place, c.quat, c.angles), 1)
        head = [*(header or []), *(f"{name}_joint" for name in c.names)] if named else None
        if index:
            rows = np.column_stack((np.arange(len(rows)), rows))
            head = ["Frame", *head] if head else None
        lines = [separator.join(f"{value:.8g}" for value in row) for row in rows]
        path = folder / f"walk_{c.fps:g}hz.csv"
        path.write_text("\n".join(([separator.join(head)] if head else []) + lines))
        return path

    return write


def npz(arrays: Callable[[Content], dict[str, object]], name: str = "motion.npz"):
    def write(folder: Path, c: Content) -> Path:
        np.savez(folder / name, **arrays(c))
        return folder / name

    return write


def pkl(make: Callable[[Content], object], joblib: bool = False):
    def write(folder: Path, c: Content) -> Path:
        (folder / "motion.pkl").write_bytes(joblib_bytes(make(c)) if joblib else pickle.dumps(make(c)))
        return folder / "motion.pkl"

    return write


def qpos(c: Content) -> np.ndarray:
    return np.concatenate((c.place, c.quat, c.angles), 1)


def bodies(c: Content) -> dict[str, object]:
    return {"body_pos_w": c.bodies, "body_quat_w": c.body_quats, "fps": c.fps}


def named(c: Content) -> list[str]:
    return [f"{name}_joint" for name in c.names]


def hdmi(folder: Path, c: Content) -> Path:
    (folder / "meta.json").write_text(json.dumps({"fps": c.fps, "joint_names": named(c), "body_names": G1.keypoints}))
    np.savez(folder / "motion.npz", joint_pos=c.angles, body_pos_w=c.bodies, body_quat_w=c.body_quats)
    return folder / "motion.npz"


def gmr(c: Content) -> dict[str, object]:
    return {"fps": c.fps, "root_pos": c.place, "root_rot": c.quat, "dof_pos": c.angles, "local_body_pos": None}


WXYZ, XYZW = ([f"root_{axis}" for axis in "xyz"] + [f"quat_{axis}" for axis in order] for order in ("wxyz", "xyzw"))
LAYOUTS: dict[str, Callable[[Path, Content], Path]] = {
    "csv": csv(),
    "csv, spaces": csv(separator=" "),
    "csv, semicolons": csv(separator=";"),
    "csv, index": csv(index=True),
    "csv, header wxyz": csv(WXYZ, named=True),
    "csv, header xyzw": csv(XYZW, named=True),
    "csv, index and header": csv(WXYZ, named=True, index=True),
    "plat npz": npz(lambda c: {"clip": qpos(c), "fps": c.fps, "joint_names": c.names}),
    "qpos without names": npz(lambda c: {"qpos": qpos(c), "fps": c.fps}),
    "holosoma's retargeter": npz(
        lambda c: {"qpos": qpos(c), "human_joints": np.zeros((40, 22, 3)), "fps": c.fps, "cost": 0.1}
    ),
    "loco-mujoco": npz(
        lambda c: {"qpos": qpos(c), "joint_names": ["root", *named(c)], "frequency": c.fps, "split_points": [0, 40]}
    ),
    "mjlab": npz(lambda c: {"joint_pos": c.angles, "joint_names": named(c), **bodies(c)}),
    "BeyondMimic": npz(lambda c: {"joint_pos": c.angles, **bodies(c)}),
    "holosoma": npz(lambda c: {"joint_pos": qpos(c), "joint_names": c.names, **bodies(c)}),
    "HDMI": hdmi,
    "AMP": npz(
        lambda c: {
            "dof_positions": c.angles,
            "dof_names": named(c),
            "fps": c.fps,
            "body_names": G1.keypoints,
            "body_positions": c.bodies,
            "body_rotations": c.body_quats,
        }
    ),
    "SOMA": npz(
        lambda c: {
            "robot_root_pos": c.place,
            "robot_root_quat": c.quat,
            "scalar_first": True,
            "fps": c.fps,
            "robot_joint_pos": c.angles,
            "robot_joint_names": named(c),
        }
    ),
    "GMR": pkl(gmr),
    "GMR, names": pkl(lambda c: {**gmr(c), "joint_names": list(c.names)}),
    "ASAP": pkl(
        lambda c: {"a": {"root_trans_offset": c.place, "root_rot": c.quat, "dof": c.angles, "fps": c.fps}}, joblib=True
    ),
}


@pytest.mark.slow
def test_no_layout_is_read_wrong(tmp_path):
    clip = clip_with_arms(0.7)
    counts: Counter[str] = Counter()
    wrong = []
    for (layout, write), (variation, vary) in itertools.product(LAYOUTS.items(), VARIATIONS.items()):
        folder = tmp_path / str(counts.total())
        folder.mkdir()
        outcome = read(write(folder, vary(content(clip))), clip, "wrists" in variation)
        counts[outcome] += 1
        if outcome in ("wrong", "broken"):
            wrong.append(f"{layout}: {variation}")
    assert wrong == []
    assert counts.total() == 340
    assert counts["refused"] <= 8, counts


@pytest.mark.parametrize(
    ("layout", "heading", "vary"),
    [
        ("csv, header xyzw", np.pi / 2, lambda c: xyzw(y_up(c))),
        ("qpos without names", np.pi / 2, lambda c: xyzw(y_up(c))),
        ("GMR", -2.0, y_up),
    ],
)
def test_an_order_is_judged_with_the_axes_that_it_leads_to(tmp_path, layout, heading, vary):
    """An order that was right gave way to the other, or one that was wrong stayed: y was not up in the other one."""
    clip = clip_with_arms(heading)
    assert read(LAYOUTS[layout](tmp_path, vary(content(clip))), clip, False) == "right"


def clip_with_arms(heading: float) -> MotionClip:
    """A bow with arms and legs apart, as people have them."""
    clip = bowing_clip(heading=heading)
    for side, sign in (("left", 1), ("right", -1)):
        for part, angle in (("hip_roll", 0.1), ("ankle_roll", -0.1), ("shoulder_roll", 0.15)):
            clip.qpos[:, 7 + G1.joint_names.index(f"{side}_{part}")] += angle * sign
    return clip


def read(path: Path, clip: MotionClip, without_wrists: bool) -> str:
    """Return whether a file is read right, refused or read wrong."""
    try:
        (file,) = read_motion_files(path)
    except MotionError as error:
        # whatever a parser stumbles over would be named so, and tell nobody what to do
        return "broken" if "not a readable" in str(error) else "refused"
    found = file.clips[0]
    compared = [
        column for column in range(36) if column < 7 or not (without_wrists and "wrist" in G1.joint_names[column - 7])
    ]
    qpos = found.qpos.copy()
    qpos[:, 3:7] *= np.sign((qpos[:, 3:7] * clip.qpos[:, 3:7]).sum(1, keepdims=True))
    right = found.fps == clip.fps and np.abs(qpos - clip.qpos)[:, compared].max() < 1e-3
    return "right" if right else "wrong"
