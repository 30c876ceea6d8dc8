"""Tables with a row a frame: root position, root quaternion or Euler angles, joints."""

import json
import shlex
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from plat.errors import MotionError
from plat.json_file import short
from plat.motions.clip import ASSUMED_RATE, MotionClip
from plat.motions.formats.beside import rates_beside
from plat.motions.formats.clock import (
    distinct_rates,
    evenly_timed,
    rate_fields,
    rate_of_times,
    rates_of_fields,
    stated_rates,
    unit_of_times,
)
from plat.motions.formats.columns import TableColumns, split_columns
from plat.motions.formats.common import MotionFile, QuatOrder, ReadOptions, arrange_joints, check_rate, make_clip
from plat.motions.formats.joint_orders import in_robot_order
from plat.motions.formats.pace import Pace, UnfitRateError, settled_rate
from plat.motions.formats.quaternion_order import choose_quat_order, settle_joint_order, settle_quat_order
from plat.motions.formats.rate import without_rates
from plat.motions.formats.root_turn import likeliest_turn
from plat.motions.formats.spellings import is_time
from plat.motions.formats.text_tables import Table, read_table
from plat.words import counted

__all__ = ["clip_in_csv", "csv_text", "read_csv", "read_values"]

# of the LAFAN1 retargeting data set, whose files do not say it, and of BONES-SEED, whose header is known
_USUAL_FPS = 30.0
_SEED_FPS = 120.0
# the comments with which plat writes a rate that was assumed, and the name of a clip that its file cannot have
_ASSUMED = "fps assumed"
_CLIP = "plat clip "
_FIELDS = ("root position", "root rotation")
_LONGEST_LINE = 1 << 20


def read_csv(path: Path, options: ReadOptions) -> MotionFile:
    """Read a table of numbers: one motion, with or without a header, in any usual dialect.

    Columns are found by name where the header says enough, else by place. The quaternion's order comes from the
    options, else from the header, else from what it does to the robot. The frame rate comes from the options, else
    from a column of times, a comment or the name.
    """
    table = read_table(path)
    # a rate in the clip's name is none of the file's
    comments = [line for line in table.comments if not line.startswith(_CLIP)]
    return read_values(path, replace(table, comments=comments), options, "csv")


def read_values(path: Path, table: Table, options: ReadOptions, kind: str) -> MotionFile:
    """Return the motion of a table, whatever kind of file it comes from; see :func:`read_csv`."""
    parts = split_columns(table, options.robot)
    name = without_rates(path.stem)
    if parts.turn:  # whose quaternion is made here
        options = replace(options, quat_order=None)
    joint_pos, notes = arrange_joints(parts.joints, parts.names, options.robot, "the columns of joints")
    joint_pos, more = _in_joint_order(name, parts, joint_pos, options)
    parts = _with_turn(name, parts, joint_pos, options)
    order, how, doubts = ("wxyz", "", []) if parts.turn else _quat_order(path, name, parts, joint_pos, options)
    clip = _clip(name, parts, joint_pos, order, options)
    fps, told, fits = _rate(path, table, parts, clip, options)
    check_rate(fps)
    shown = () if parts.turn else (f"quaternion {order} {how}",)
    turn = (f"root rotation from {parts.turn}",) if parts.turn else ()
    kind = "BONES-SEED csv" if parts.seed else kind
    unsure = tuple(note for note in told if note == ASSUMED_RATE)
    told = tuple(note for note in told if note != ASSUMED_RATE)
    clip = replace(clip, fps=fps, notes=(*unsure, *clip.notes))
    if parts.times is not None and options.fps is None:
        clip = evenly_timed(clip, parts.times[0])
    unheard = ("quat_order",) if parts.turn else ()
    notes = [*shown, *told, *doubts, *turn, *parts.notes, *_left_out(table), *notes, *more]
    return MotionFile(path, kind, [clip], tuple(notes), unheard, rate_fits=fits)


def _left_out(table: Table) -> list[str]:
    """Return a note on the columns of texts that are not read."""
    shown = ", ".join(short(name) for name, _ in [*table.texts.values()][:3])
    more = ", ..." if len(table.texts) > 3 else ""
    return [f"{counted(len(table.texts), 'column')} of texts left out ({shown}{more})"] if table.texts else []


def clip_in_csv(path: Path) -> str | None:
    """Return the name of the clip in a table that plat wrote, or None where only the file's name says it."""
    with path.open("rb") as file:
        line = file.readline(_LONGEST_LINE).decode(errors="replace")
    if not line.startswith(f"# {_CLIP}"):
        return None
    with suppress(ValueError):
        return str(json.loads(line.removeprefix(f"# {_CLIP}")))
    return None


def csv_text(clip: MotionClip, joint_names: tuple[str, ...], stem: str | None = None) -> str:
    """Return a clip as a table with a header that :func:`read_csv` understands, quaternion ``wxyz``.

    Args:
        clip: what is written.
        joint_names: of the robot.
        stem: what its file is called, without the rate: a comment has the clip's name where that is another.
    """
    header = [*(f"root_{axis}" for axis in "xyz"), *(f"quat_{axis}" for axis in "wxyz"), *joint_names]
    rows = (",".join(f"{value:.7g}" for value in row) for row in clip.qpos.tolist())
    named = () if stem in (clip.name, None) else (f"# {_CLIP}{json.dumps(clip.name)}",)
    doubt = (f"# {_ASSUMED}",) if ASSUMED_RATE in clip.notes else ()
    return "\n".join((*named, *doubt, ",".join(header), *rows, ""))


