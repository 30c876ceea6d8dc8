"""Motion files: finding, reading and writing them.

A plat motion file is a NumPy ``.npz`` with one array a clip, named by the clip: ``qpos`` ``[T, 7 + J]`` (root position
in m, root quaternion ``wxyz``, joint angles in rad), and the array ``fps``. If ``joint_names`` is there, the joint
columns are brought into the robot's order by name. Where plat wrote it, the array ``plat_motions`` marks it: clips may
then have the names that other formats give to other things. The other formats are in :mod:`plat.motions.formats`.
"""

import logging
import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from plat.errors import MotionError, OutputError
from plat.files import as_path, readable, write_file
from plat.json_file import short
from plat.motions.clip import ASSUMED_RATE, MotionClip, as_clips
from plat.motions.formats import MotionFile, QuatOrder, ReadOptions, check_clip_names, csv_text, write_archive
from plat.motions.formats.axes import Up
from plat.motions.formats.clock import contradicting_name
from plat.motions.formats.comment_rate import without_steps
from plat.motions.formats.csv_file import clip_in_csv
from plat.motions.formats.foreign import refuse_foreign
from plat.motions.formats.manifest import manifest_above
from plat.motions.formats.pace import UnfitRateError
from plat.motions.formats.rate import without_rates
from plat.motions.formats.sonic import is_part_of_sonic, sonic_parts
from plat.motions.formats.units import Angles, Units
from plat.motions.paths import distinct_names, find_files, listed_paths, read_twice
from plat.motions.readers import NAMED, READERS
from plat.motions.retargeting.asf import skeletons_beside
from plat.progress import tracked
from plat.robots import G1, Robot

__all__ = [
    "csv_name",
    "csv_stem",
    "load_motions",
    "motion_paths",
    "name_at",
    "read_along",
    "read_motion_files",
    "save_csv",
    "save_motions",
]

# endings of what is read as a table
_TABLES = (".csv", ".tsv", ".txt", ".npy")
_LONGEST_MESSAGE = 800
# motions of a file of which is said what is wrong
_SHOWN = 3
# values of one motion in two files differ by less (m, rad)
_ROUNDING = 2e-3
_LOGGER = logging.getLogger("plat.motions")

Say = Callable[[int, str], object]
"""What is given a line about what was read, and its level of logging."""


def log(level: int, line: str) -> None:
    """Log a line under ``plat.motions``."""
    _LOGGER.log(level, "%s", line)


def motion_paths(
    patterns: str | Path | Sequence[str | Path],
    *,
    strict: bool = False,
    told: list[str] | None = None,
    twice: list[tuple[Path, Path]] | None = None,
) -> list[Path]:
    """Return the motion files that paths, folders and globs name; see :func:`plat.motions.paths.find_files`.

    Args:
        patterns: a path, a folder, a glob, or several of these.
        strict: take copies of a file as well.
        told: is given a line for each copy that was left out.
        twice: is given each file that is equal to one before it and was taken, with that one.

    Raises:
        MotionError: when one of them names no motion file.
    """
    found = find_files(patterns, READERS, named=NAMED, copies=strict, told=told, twice=twice)
    listed = listed_paths(patterns)
    return [path for path in found if path in listed or not is_part_of_sonic(path)]


def read_along(path: Path) -> list[Path]:
    """Return the files that are read along with one: what says its frame rate, its names or its skeleton."""
    ending = path.suffix.lower()
    if ending == ".amc":
        return skeletons_beside(path)
    if ending == ".npz":
        above = manifest_above(path)
        beside = [path.with_name("meta.json"), *([above] if above is not None else [])]
    elif ending in _TABLES:
        beside = [path.with_suffix(".npz"), path.with_suffix(".pkl"), *sonic_parts(path)]
    else:
        beside = []
    return [file for file in beside if file.is_file()]


