"""Motions of SONIC's deployment: a folder a motion, with a table of joints and two of bodies in the world.

Source: NVlabs/GR00T-WholeBodyControl, ``docs/source/references/motion_reference.md``: 50 frames a second, joints in the
order of Isaac Lab, quaternions ``wxyz``, the first body is the root.
"""

from dataclasses import replace
from pathlib import Path

from plat.errors import MotionError
from plat.motions.formats.clock import contradiction, distinct_rates, stated_rates
from plat.motions.formats.common import MotionFile, ReadOptions
from plat.motions.formats.joint_orders import breadth_first
from plat.motions.formats.text_tables import read_table
from plat.motions.formats.tracker_file import read_tracker
from plat.words import counted

__all__ = ["holds_sonic", "is_part_of_sonic", "read_sonic", "sonic_parts"]

_FPS = 50.0
_JOINTS, _BODIES = "joint_pos.csv", {"body_pos.csv": ("body_pos_w", 3), "body_quat.csv": ("body_quat_w", 4)}
# what else lies in such a folder and is no motion of its own
_BESIDE = frozenset(
    (*_BODIES, "joint_vel.csv", "body_lin_vel.csv", "body_ang_vel.csv", "smpl_joint.csv", "smpl_pose.csv")
)


def sonic_parts(path: Path) -> list[Path]:
    """Return the tables of bodies that are read along with a table of joints."""
    return [path.with_name(name) for name in _BODIES] if holds_sonic(path) else []


def holds_sonic(path: Path) -> bool:
    """Return whether a table is the one of joints in a folder of SONIC."""
    return path.name == _JOINTS and all(path.with_name(name).is_file() for name in _BODIES)


def is_part_of_sonic(path: Path) -> bool:
    """Return whether a table belongs to a motion of SONIC, and is not the one that it is read by."""
    return path.name in _BESIDE and holds_sonic(path.with_name(_JOINTS))


def read_sonic(path: Path, options: ReadOptions) -> MotionFile:
    """Read a table of joints with those of bodies beside it. The clip takes the name of its folder.

    Raises:
        MotionError: when the tables do not fit together.
    """
    table = read_table(path)
    joints = table.values
    arrays = {"joint_pos": joints}
    for beside, (name, width) in _BODIES.items():
        values = read_table(path.with_name(beside)).values
        if len(values) != len(joints) or values.shape[1] % width:
            raise MotionError(
                f"{beside!r} beside it has {counted(values.shape[0], 'row')} of {counted(values.shape[1], 'column')}, "
                f"expected {len(joints)} rows of {width} for each body"
            )
        arrays[name] = values.reshape(len(values), -1, width)
    if len(arrays["body_pos_w"][0]) == 1:  # the root alone, which says nothing about joints
        arrays["root_pos"], arrays["root_quat"] = (arrays.pop(name)[:, 0] for name, _ in _BODIES.values())
    names = breadth_first(options.robot)
    fps, told = _FPS, ["fps as SONIC has it"]
    if options.fps is not None:
        fps, told = options.fps, []
    elif rates := distinct_rates(stated_rates(path, table.comments)):
        if len(rates) > 1:
            raise contradiction(rates)
        fps, told = rates[0][0], [f"fps from {rates[0][1]}"]
    file = read_tracker(path, arrays, fps, names, options)
    notes = (*told, *file.notes)
    clips = [replace(clip, name=path.resolve().parent.name) for clip in file.clips]
    return MotionFile(path, "SONIC csv", clips, notes)
