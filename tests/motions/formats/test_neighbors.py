"""The same motion as people's programs spell it: each file is read right, or refused with what to do."""

import gzip
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from plat.errors import MotionError
from plat.motions import read_motion_files, validate_motion
from plat.robots import G1

from .test_layouts import clip_with_arms, content, listed, qpos, xyzw
from .writers import ISAAC_ORDER

CLIP = clip_with_arms(0.7)
CONTENT = content(CLIP)
ROWS, XYZW = qpos(CONTENT), qpos(xyzw(CONTENT))
JOINTS = list(G1.joint_names)
ROOT = ["root_x", "root_y", "root_z", "root_qw", "root_qx", "root_qy", "root_qz"]
LINKS = [f"{name}_link" for name in JOINTS[::-1]]
QUAT_FIRST = ROWS[:, [3, 4, 5, 6, 0, 1, 2, *range(7, 36)]]
OBJECT = np.tile([0.6, 0, 0, 0.8, 1, 0, 0.5], (len(ROWS), 1))
COUNT = np.arange(len(ROWS))
FIELDS = {"fps": 50, "root_pos": ROWS[:, :3], "root_rot": XYZW[:, 3:7], "dof_pos": ROWS[:, 7:]}


def table(
    name: str = "walk_50fps.csv",
    header: list[str] | None = None,
    rows: np.ndarray = ROWS,
    *,
    separator: str = ",",
    end: str = "\n",
    point: str = ".",
    before: str = "",
    after: str = "",
    mark: bytes = b"",
    units: list[str] | None = None,
    row: str = "{}",
) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        lines = [separator.join(line) for line in (header, units) if line]
        lines += [
            row.format(separator.join(f"{value:.12g}".replace(".", point) for value in values)) + after
            for values in rows
        ]
        (folder / name).write_bytes(mark + (before + end.join(lines) + end).encode())
        return folder / name

    return write


def npz(**arrays: object) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        np.savez(folder / "walk.npz", **arrays)
        return folder / "walk.npz"

    return write


def pkl(content: object) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        (folder / "walk.pkl").write_bytes(pickle.dumps(content))
        return folder / "walk.pkl"

    return write


def npy(content: object, name: str = "walk_50fps.npy") -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        np.save(folder / name, content)
        return folder / name

    return write


def scaled(unit: float) -> np.ndarray:
    return np.column_stack((ROWS[:, :3] / unit, ROWS[:, 3:]))


def spelled(spell: Callable[[list[str]], str]) -> list[str]:
    """Names of all joints, each made of its words."""
    return [spell(name.split("_")) for name in JOINTS]


def degrees(rows: np.ndarray = ROWS) -> np.ndarray:
    return np.column_stack((rows[:, :7], np.rad2deg(rows[:, 7:])))


def euler() -> np.ndarray:
    w, x, y, z = CONTENT.quat.T
    roll, yaw = np.arctan2(w * x + y * z, 0.5 - x * x - y * y), np.arctan2(w * z + x * y, 0.5 - y * y - z * z)
    return np.column_stack((ROWS[:, :3], roll, np.arcsin(2 * (w * y - z * x)), yaw, ROWS[:, 7:]))


def side_last(words: list[str]) -> str:
    return "_".join(words[1:] + words[:1] if words[0] in ("left", "right") else words)


def with_texts(name: str, header: list[str], texts: list[str], rows: np.ndarray = ROWS) -> Callable[[Path], Path]:
    """A table whose first column holds texts."""

    def write(folder: Path) -> Path:
        lines = [",".join(header)]
        lines += [",".join((text, *(f"{value:.12g}" for value in row))) for text, row in zip(texts, rows, strict=True)]
        (folder / name).write_text("\n".join(lines), encoding="utf-8")
        return folder / name

    return write