def _clip(name: str, parts: TableColumns, joint_pos: np.ndarray, order: QuatOrder, options: ReadOptions) -> MotionClip:
    place, quat, fps = parts.place, parts.quat, _fps(options)
    return make_clip(name, place, quat, joint_pos, fps, options, order, _FIELDS, written=parts.units)


def _fps(options: ReadOptions) -> float:
    return _USUAL_FPS if options.fps is None else options.fps


def _in_joint_order(
    name: str, parts: TableColumns, joint_pos: np.ndarray, options: ReadOptions
) -> tuple[np.ndarray, list[str]]:
    """Return the joints of a table without names in the robot's order, which the motion shows."""
    if parts.names is not None or parts.joints.shape[1] != options.robot.num_joints:
        return joint_pos, []
    order = options.quat_order or parts.order

    def read(joints: np.ndarray) -> np.ndarray:
        return _clip(name, parts, joints, order or "wxyz", options).qpos

    listed, notes = settle_joint_order(joint_pos, read, options, order)
    return in_robot_order(joint_pos, listed, options.robot), notes


def _with_turn(name: str, parts: TableColumns, joint_pos: np.ndarray, options: ReadOptions) -> TableColumns:
    """Return a table's parts with the orientation that the feet confirm, where its columns leave several open."""
    if not parts.turns:
        return parts
    readings = {
        told: _clip(name, replace(parts, quat=quat), joint_pos, "wxyz", options) for told, quat in parts.turns.items()
    }
    poses = {told: clip.qpos for told, clip in readings.items()}
    found, sure, rivals = likeliest_turn(poses, next(iter(readings.values())).fps, options.soles)
    open_ones = "" if sure else f" as assumed, and {' and '.join(rivals)} fit as well"
    return replace(parts, quat=parts.turns[found], turn=f"{found}{open_ones}")


def _quat_order(
    path: Path, name: str, parts: TableColumns, joint_pos: np.ndarray, options: ReadOptions
) -> tuple[QuatOrder, str, list[str]]:
    """Return the order of the quaternion, what says so, and notes."""
    if options.quat_order is not None:
        return options.quat_order, "as stated", []

    def read(order: QuatOrder) -> np.ndarray:
        return _clip(name, parts, joint_pos, order, options).qpos

    fps = _fps(options)
    if parts.order is not None:
        order, notes = settle_quat_order(read, fps, options.soles, parts.order)
        return order, "detected" if notes else "as the header says", notes
    found = choose_quat_order(read("wxyz"), read("xyzw"), fps, options.soles)
    if found is not None:
        return found, "detected", []
    out = f"{without_rates(path.stem)}.npz"
    raise MotionError(
        "the root quaternion (columns 4 to 7) makes a plausible motion as wxyz and as xyzw; state which it is: "
        f"plat motions convert {shlex.quote(str(path))} --quat-order wxyz --out {shlex.quote(out)} (or xyzw), or "
        "load_motions(..., quat_order=...)"
    )


def _rate(
    path: Path, table: Table, parts: TableColumns, clip: MotionClip, options: ReadOptions
) -> tuple[float, tuple[str, ...], bool]:
    """Return the frame rate, what it was taken from, and whether it was assumed and the motion fits it.

    Raises:
        MotionError: where several are stated and the motion does not decide, or none is and it contradicts the usual,
            or there are times that are not understood.
    """
    if options.fps is not None:
        return clip.fps, (), False
    columns = dict(zip(table.header, table.values.T, strict=False))
    constant = {name: columns[name] for name in rate_fields(columns) if not np.ptp(columns[name])}
    stated = rates_of_fields(constant) + stated_rates(path, table.comments)
    stated = stated or rates_beside(path, len(table.values))
    if parts.times is not None:
        rate, (times, unit) = rate_of_times(*parts.times), parts.times
        fits = unit in ("", unit_of_times(times, rate))
        stated.insert(0, (rate, f"the column of times{'' if fits else f', which is not in {unit}'}"))
    elif parts.seed and not stated:
        stated = [(_SEED_FPS, "the format")]
    distinct = distinct_rates(stated)
    if len(distinct) == 1:
        if _ASSUMED in table.comments:
            return distinct[0][0], (ASSUMED_RATE,), False
        return distinct[0][0], (f"fps from {distinct[0][1]}",), False
    if distinct:
        rate, told = settled_rate(distinct, [clip], options.robot)
        return rate, (told,), False
    for column, (name, text) in table.texts.items():
        if is_time(name):
            raise MotionError(
                f"column {column + 1} ({name!r:.40}) holds {text!r:.40}, expected a number or a time (or state them: "
                "plat motions convert --fps)"
            )
    pace = Pace(clip, options.robot)
    if against := pace.against(_USUAL_FPS):
        raise UnfitRateError(
            f"nothing states its frames a second; the usual {_USUAL_FPS:g} do not fit {against}: state it: "
            "plat motions convert --fps"
        )
    if confirmed := pace.confirmed_by(_USUAL_FPS):
        return _USUAL_FPS, (f"fps assumed, and its {confirmed} fit",), True
    return _USUAL_FPS, (ASSUMED_RATE,), False