def read_motion_files(
    patterns: str | Path | Sequence[str | Path],
    robot: Robot = G1,
    *,
    quat_order: QuatOrder | None = None,
    fps: float | None = None,
    up: Up | None = None,
    units: Units | None = None,
    angles: Angles | None = None,
    strict: bool = False,
    skipped: list[MotionError] | None = None,
    told: list[str] | None = None,
    store: Callable[[MotionFile], MotionFile] | None = None,
    say: Say = log,
) -> list[MotionFile]:
    """Return motion files that were read, with what each was taken for; see :func:`load_motions`.

    Args:
        patterns: a path, a folder, a glob, or several of these.
        robot: whose motions they are.
        quat_order: of the root quaternion in these files.
        fps: frames a second of these files.
        up: axis that points up in these files.
        units: of lengths in these files.
        angles: their unit in captures of humans (``.bvh``, ``.amc``).
        strict: raise for a bad file in a folder or glob too, and read copies.
        skipped: is given the errors of bad files, of several those that are named as well; without it those of folders
            and globs are logged, and the others raised.
        told: is given a line for each copy in a folder that was left out, and for what is there twice; without it they
            are logged.
        store: is given each file as it was read, and returns it with its clips where they are kept.
        say: is given what would be logged.
    """
    options = ReadOptions(robot, quat_order, fps, up, units, angles)
    files, errors = [], []
    lines: list[str] = []
    equal: list[tuple[Path, Path]] = []
    paths = motion_paths(patterns, strict=strict, told=lines, twice=equal)
    if told is not None:
        told += [*lines, *map(read_twice, equal)]
    else:
        for line in lines:
            say(logging.INFO, readable(line))
        for pair in equal:
            say(logging.DEBUG, readable(read_twice(pair)))
    listed = listed_paths(patterns)
    for path in tracked(paths, "reading motions", unit="files"):
        try:
            file = _read(path, options)
            if file.broken:
                errors.append(_left_out(file))
                if strict:
                    raise errors[-1]
            files.append(file if store is None else store(file))
        except MotionError as error:
            if strict or (path in listed and (skipped is None or len(paths) == 1)):
                raise
            errors.append(error)
    _refuse_unheard(options, files)
    files, unsure = _with_sure_rates(files, errors)
    if unsure and strict:
        raise unsure[0]
    errors += unsure
    if errors and not files and (skipped is None or len(errors) == 1):
        raise errors[0] if len(errors) == 1 else MotionError(f"none of {len(errors)} files can be used; {errors[0]}")
    if skipped is not None:
        skipped += errors
    else:
        for bad in errors:
            say(logging.WARNING, f"skipped: {readable(str(bad))}")
    if twice := _twice(files, dict(equal)):
        told.append(twice) if told is not None else say(logging.WARNING, readable(twice))
    return _named_apart(files)