def text(content: str, name: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        (folder / name).write_text(content)
        return folder / name

    return write


def compressed(name: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        (folder / name).write_bytes(gzip.compress(b"0,1,2"))
        return folder / name

    return write


def renamed(write: Callable[[Path], Path], name: str) -> Callable[[Path], Path]:
    return lambda folder: write(folder).rename(folder / name)


STAMPS = [f"2026-11-26 10:59:59.{20 * n:03}" for n in COUNT]
QPOS, QVEL = [f"qpos_{n}" for n in range(36)], [f"qvel_{n}" for n in range(35)]
RIGHT = {
    "byte order mark, CRLF, quotes, spaces": table(
        header=[f'" {name}"' for name in ("root x", "root y", "root z", "quat w", "quat x", "quat y", "quat z")]
        + [f'"{name}"' for name in spelled(" ".join)],
        end="\r\n",
        mark=b"\xef\xbb\xbf",
    ),
    "CR": table(end="\r"),
    "spaces at the ends": table(after="  "),
    "decimal commas, semicolons": table(separator=";", point=","),
    "decimal commas, tabs": table(separator="\t", point=","),
    "decimal commas, spaces": table(separator=" ", point=","),
    "tsv": table("walk_50fps.tsv", separator="\t"),
    "txt": table("walk_50fps.txt", separator=" "),
    "inches": table(rows=scaled(0.0254)),
    "feet": table(rows=scaled(0.3048)),
    "centimeters in the header": table(
        header=[f"{name}_cm" for name in ROOT[:3]] + ROOT[3:] + JOINTS, rows=scaled(0.01)
    ),
    "degrees in the header": table(header=ROOT + [f"{name}_joint [deg]" for name in JOINTS], rows=degrees()),
    "radians in the header": table(header=ROOT + [f"{name} (rad)" for name in JOINTS]),
    "pelvis_pos_x, dof_": table(
        header=[f"pelvis_pos_{axis}" for axis in "xyz"]
        + [f"pelvis_quat_{axis}" for axis in "wxyz"]
        + [f"dof_{name}" for name in JOINTS]
    ),
    "dots": table(
        header=[f"base.position.{axis}" for axis in "xyz"]
        + [f"base.orientation.{axis}" for axis in "xyzw"]
        + [f"joint.{name}.position" for name in JOINTS],
        rows=XYZW,
    ),
    "qx qy qz qw": table(header=["x", "y", "z", "qx", "qy", "qz", "qw", *JOINTS], rows=XYZW),
    "roll pitch yaw": table(header=["x", "y", "z", "roll", "pitch", "yaw", *JOINTS], rows=euler()),
    "roll pitch yaw in degrees": table(
        header=["x", "y", "z", "roll", "pitch", "yaw", *JOINTS],
        rows=np.column_stack((euler()[:, :3], np.rad2deg(euler()[:, 3:6]), ROWS[:, 7:])),
    ),
    "LeftHipPitch": table(header=ROOT + spelled(lambda words: "".join(word.capitalize() for word in words))),
    "hip_pitch_left": table(header=ROOT + spelled(side_last)),
    "l_hip_pitch": table(header=ROOT + [name.replace("left_", "l_").replace("right_", "r_") for name in JOINTS]),
    "breadth first, named": table(header=ROOT + ISAAC_ORDER, rows=qpos(listed(ISAAC_ORDER)(CONTENT))),
    "kLeftHipPitch, in an order of its own": table(
        header=ROOT + [f"k{''.join(part.capitalize() for part in name.split('_'))}" for name in JOINTS[::-1]],
        rows=np.column_stack((ROWS[:, :7], ROWS[:, :6:-1])),
    ),
    "lefthippitch, in an order of its own": table(
        header=ROOT + [name.replace("_", "") for name in JOINTS[::-1]],
        rows=np.column_stack((ROWS[:, :7], ROWS[:, :6:-1])),
    ),
    "a root of other axes before joints without names": table(
        header=[*(ROOT[n] for n in (0, 2, 1, 4, 5, 3, 6)), *(f"joint_{n}" for n in range(29))],
        rows=ROWS[:, [0, 2, 1, 4, 5, 3, *range(6, 36)]],
    ),
    "a root behind joints without names": table(
        header=[*(f"joint_{n}" for n in range(29)), *ROOT], rows=np.roll(ROWS, -7, 1)
    ),
    "one word and numbers": table(header=["joint", *(f"joint.{n}" for n in range(1, 36))]),
    "root behind the joints": table(header=JOINTS + ROOT, rows=np.roll(ROWS, -7, 1)),
    "a title before the header": table(header=ROOT + JOINTS, before="Motion export 2.1\n"),
    "a row of units": table(
        header=ROOT + JOINTS,
        rows=degrees(),
        units=["m"] * 3 + ["-"] * 4 + ["deg"] * 29,
    ),
    "names in two rows": table(
        header=["root"] * 7 + ["joint"] * 29, units=[n.removeprefix("root_") for n in ROOT] + JOINTS
    ),
    "rows as Python prints them": table(row="[{}],"),
    "time, positions and velocities": table("walk.csv", rows=np.column_stack((0.02 * COUNT, ROWS, np.zeros((40, 35))))),
    "hands beside": table(
        header=ROOT + JOINTS + [f"left_hand_{n}_joint" for n in range(7)],
        rows=np.column_stack((ROWS, np.zeros((40, 7)))),
    ),
    "a torso beside the root": table(
        header=ROOT + [f"torso_{axis}" for axis in ("x", "y", "z", "qw", "qx", "qy", "qz")] + JOINTS,
        rows=np.column_stack((ROWS[:, :7], np.tile([0.1, 0, 1, 0.6, 0, 0, 0.8], (40, 1)), ROWS[:, 7:])),
    ),
    "a torso for the root": table(
        header=[name.replace("root", "torso") for name in ROOT] + JOINTS,
    ),
    "velocities beside": table(
        header=ROOT + JOINTS + [f"{name}_vel" for name in JOINTS], rows=np.column_stack((ROWS, 0 * ROWS[:, 7:]))
    ),
    "an object behind": table(rows=np.column_stack((ROWS, np.tile([1, 0, 0.5, 1, 0, 0, 0], (40, 1))))),
    "velocities behind": table(rows=np.column_stack((ROWS, np.zeros((40, 35))))),
    "milliseconds": table("walk.csv", ["time_ms", *ROOT, *JOINTS], np.column_stack((20 * COUNT, ROWS))),
    "time since 1970": table("walk.csv", ["timestamp", *ROOT, *JOINTS], np.column_stack((1.7e9 + 0.02 * COUNT, ROWS))),
    "frame and time": table(
        "walk.csv", ["frame", "time", *ROOT, *JOINTS], np.column_stack((COUNT, 0.02 * COUNT, ROWS))
    ),
    "a count that is called t": table(header=["t", *ROOT, *JOINTS], rows=np.column_stack((COUNT, ROWS))),
    "a count of every fourth frame that is called time": table(
        header=["time", *ROOT, *JOINTS], rows=np.column_stack((4 * COUNT, ROWS))
    ),
    "a count of every fourth frame without a name": table(rows=np.column_stack((4 * COUNT, ROWS))),
    "a count called timestamp, and the time": table(
        "walk.csv", ["timestamp", "time", *ROOT, *JOINTS], np.column_stack((COUNT, 0.02 * COUNT, ROWS))
    ),
    "frame and time without names": table("walk.csv", rows=np.column_stack((COUNT, 0.02 * COUNT, ROWS))),
    "a comment with fps": table("walk.csv", before="# fps: 50\n"),
    "a comment with a time step": table("walk.csv", before="# timestep: 0.02 s\n"),
    "a name with a time step": table("walk_dt0.02.csv"),
    "walk 50 fps": table("walk 50 fps.csv"),
    "a frame rate before the header": table("walk.csv", ROOT + JOINTS, before="fps,50\n"),
    "Excel's separator": table(header=ROOT + JOINTS, separator=";", point=",", before="sep=;\n"),
    "Excel's separator without a header": table(separator=";", before="sep=;\n", after=";"),
    "qpos and qvel": table(header=QPOS + QVEL, rows=np.column_stack((ROWS, np.zeros((40, 35))))),
    "numbered names": table(header=[f"state.position{n}" for n in range(36)]),
    "dates with times": with_texts("walk.csv", ["stamp", *ROOT, *JOINTS], STAMPS),
    "dates with times without names": with_texts("walk.csv", ["stamp", *QPOS], STAMPS),
    "a column of one text": with_texts("walk_50fps.csv", ["name", *ROOT, *JOINTS], ["walk"] * 40),
    "one clip": table(header=["clip", *ROOT, *JOINTS], rows=np.column_stack((0 * COUNT + 3, ROWS))),
    "fps as text": npz(clip=ROWS, fps="50"),
    "names as bytes": npz(clip=ROWS, fps=50, joint_names=np.array([name.encode() for name in JOINTS])),
    "names as objects": npz(clip=ROWS, fps=50, joint_names=np.array(JOINTS, dtype=object)),
    "numbers as objects": npz(qpos=ROWS.astype(object), fps=np.array(50, dtype=object)),
    "time step": npz(clip=ROWS, dt=0.02),
    "a count and a rate in an archive": npz(qpos=ROWS, t=COUNT, fps=50),
    "times of something else in an archive": npz(qpos=ROWS, times=[0.1, 0.4, 0.9], fps=50),
    "several that state one rate in an archive": npz(qpos=ROWS, fps=50, dt=0.02, hz=50.1, time=0.02 * COUNT),
    "velocities beside in an archive": npz(qpos=ROWS, qvel=np.zeros((40, 35)), fps=50, joint_names=JOINTS),
    "contacts beside in an archive": npz(qpos=ROWS, contact=np.zeros((40, 30)), fps=50),
    "a reference beside in an archive": npz(qpos=ROWS, ref_qpos=ROWS + 0.01, fps=50),
    "times in an archive": npz(qpos=ROWS, time=0.02 * COUNT),
    "a rate for each clip": npz(clip=ROWS, fps=[50, 50]),
    "a batch of each frame": npz(qpos=ROWS[:, None], fps=50),
    "joint_angles and root_position": npz(
        root_position=ROWS[:, :3], root_orientation=ROWS[:, 3:7], joint_angles=ROWS[:, 7:], fps=50, joint_names=JOINTS
    ),
    "root_rotation_xyzw": npz(
        base_translation=ROWS[:, :3],
        base_rotation_xyzw=XYZW[:, 3:7],
        dof_positions=ROWS[:, 7:],
        fps=50,
        dof_names=JOINTS,
    ),
    "one of a batch": npz(qpos=ROWS[None], fps=50),
    "the quaternion first, as OmniRetarget has it": npz(qpos=QUAT_FIRST, fps=50),
    "the quaternion first, of the object as well": npz(qpos=np.column_stack((QUAT_FIRST, OBJECT)), fps=50),
    "the quaternion first in a table": table(rows=QUAT_FIRST),
    "the quaternion first, xyzw, and an object in a table": table(
        rows=np.column_stack((QUAT_FIRST[:, [1, 2, 3, 0, *range(4, 36)]], OBJECT))
    ),
    "the quaternion first in a pickle": pkl({"qpos": QUAT_FIRST, "fps": 50}),
    "degrees in a table of another order": table(rows=degrees(qpos(listed(sorted(JOINTS))(CONTENT)))),
    "degrees in an archive of another order": npz(clip=degrees(qpos(listed(sorted(JOINTS))(CONTENT))), fps=50),
    "degrees in a pickle of another order": pkl(
        {**FIELDS, "dof_pos": degrees(qpos(listed(sorted(JOINTS))(CONTENT)))[:, 7:]}
    ),
    "degrees from 0 to 360": table(rows=np.column_stack((ROWS[:, :7], degrees()[:, 7:] % 360))),
    "degrees in an archive": npz(clip=degrees(), fps=50),
    "base_frame_pos and base_frame_wxyz": npz(
        base_frame_pos=ROWS[:, :3], base_frame_wxyz=ROWS[:, 3:7], joint_angles=ROWS[:, 7:], fps=50
    ),
    "joint_pos_deg in an archive": npz(
        root_pos=ROWS[:, :3], root_quat=ROWS[:, 3:7], joint_pos_deg=degrees()[:, 7:], fps=50
    ),
    "two arrays of joints": npz(**FIELDS, dof=0 * ROWS[:, 7:]),
    "a list with the rate in a pickle": pkl({**FIELDS, "fps": [50]}),
    "fields of GMR in an archive": npz(**FIELDS),
    "root_quat and joint_pos": npz(root_pos=ROWS[:, :3], root_quat=ROWS[:, 3:7], joint_pos=ROWS[:, 7:], fps=50),
    "base_pos and base_quat": npz(
        base_pos=ROWS[:, :3], base_quat=ROWS[:, 3:7], joint_pos=ROWS[:, 7:], fps=50, joint_names=JOINTS
    ),
    "fields of ASAP in an archive": npz(root_trans_offset=ROWS[:, :3], root_rot=XYZW[:, 3:7], dof=ROWS[:, 7:], fps=50),
    "lists": pkl({name: value.tolist() if name != "fps" else value for name, value in FIELDS.items()}),
    "a list of motions": pkl([FIELDS]),
    "wxyz in a pickle": pkl({**FIELDS, "root_rot": ROWS[:, 3:7]}),
    "qpos in a pickle": pkl({"qpos": ROWS, "fps": 50}),
    "degrees in a pickle": pkl({**FIELDS, "dof_pos": degrees()[:, 7:]}),
    "a time step in a pickle": pkl({name: value for name, value in FIELDS.items() if name != "fps"} | {"dt": 0.02}),
    "root_quat in a pickle": pkl(
        {"fps": 50, "root_pos": ROWS[:, :3], "root_quat": ROWS[:, 3:7], "joint_pos": ROWS[:, 7:]}
    ),
    "root_position in a pickle": pkl(
        {"motion_fps": 50, "root_position": ROWS[:, :3], "root_orientation": ROWS[:, 3:7], "joint_angles": ROWS[:, 7:]}
    ),
    "joint_order in a pickle": pkl(
        {**FIELDS, "dof_pos": qpos(listed(ISAAC_ORDER)(CONTENT))[:, 7:], "joint_order": ISAAC_ORDER}
    ),
    "actuated_joints in a pickle": pkl({**FIELDS, "dof_pos": ROWS[:, :6:-1], "actuated_joints": tuple(JOINTS[::-1])}),
    "names in the metadata of a pickle": pkl(
        {**FIELDS, "dof_pos": ROWS[:, :6:-1], "meta": {"dofs": np.array(JOINTS[::-1]), "body_names": JOINTS}}
    ),
    "names of all motions of a pickle": pkl(
        {"joints_list": JOINTS[::-1], "tags": ["a"], "walk": {**FIELDS, "dof_pos": ROWS[:, :6:-1]}}
    ),
    "motor_names in an archive": npz(**{**FIELDS, "dof_pos": ROWS[:, :6:-1]}, motor_names=JOINTS[::-1]),
    "joints_list of qpos in an archive": npz(
        qpos=np.column_stack((ROWS[:, :7], ROWS[:, :6:-1])), fps=50, joints_list=["root", *JOINTS[::-1]]
    ),
    "links for joints": pkl(
        {**FIELDS, "dof_pos": ROWS[:, :6:-1], "dof_names": [name.replace("waist_pitch", "torso") for name in LINKS]}
    ),
    "a column for each joint in a pickle": pkl({**FIELDS, "dof_pos": ROWS[:, 7:, None]}),
    "npy": npy(ROWS),
    "npy of a dictionary": npy(FIELDS, "walk.npy"),
}

REFUSED = {
    "columns beside joints without names": (
        table(
            header=["frame", "label", *ROOT, *(f"joint_{n}" for n in range(29)), "tag"],
            rows=np.column_stack((COUNT, 0 * COUNT, ROWS, 0 * COUNT)),
        ),
        "row 1 has 39 columns, 38 without counts, times and what is derived, expected 36 .*, or a header that names",
    ),
    "joints without a name": (
        table(rows=np.delete(ROWS, (20, 21), 1)),
        "row 1 has 34 columns, expected 36 .*, 30 without the wrists, or a header that names them",
    ),
    "words that are no joints": (
        table(header=ROOT + [f"gelenk{chr(97 + n // 26)}{chr(97 + n % 26)}" for n in range(29)]),
        r"the header has the unknown \['gelenkaa', .*expected names of the robot's joints, or none",
    ),
    "two orders of the joints": (
        pkl({**FIELDS, "robot_joints": JOINTS, "policy_joints": JOINTS[::-1]}),
        "'robot_joints' and 'policy_joints' list joints in different orders; name the right one 'joint_names'",
    ),
    "a joint that is missing": (
        table(header=ROOT + JOINTS[1:], rows=np.delete(ROWS, 7, 1)),
        "'joint_names' lacks \\['left_hip_pitch'\\]",
    ),
    "a joint twice": (table(header=ROOT + JOINTS[:-1] + JOINTS[-2:-1]), "has \\['right_wrist_pitch'\\] twice"),
    "no number": (table(rows=np.vstack((ROWS, np.full(36, np.nan)))), "motion 'walk': qpos\\[40, 0\\] is nan"),
    "one frame": (table(rows=ROWS[:1]), "motion 'walk': 1 frame, expected at least 2"),
    "no frames": (table(header=ROOT + JOINTS, rows=ROWS[:0]), "no rows of numbers, expected one a frame"),
    "no rate in an archive": (npz(clip=ROWS), "no array 'fps', expected the frames a second"),
    "two rates in an archive": (
        npz(clip=ROWS, fps=50, framerate=25),
        r"it states 50 \('fps'\) and 25 \('framerate'\) frames a second; state which",
    ),
    "other names": (
        npz(a=ROWS[:, :3], b=ROWS[:, 3:7], c=ROWS[:, 7:], fps=50),
        r"expected one array \(frames, 36\) each",
    ),
    "fields of a simulation in a pickle": (
        pkl({"fps": 50, "root_states": np.zeros((40, 13)), "dof_states": np.zeros((40, 29, 2))}),
        "no field 'dof_pos' or 'dof' or 'joint_pos', only \\['dof_states', 'fps', 'root_states'\\]",
    ),
    "no rate in a pickle": (pkl({"qpos": ROWS}), "no field 'fps', expected the frames a second"),
    "joint positions of another skeleton": (
        npz(joints=np.zeros((40, 17, 3)), fps=50),
        r"'joints' has shape \(40, 17, 3\) and is no robot's motion; joint positions of a human are read .*names",
    ),
    "joint positions in an npy": (npy(np.zeros((40, 22, 3))), "write them with np.savez"),
    "a rate in a comment and another in the name": (
        table(before="# rate: 25 Hz\n"),
        r"it states 25 \(a comment\) and 50 \(the file name\) frames a second; state which",
    ),
    "decimal commas between commas": (table(point=","), "separate columns by semicolons"),
    "an archive that is called a table": (renamed(npz(clip=ROWS, fps=50), "walk.csv"), "end its name in .npz"),
    "a pickle that is called an archive": (renamed(pkl(FIELDS), "walk.npz"), "it is a pickle, .* end its name in .pkl"),
    "a table that is compressed": (compressed("walk.csv"), "it is compressed with gzip: unpack it first"),
    "several motions by frame": (
        table(header=["frame", *ROOT, *JOINTS], rows=np.column_stack((COUNT % 20, ROWS))),
        r"column 1 \('frame'\) goes from 19 to 0 after frame 19: are these several motions\?",
    ),
    "several motions by index": (
        table(header=["", *ROOT, *JOINTS], rows=np.column_stack((COUNT % 20, ROWS))),
        r"column 1 \(''\) goes from 19 to 0 after frame 19: are these several motions\?",
    ),
    "missing frames": (
        table(header=["Frame", *ROOT, *JOINTS], rows=np.column_stack((COUNT + 40 * (COUNT > 9), ROWS))),
        r"column 1 \('Frame'\) goes from 9 to 50 after frame 9: frames are missing: write a file for each piece",
    ),
    "frames that are there twice": (
        table(header=["frame", *ROOT, *JOINTS], rows=np.column_stack((np.sort(COUNT - COUNT % 3 // 2), ROWS))),
        r"column 1 \('frame'\) goes from 1 to 1 after frame 1: a frame is there twice: leave one out, or",
    ),
    "several motions by number": (
        table(header=["episode_id", *ROOT, *JOINTS], rows=np.column_stack((COUNT // 20, ROWS))),
        r"column 1 \('episode_id'\) goes from 0 to 1 after frame 19",
    ),
    "several motions by name": (
        with_texts("walk_50fps.csv", ["name", *ROOT, *JOINTS], ["walk"] * 20 + ["run"] * 20),
        r"column 1 \('name'\) holds texts, 'walk' and 'run': are these several motions\?",
    ),
    "labels": (text("name,label\nwalk,1\nrun,1\n", "labels.csv"), "row 2, column 1: 'walk' is not a number"),
    "one label": (text("name,label\nwalk,a\nwalk,a\n", "labels.csv"), "row 2, column 1|row 1 has 2 columns"),
    "JSON": (text('{"Loop": "wrap", "Frames": [[0.1]]}', "walk.txt"), "JSON and no table of numbers"),
    "rotation vectors of the root": (
        npz(**{**FIELDS, "root_rot": XYZW[:, 3:6]}),
        "write rotation vectors, .* as quater",
    ),
    "a rate and another time step": (
        npz(clip=ROWS, fps=50, dt=0.04),
        r"it states 50 \('fps'\) and 25 \('dt'\) frames a second; state which: plat motions convert --fps 25",
    ),
    "a rate and times of another": (
        npz(qpos=ROWS, fps=50, time=0.04 * COUNT),
        r"it states 50 \('fps'\) and 25 \('time'\) frames a second; state which",
    ),
    "a rate and times of another in a pickle": (
        pkl({**FIELDS, "timestamps": 0.04 * COUNT}),
        r"it states 50 \('fps'\) and 25 \('timestamps'\) frames a second; state which",
    ),
    "two rates in a pickle": (
        pkl({**FIELDS, "frequency": 25, "dt": 0.02}),
        r"it states 50 \('fps'\) and 25 \('frequency'\) frames a second; state which",
    ),
    "different rates of clips": (npz(a=ROWS, b=ROWS, fps=[50, 30]), "'fps' is array"),
    "times with a gap": (npz(qpos=ROWS, time=0.02 * (COUNT + 5 * (COUNT > 20))), "the time goes on by 0.12 at row"),
    "objects in an archive": (npz(motion=np.array({"qpos": ROWS}, dtype=object), fps=50), "with Python objects"),
}


@pytest.mark.parametrize("write", RIGHT.values(), ids=RIGHT)
def test_read_right(tmp_path, write):
    ((found,),) = (file.clips for file in read_motion_files(write(tmp_path)))
    turned = found.qpos.copy()
    turned[:, 3:7] *= np.sign((turned[:, 3:7] * CLIP.qpos[:, 3:7]).sum(1, keepdims=True))
    np.testing.assert_allclose(turned, CLIP.qpos, atol=1e-3)
    assert found.fps == CLIP.fps


@pytest.mark.parametrize(("write", "message"), REFUSED.values(), ids=REFUSED)
def test_refused_in_one_line(tmp_path, write, message):
    with pytest.raises(MotionError, match=message) as caught:
        read_motion_files(write(tmp_path))
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(f"motion file '{tmp_path}")


@pytest.mark.parametrize(
    ("write", "reason"),
    [
        (table("walk.csv"), "nothing states or shows its frame rate"),
        (npy(ROWS, "walk.npy"), "nothing states or shows its frame rate"),
        (table(rows=ROWS * [1, 1, 0, *[1] * 33]), "a foot 75.5 cm under the floor"),
        (
            table(
                rows=np.column_stack(
                    (ROWS[:, :2], -ROWS[:, 2], -ROWS[:, 4], ROWS[:, 3], -ROWS[:, 6], ROWS[:, 5:6], ROWS[:, 7:])
                )
            ),
            "cm under the floor: is its up axis right",
        ),
    ],
    ids=["no rate", "no rate in an npy", "a root at its own floor", "upside down"],
)
def test_what_may_be_read_wrong_is_to_be_repaired(tmp_path, write, reason):
    ((found,),) = (file.clips for file in read_motion_files(write(tmp_path)))
    report = validate_motion(found)
    assert report.verdict == "repair"
    assert any(reason in told for told in report.reasons), report.reasons
