"""Read and write what commands about motion files are given and make, and tell what of it was left out."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from plat.cli.options import MotionFiles
from plat.errors import MotionError, PlatError
from plat.files import check_file, check_folder, expand_home, keep_sources
from plat.motions import MotionClip, MotionFile, read_motion_files, save_csv, save_motions
from plat.motions.clip import ASSUMED_RATE
from plat.motions.files import csv_name, csv_stem, name_at
from plat.motions.formats.rate import without_rates
from plat.motions.generation import PREFIX, generate_named
from plat.motions.paths import distinct_names
from plat.motions.resample import resample_qpos
from plat.robots import G1, Robot, get_robot
from plat.spec.timing import Timing
from plat.words import counted

__all__ = [
    "GENERATED",
    "SHORTEST",
    "Lost",
    "at_rate",
    "check_out",
    "common_rate",
    "distinct",
    "distinct_names",
    "file_name",
    "long_enough",
    "read",
    "tell_lost",
    "unused",
    "write",
]

GENERATED = "generated"
"""Format of motions that plat makes itself."""
SHORTEST = Timing().control_dt
"""Length in s of the shortest command, without which no policy has a use for a clip."""
_ROUNDING = 1e-7


@dataclass
class Lost:
    """Numbers of clips that were not written: too short, and dropped as asked."""

    short: int = 0
    dropped: int = 0


def read(command: MotionFiles, skipped: list[MotionError] | None = None) -> list[MotionFile]:
    """Return the files; print what each was taken for, and which were left out."""
    skipped = [] if skipped is None else skipped
    told: list[str] = []
    robot = get_robot(command.robot)
    generated = [name for name in command.files if name.startswith(PREFIX)]
    files = [MotionFile(Path(re.sub(r"\W", "_", name)), GENERATED, generate_named(name, robot)) for name in generated]
    paths = [name for name in command.files if name not in generated]
    if generated and not paths:
        _refuse_stated(command, generated[0])
    if paths:
        files += read_motion_files(
            paths,
            robot,
            quat_order=command.quat_order,
            fps=command.fps,
            up=command.up,
            units=command.units,
            angles=command.angles,
            strict=command.strict,
            skipped=skipped,
            told=told,
        )
    for file in files:
        print(f"{file.path}: {counted(len(file.clips), 'clip')}, {file.facts}")
    for line in told:
        print(line)
    for error in skipped:
        print(f"skipped: {error}")
    return files


def _refuse_stated(command: MotionFiles, name: str) -> None:
    """Raise an error where something is stated of files and there are none.

    Raises:
        MotionError: naming it.
    """
    for field in ("quat_order", "fps", "up", "units", "angles"):
        if getattr(command, field) is not None:
            option = f"--{field.replace('_', '-')}"
            raise MotionError(f"{option} applies to files, and {name!r} is generated")


def unused(skipped: Sequence[MotionError], files: Sequence[MotionFile]) -> str:
    """Return how many files could not be used, and how many motions of others; empty where all could."""
    partly = sum(bool(file.broken) for file in files)
    whole, motions = len(skipped) - partly, sum(len(file.broken) for file in files)
    told = [f"{whole} of {counted(whole + len(files), 'file')}"] if whole else []
    told += [f"{counted(motions, 'motion')} of {counted(partly, 'file')}"] if partly else []
    return f"{' and '.join(told)} could not be used" if told else ""


def tell_lost(command: MotionFiles, skipped: Sequence[MotionError], files: Sequence[MotionFile], lost: Lost) -> None:
    """Say at the end what was not written; what was left out as asked, or found in a folder, is no error.

    Raises:
        MotionError: for files that were named and could not be used, and for clips that were too short.
    """
    counts = {
        unused(skipped, files): len(skipped),
        f"{lost.short} {'clip was' if lost.short == 1 else 'clips were'} too short": lost.short,
        f"{lost.dropped} {'was' if lost.dropped == 1 else 'were'} dropped, as asked": lost.dropped,
    }
    told = f"{', '.join(line for line, count in counts.items() if count)}; see above"
    named = tuple(f"motion file {str(expand_home(Path(name)))!r}:" for name in command.files)
    if lost.short or any(str(error).startswith(named) for error in skipped):
        raise MotionError(told)
    if any(counts.values()):
        print(told)


def long_enough(clip: MotionClip, path: Path, least: float, off: float = 0.0) -> bool:
    """Return whether a clip has so many seconds when some are taken off; print it where it has not."""
    left = clip.duration - off
    if left < least * (1 - _ROUNDING):
        trimmed = " after --trim" if off else ""
        print(f"left out {clip.name} of {path}: {max(left, 0):.3f} s long{trimmed}, expected at least {least:g} s")
        return False
    return True


def at_rate(clips: Sequence[MotionClip], rate: float, path: Path) -> list[MotionClip]:
    """Return clips of a file at so many frames a second, without those that are shorter than a frame; prints these."""
    resampled = []
    for clip in clips:
        if long_enough(clip, path, 1 / rate):
            qpos = clip.qpos
            if rate != clip.fps:
                qpos = resample_qpos(torch.from_numpy(qpos), clip.fps, 1 / rate).numpy()
            name = clip.name if rate == clip.fps else name_at(clip.name, rate)
            resampled.append(replace(clip, name=name, qpos=qpos, fps=rate))
    return resampled


def common_rate(clips: Sequence[MotionClip]) -> float | None:
    """Return the frames a second that most of some clips have, by their length, or None where all have the same."""
    seconds = dict.fromkeys((clip.fps for clip in clips), 0.0)
    for clip in clips:
        seconds[clip.fps] += clip.duration
    if len(seconds) < 2:
        return None
    rate = max(seconds, key=lambda fps: seconds[fps])
    print(f"all resampled to {rate:.5g} fps, the most common rate")
    return rate


def write(out: Path, files: Sequence[MotionFile], form: str, robot: Robot = G1) -> list[Path]:
    """Write clips to one npz, or to a folder."""
    clips = [clip for file in files for clip in file.clips]
    if form == "csv":  # a file each, so the names of files stay apart
        clips = [replace(clip, name=csv_stem(clip)) for clip in clips]
    clips = distinct(clips)
    if not clips:
        raise PlatError("no clips are left to write")
    sources = [file.path for file in files]
    if out.suffix.lower() == ".npz" and form == "npz":
        keep_sources(sources, [out])
        out.parent.mkdir(parents=True, exist_ok=True)
        save_motions(out, clips, robot)
        written = [out]
    elif form == "csv":
        keep_sources(sources, [out / csv_name(clip) for clip in clips])
        out.mkdir(parents=True, exist_ok=True)
        written = [save_csv(out, clip, robot) for clip in clips]
    else:
        files = [part for file in files for part in _by_rate(file)]
        written = [out / f"{stem}.npz" for stem in distinct_names([file.path.stem for file in files])]
        keep_sources(sources, written)
        out.mkdir(parents=True, exist_ok=True)
        for path, file in zip(written, files, strict=True):
            save_motions(path, distinct(file.clips), robot)
    seconds = sum(clip.duration for clip in clips)
    print(f"wrote {counted(len(clips), 'clip')}, {seconds:.0f} s, to {out}")
    if unsure := [clip for clip in clips if ASSUMED_RATE in clip.notes]:
        print(f"the frame rate of {counted(len(unsure), 'clip')} is assumed, as the file notes: state it with --fps")
    return written


def _by_rate(file: MotionFile) -> list[MotionFile]:
    """Return a file for each frame rate of its clips, with the rate in its name where it has several or another."""
    rates = list(dict.fromkeys(clip.fps for clip in file.clips))
    stem = without_rates(file.path.stem, "motion")
    stems = [f"{stem}_{rate:.10g}fps" if len(rates) > 1 else name_at(file.path.stem, rate) for rate in rates]
    return [
        replace(
            file,
            path=file.path.with_name(f"{stem}.npz"),
            clips=[clip for clip in file.clips if clip.fps == rate],
        )
        for stem, rate in zip(stems, rates, strict=True)
    ]


def check_out(out: Path, form: str) -> None:
    """Raise an error for a file or folder that clips could not be written to.

    Raises:
        OutputError: saying what would be right.
    """
    if out.suffix.lower() == ".npz" and form == "npz":
        check_file(out)
    else:
        check_folder(out, expected="a file .npz, or a folder" if form == "npz" else "a folder for --format csv")


def distinct(clips: Sequence[MotionClip]) -> list[MotionClip]:
    """Return the clips with a number behind a name that was there before."""
    names = distinct_names([clip.name for clip in clips])
    return [replace(clip, name=name) for clip, name in zip(clips, names, strict=True)]


def file_name(name: str) -> str:
    """Return a clip's name without what a file system minds."""
    return "".join(letter if letter.isalnum() or letter in "-_. " else "_" for letter in name).lstrip(".") or "motion"