def load_motions(
    patterns: str | Path | Sequence[str | Path],
    robot: Robot = G1,
    *,
    quat_order: QuatOrder | None = None,
    fps: float | None = None,
    up: Up | None = None,
    units: Units | None = None,
    angles: Angles | None = None,
    strict: bool = False,
    store: Callable[[MotionFile], MotionFile] | None = None,
    say: Say = log,
) -> list[MotionClip]:
    """Return every clip of some motion files.

    Formats: plat ``.npz``; tables (``.csv``) of root and joints, with or without names; the ``.npz`` of BeyondMimic,
    mjlab, holosoma, HDMI, SOMA, Kimodo, ARDY, loco-mujoco and Isaac Lab's AMP; the ``.pkl`` of GMR, TWIST2, ASAP and
    PBHC, whose code is not run; human ``.bvh``, ``.amc`` and joint positions in ``.npz``, retargeted. What was assumed
    or detected is logged under ``plat.motions``, and listed in the ``notes`` of each clip. A bad file in a folder, and
    a bad motion in a file of several, is named in the log and skipped.

    Args:
        patterns: a path, a folder, a glob, or several of these.
        robot: whose motions they are.
        quat_order: order of the root quaternion in these files; by default what the format says, and for tables what
            the motion shows.
        fps: frames a second of these files; by default what they say, and 30 for a table that does not.
        up: axis that points up in these files; by default what the motion shows.
        units: of lengths in these files; by default what the motion shows.
        angles: their unit in captures of humans; by default degrees, or what the file says and the motion shows.
        strict: raise for a bad file in a folder or glob too, and for a bad motion of several; read copies.
        store: is given each file as it was read, and returns it with its clips where they are kept, such as
            :class:`plat.motions.store.ClipStore`.
        say: is given what would be logged.

    Raises:
        MotionError: naming file, clip and field, when a file is missing or broken, or does not tell which order its
            quaternions or joints have, or its frame rate; or for an order or a unit that says nothing about any file.

    >>> import tempfile
    >>> from plat.motions import generate_motions
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_motions(f"{folder}/two.npz", generate_motions("train", seconds=8)[:2])
    ...     len(load_motions(f"{folder}/*.npz"))
    2
    """
    files = read_motion_files(
        patterns,
        robot,
        quat_order=quat_order,
        fps=fps,
        up=up,
        units=units,
        angles=angles,
        strict=strict,
        store=store,
        say=say,
    )
    alike: dict[str, list[MotionFile]] = {}
    for file in files:
        if file.notes or any(clip.notes for clip in file.clips):
            alike.setdefault(file.facts, []).append(file)
    for facts, group in alike.items():
        more = f" and {len(group) - 1} more" if len(group) > 1 else ""
        say(logging.INFO, f"{readable(str(group[0].path))}{more}: {facts}")
    return [clip for file in files for clip in file.clips]


def save_motions(path: str | Path, clips: MotionClip | Iterable[MotionClip], robot: Robot = G1) -> None:
    """Write clips of one frame rate to a plat motion file; a clip alone is a list of one.

    Raises:
        MotionError: for several frame rates, names that cannot stand in the file, or a clip that is none of the
            robot's.
        OutputError: when the disk does not take it; the file that was there is intact.
    """
    clips = as_clips(clips, f"motion file {str(path)!r}")
    for clip in clips:
        clip.check(robot)
    if not clips:
        raise MotionError(f"motion file {str(path)!r}: no clips, expected at least one")
    rates = {clip.fps for clip in clips}
    if len(rates) != 1:
        found = ", ".join(f"{rate:.5g}" for rate in sorted(rates))
        raise MotionError(
            f"motion file {str(path)!r}: clips at {found} frames a second, expected one rate: "
            "plat motions convert --resample 50 gives all the same, and a folder takes each as it is"
        )
    try:
        check_clip_names([clip.name for clip in clips])
    except MotionError as error:
        raise MotionError(f"motion file {str(path)!r}: {error}") from None
    arrays, (fps,) = {clip.name: clip.qpos for clip in clips}, rates
    path = as_path(path, "motion file", OutputError)
    if not path.name:
        raise OutputError(f"motion file {str(path)!r}: is a folder, expected a file")
    path = path if path.suffix.lower() == ".npz" else path.with_name(f"{path.name}.npz")  # as numpy does
    assumed = [clip.name for clip in clips if ASSUMED_RATE in clip.notes]
    write_file(path, lambda part: write_archive(part, arrays, fps, robot.joint_names, assumed), "motion file")


def save_csv(folder: str | Path, clip: MotionClip, robot: Robot = G1) -> Path:
    """Write a clip to ``NAME_30fps.csv``: MuJoCo's ``qpos`` under a header, quaternion ``wxyz``.

    A rate that the clip's name states gives way to the clip's own, and so does what no file may be called or hides it.
    The file of a clip of that name is replaced.

    Raises:
        MotionError: for a clip that is none of the robot's.
        OutputError: when the disk does not take it, or its name, or the file has a clip of another name.
    """
    clip.check(robot)
    folder = as_path(folder, "folder", OutputError)
    if folder.is_file():
        raise OutputError(f"folder {str(folder)!r}: is a file, expected a folder")
    path, stem = folder / csv_name(clip), csv_stem(clip)
    other = (clip_in_csv(path) or stem) if os.path.isfile(path) else clip.name
    if other != clip.name:
        raise OutputError(
            f"motion file {str(path)!r}: has the clip {short(other)}, and would be replaced by {short(clip.name)}; "
            "expected another folder, or names that differ by more than their rates"
        )
    write_file(path, lambda part: part.write_text(csv_text(clip, robot.joint_names, stem)), "motion file")
    return path


