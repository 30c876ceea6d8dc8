"""Comma-separated tables of 36 columns: root position, root quaternion, 29 joints."""

import re
from pathlib import Path

import numpy as np

from plat.errors import MotionError
from plat.motions.clip import MotionClip
from plat.motions.formats.common import MotionFile, QuatOrder, ReadOptions, arrange_joints, make_clip
from plat.motions.formats.quaternion_order import detect_quat_order

__all__ = ["csv_text", "read_csv"]

# of the LAFAN1 retargeting data set, whose files do not say it
_USUAL_FPS = 30.0
_FPS_IN_NAME = re.compile(r"[_-]?(\d+(?:\.\d+)?) ?fps", re.IGNORECASE)


def read_csv(path: Path, options: ReadOptions) -> MotionFile:
    """Read ``.csv``: one motion, with or without a header.

    The quaternion's order comes from the options, else from the header (names that end in w, x, y, z), else from what
    it does to the robot.
    """
    robot = options.robot
    header, values = _table(path.read_text(encoding="utf-8-sig"), 7 + robot.num_joints)
    notes: list[str] = []
    fps = options.fps
    if fps is None and (found := _FPS_IN_NAME.search(path.stem)):
        fps = float(found[1])
        notes.append("fps from the file name")
    elif fps is None:
        fps = _USUAL_FPS
        notes.append("fps assumed (another can stand in the file name: x_60fps.csv)")
    names = None
    if header and any(_joint(name) in robot.joint_names for name in header[7:]):
        names = [_joint(name) for name in header[7:]]
    joint_pos, joint_notes = arrange_joints(values[:, 7:], names, robot, "columns 8 and up")
    name = _FPS_IN_NAME.sub("", path.stem) or path.stem
    parts = (name, values[:, :3], values[:, 3:7], joint_pos, fps, robot)
    fields = ("columns 1 to 3", "columns 4 to 7")
    order, how = options.quat_order, "as stated"
    if order is None:
        order, how = _order_in_header(header), "as the header says"
    if order is None:
        plain: MotionClip = make_clip(*parts, "wxyz", fields)
        order, how = detect_quat_order(plain.qpos, fps, options.soles), "detected"
    if order is None:
        raise MotionError(
            "the root quaternion (columns 4 to 7) makes a plausible motion as wxyz and as xyzw; state which it is: "
            f"python recipes/motions.py convert {path} --quat-order wxyz --out {name}.npz (or xyzw), or "
            "load_motions(..., quat_order=...)"
        )
    clip = make_clip(*parts, order, fields)
    return MotionFile(path, "csv", [clip], (f"quaternion {order} {how}", *notes, *joint_notes))


def csv_text(clip: MotionClip, joint_names: tuple[str, ...]) -> str:
    """A clip as a table with a header that :func:`read_csv` understands, quaternion ``wxyz``."""
    header = [*(f"root_{axis}" for axis in "xyz"), *(f"quat_{axis}" for axis in "wxyz"), *joint_names]
    rows = (",".join(f"{value:.7g}" for value in row) for row in clip.qpos.tolist())
    return "\n".join((",".join(header), *rows, ""))


def _table(text: str, width: int) -> tuple[list[str], np.ndarray]:
    """Header (empty where there is none) and numbers ``[T, width]``."""
    rows = [[cell.strip() for cell in line.split(",")] for line in text.splitlines() if line.strip()]
    header = rows.pop(0) if rows and not any(_is_number(cell) for cell in rows[0]) else []
    if not rows:
        raise MotionError("no rows of numbers, expected one a frame")
    for index, row in enumerate([header, *rows] if header else rows, start=1):
        if len(row) != width:
            raise MotionError(f"row {index} has {len(row)} columns, expected {width} (root xyz, quaternion, joints)")
    try:
        return header, np.array(rows, dtype=np.float64)
    except ValueError as error:
        raise MotionError(f"a cell is not a number ({error})") from None


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _order_in_header(header: list[str]) -> QuatOrder | None:
    order = "".join(name[-1:].lower() for name in header[3:7])
    return order if order in ("wxyz", "xyzw") else None  # type: ignore[return-value]


def _joint(name: str) -> str:
    return name.removesuffix("_dof").removesuffix("_joint")
