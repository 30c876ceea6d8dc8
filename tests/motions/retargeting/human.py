"""A human that tests write to BVH files: the joints, bone lengths and axes of LAFAN1, in poses of our own."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

# name, parent, offset (cm) and the rotation (degrees about z, then y, then x) that makes it stand with hanging arms
JOINTS = [
    ("Hips", None, (0.0, 0.0, 0.0), (90, 0.01, 90)),
    *(
        row
        for side, sign in (("Left", 1), ("Right", -1))
        for row in (
            (f"{side}UpLeg", "Hips", (0.1, 1.9, 10.5 * sign), (180, 0, 180)),
            (f"{side}Leg", f"{side}UpLeg", (43.5, 0.0, 0.0), (-12, 0, 0)),
            (f"{side}Foot", f"{side}Leg", (42.4, 0.0, 0.0), (75, 0, 0)),
            (f"{side}Toe", f"{side}Foot", (17.3, 0.0, 0.0), (0, 0, 0)),
        )
    ),
    ("Spine", "Hips", (6.9, -2.6, 0.0), (0, 0, 0)),
    ("Spine1", "Spine", (12.6, 0.0, 0.0), (0, 0, 0)),
    ("Spine2", "Spine1", (12.3, 0.0, 0.0), (0, 0, 0)),
    ("Neck", "Spine2", (25.8, 0.0, 0.0), (0, 0, 0)),
    ("Head", "Neck", (11.8, 0.0, 0.0), (0, 0, 0)),
    *(
        row
        for side, sign in (("Left", 1), ("Right", -1))
        for row in (
            (f"{side}Shoulder", "Spine2", (19.7, -1.5, 6.0 * sign), (0, -90 * sign, 0)),
            (f"{side}Arm", f"{side}Shoulder", (11.3, 0.0, 0.0), (0, -78 * sign, 0)),
            (f"{side}ForeArm", f"{side}Arm", (33.0, 0.0, 0.0), (30, 0, 0)),
            (f"{side}Hand", f"{side}ForeArm", (25.2, 0.0, 0.0), (0, 0, 0)),
        )
    ),
]
# where the world of a file with that axis up has the x, y and z of one whose y axis is up
AXES = {"y": [0, 1, 2], "z": [2, 0, 1], "x": [1, 2, 0]}


def write_human(
    path: Path,
    *,
    frames: int = 30,
    turns: dict[str, tuple[float, float, float]] | None = None,
    up: str = "y",
    unit: float = 1.0,
    names: dict[str, str] | None = None,
) -> Path:
    """Write a human that stands and, over the file, turns joints further by the degrees in ``turns``, there and back.

    Args:
        path: where to.
        frames: how many, 30 a second.
        turns: joint to degrees about its z, y and x axis.
        up: axis of the world that points up.
        unit: of lengths, in cm.
        names: new names of joints.
    """
    names, turns = names or {}, turns or {}
    lines = ["HIERARCHY"]
    _write_joint(lines, "Hips", unit, names, 0)
    lines += ["MOTION", f"Frames: {frames}", "Frame Time: 0.033333"]
    change = np.eye(3)[AXES[up]]
    for frame in range(frames):
        share = np.sin(np.pi * frame / (frames - 1)) ** 2
        values = list(change @ [120.0, 92.0, -300.0] / unit)
        for name, _, _, rest in JOINTS:
            angles = np.add(rest, share * np.array(turns.get(name, (0, 0, 0))))
            if name == "Hips":
                angles = Rotation.from_matrix(change @ Rotation.from_euler("ZYX", angles, degrees=True).as_matrix())
                angles = angles.as_euler("ZYX", degrees=True)
            values += list(angles)
        lines.append(" ".join(f"{value:.6f}" for value in values))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def _write_joint(lines: list[str], name: str, unit: float, names: dict[str, str], depth: int) -> None:
    _, parent, offset, _ = next(joint for joint in JOINTS if joint[0] == name)
    tab = "\t" * depth
    position = "6 Xposition Yposition Zposition" if parent is None else "3"
    lines += [f"{tab}{'JOINT' if parent else 'ROOT'} {names.get(name, name)}", f"{tab}{{"]
    lines += [f"{tab}\tOFFSET {' '.join(f'{x / unit:.6f}' for x in offset)}"]
    lines += [f"{tab}\tCHANNELS {position} Zrotation Yrotation Xrotation"]
    children = [joint[0] for joint in JOINTS if joint[1] == name]
    for child in children:
        _write_joint(lines, child, unit, names, depth + 1)
    if not children:
        lines += [f"{tab}\tEnd Site", f"{tab}\t{{", f"{tab}\t\tOFFSET 1 0 0", f"{tab}\t}}"]
    lines += [f"{tab}}}"]