def csv_name(clip: MotionClip) -> str:
    """Return the name of a clip's table: ``NAME_30fps.csv``."""
    return f"{csv_stem(clip)}_{clip.fps:.10g}fps.csv"


def csv_stem(clip: MotionClip) -> str:
    """Return the name of a clip's table without the rate at its end: ``NAME``."""
    return without_rates(without_steps(re.sub(r"[/\0]", "_", clip.name).lstrip(".")), "motion")


def name_at(name: str, fps: float) -> str:
    """Return a name with this frame rate in place of others that it states.

    >>> name_at("bow_60fps", 50.0), name_at("bow_60fps", 60.0), name_at("bow", 50.0)
    ('bow_50fps', 'bow_60fps', 'bow')
    """
    if not contradicting_name(Path(f"{name}.npz"), [(fps, "")]):
        return name
    return f"{without_rates(without_steps(name), 'motion')}_{fps:.10g}fps"


def _twice(files: Sequence[MotionFile], equal: Mapping[Path, Path]) -> str:
    """Return a line about motions that several files hold, as a table and an archive of one clip; empty for none.

    Args:
        files: with their clips under the names that these have there.
        equal: files that are equal to another one, which are not told of again.
    """
    count = Counter(name for file in files for name in {clip.name for clip in file.clips})
    alike: dict[str, list[tuple[MotionClip, Path]]] = {}
    pairs: list[tuple[tuple[MotionClip, Path], tuple[MotionClip, Path]]] = []
    for file in files:
        for clip in file.clips:
            if count[clip.name] > 1:
                alike.setdefault(clip.name, []).append((clip, file.path))
    for group in alike.values():
        group.sort(key=lambda one: float(one[0].qpos[0, 0]))  # equal ones stand side by side, whatever their number
        pairs += [(one, other) for one, other in pairwise(group) if one[1] != other[1] and _equal(one[0], other[0])]
    pairs = [pair for pair in pairs if len({equal.get(path, path) for _, path in pair}) > 1]
    if not pairs:
        return ""
    (clip, path), (_, other) = pairs[0]
    more = f" and {len(pairs) - 1} more" if len(pairs) > 1 else ""
    return f"read twice: the motion {clip.name!r} of {path} is that of {other}{more}: leave out one of two such files"


def _equal(one: MotionClip, other: MotionClip) -> bool:
    """Return whether two clips are one motion up to rounding; of two frame rates, whether they begin and last alike."""
    if abs(one.duration - other.duration) > 1 / min(one.fps, other.fps):
        return False
    frames = slice(None) if len(one.qpos) == len(other.qpos) else slice(1)
    # signs of quaternions may differ
    first, second = (np.delete(clip.qpos[frames], range(3, 7), axis=1) for clip in (one, other))
    return bool(np.allclose(first, second, rtol=0, atol=_ROUNDING))


def _named_apart(files: list[MotionFile]) -> list[MotionFile]:
    """Return the files with other names for clips of several files that are called alike: their file's or folder's."""
    count = Counter(name for file in files for name in {clip.name for clip in file.clips})

    def apart(clip: MotionClip, path: Path) -> str:
        if count[clip.name] < 2:
            return clip.name
        stem = readable(path.stem)
        return f"{readable(path.absolute().parent.name) if clip.name == stem else stem}_{clip.name}"

    names = iter(distinct_names([apart(clip, file.path) for file in files for clip in file.clips]))
    return [replace(file, clips=[replace(clip, name=next(names)) for clip in file.clips]) for file in files]


_STATED = {"quat_order": "a root quaternion of four numbers", "angles": "angles of a human's joints, .bvh or .amc"}


def _refuse_unheard(options: ReadOptions, files: Sequence[MotionFile]) -> None:
    """Raise for what is stated of files and says nothing about any of them.

    Raises:
        MotionError: naming it and the first file.
    """
    for field, needed in _STATED.items():
        if getattr(options, field) is not None and files and all(field in file.unheard for file in files):
            told = f"motion file {str(files[0].path)!r}: {field} is stated, and says nothing about a {files[0].format}"
            raise MotionError(f"{told}: expected no --{field.replace('_', '-')}, or files with {needed}")


def _with_sure_rates(
    files: list[MotionFile], errors: Sequence[MotionError]
) -> tuple[list[MotionFile], list[MotionError]]:
    """Return the files without those whose rate was assumed, where more files contradict the assumption than fit it.

    Tables that do not state their rate come in sets of one rate, and most motions do not tell theirs. Where more files
    of a folder fit the assumption, the others are taken to fit as well. A folder in which none tells is judged by all.
    """
    against = Counter(error.folder for error in errors if isinstance(error, UnfitRateError))
    fitting = Counter(file.path.parent for file in files if file.rate_fits)
    kept, unsure = [], []
    for file in files:
        folder = file.path.parent
        alone = bool(against[folder] or fitting[folder])
        contradicting, confirming = (each[folder] if alone else each.total() for each in (against, fitting))
        if contradicting <= confirming:
            kept.append(_as_beside(file, fitting[folder]))
        elif not _is_unsure(file):
            kept.append(file)
        else:
            told = f"and {contradicting} such files {'beside it' if alone else 'among these'} do not fit the usual ones"
            what = f"nothing states its frames a second, {told}: state it: plat motions convert --fps"
            unsure.append(MotionError(f"motion file {str(file.path)!r}: {what}"))
    return kept, unsure


def _is_unsure(file: MotionFile) -> bool:
    """Return whether the frame rate of a file was assumed and nothing confirms it."""
    return any(ASSUMED_RATE in clip.notes for clip in file.clips)


def _as_beside(file: MotionFile, fitting: int) -> MotionFile:
    """Return a file whose rate was assumed with what so many files beside it say of that."""
    if not fitting:
        return file
    told = f"fps assumed, as that of {fitting} beside it fit{'s' * (fitting == 1)}"
    clips = [
        replace(clip, notes=tuple(told if note == ASSUMED_RATE else note for note in clip.notes)) for clip in file.clips
    ]
    return replace(file, clips=clips)


def _read(path: Path, options: ReadOptions) -> MotionFile:
    ending = path.suffix.lower()
    try:
        with path.open("rb") as file:
            refuse_foreign(file.read(64), ending)
        read = READERS[ending](path, options)
        # a name that is no text could be written nowhere
        return replace(read, clips=[replace(clip, name=readable(clip.name)) for clip in read.clips])
    except MotionError as error:
        told = f"motion file {str(path)!r}: {_cut(error)}"
        raise (UnfitRateError(told, path.parent) if isinstance(error, UnfitRateError) else MotionError(told)) from None
    except Exception as error:  # whatever a parser stumbles over: the file is broken
        raise MotionError(f"motion file {str(path)!r}: not a readable {ending} file ({_cut(error)})") from error


def _left_out(file: MotionFile) -> MotionError:
    """Return what is wrong with the motions of a file that were left out, in one line."""
    count = len(file.broken)
    told = f"{count} of {count + len(file.clips)} motions left out: {'; '.join(map(_cut, file.broken[:_SHOWN]))}"
    more = f"; and {count - _SHOWN} more" if count > _SHOWN else ""
    return MotionError(f"motion file {str(file.path)!r}: {told}{more}")


def _cut(error: Exception) -> str:
    """Return a message, cut where it names at length what the file holds."""
    told = str(error)
    return told if len(told) <= _LONGEST_MESSAGE else f"{told[:_LONGEST_MESSAGE]} ..."
