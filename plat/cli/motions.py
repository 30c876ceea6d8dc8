"""Look at motion files, convert them, mirror them, and make them from human motion capture.

plat motions inspect FILES --out pictures
plat motions convert FILES --out motions.npz --repair --cut --drop-bad
plat motions mirror  FILES --out mirrored.npz
plat motions retarget MOCAP --out folder
plat motions map      MOCAP --out folder
"""

import itertools
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

import plat.headless  # noqa: F401

# isort: split

from plat.cli.options import Convert, Inspect, Map, Mirror, MotionFiles, MotionsCommand, Retarget
from plat.cli.together import check_effect
from plat.errors import MotionError, PlatError
from plat.figures import draw_skeleton, pyplot, write_figure
from plat.files import check_file, check_folder, expand_home, keep_sources
from plat.motions import (
    MotionClip,
    MotionFile,
    MotionReport,
    ValidationLimits,
    clip_to_limits,
    cut_motion,
    ground_feet,
    level_feet,
    mend_motion,
    mirror_motion,
    read_motion_files,
    save_csv,
    save_motions,
    smooth_steps,
    trim_motion,
    validate_motions,
)
from plat.motions.checks.feet import Soles
from plat.motions.clip import ASSUMED_RATE
from plat.motions.files import csv_name, csv_stem, name_at
from plat.motions.formats.rate import without_rates
from plat.motions.generation import PREFIX, generate_named
from plat.motions.paths import names_apart
from plat.motions.resample import resample_qpos
from plat.motions.retargeting import (
    Retargeted,
    SkeletonMap,
    UnknownSkeletonError,
    bvh_paths,
    find_map,
    load_map,
    read_capture,
    retarget_all,
    save_map,
    split_of,
    with_joints,
)
from plat.motions.retargeting.retarget import TURNED
from plat.rendering import RenderingError, Stage, stills
from plat.robots import G1, Robot, get_robot
from plat.spec.timing import Timing
from plat.words import counted, in_table

SHEET_COLUMNS = 8
_SHORTEST = Timing().control_dt  # the shortest command, without which no policy has a use for a clip
_ROUNDING = 1e-7
_ANY_RATE = 30.0  # a skeleton is drawn whatever the rate
GENERATED = "generated"
_PROPOSED = "proposed from names and tree: check every joint, then pass it with --map"


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
            raise MotionError(f"{option} is stated of files, and {name!r} is none: plat makes it itself")


def inspect(command: Inspect) -> list[MotionReport]:
    """Print the table, draw; return the reports.

    Raises:
        MotionError: at the end, when files of a folder were left out.
    """
    check_effect("--pictures", command.pictures != type(command).pictures, "--out", command.out)
    if command.out is not None:
        check_folder(command.out)
        pyplot()  # what is missing had better be said before the work
    skipped: list[MotionError] = []
    files = read(command, skipped)
    clips = [clip for file in files for clip in file.clips]
    if not clips:
        raise MotionError(f"no clips in {', '.join(map(repr, command.files))}; see above")
    robot = get_robot(command.robot)
    reports = validate_motions(clips, robot, command.limits)
    sources = [(file, clip) for file in files for clip in file.clips]
    print_table(reports, [with_doubt(*source, report) for source, report in zip(sources, reports, strict=True)])
    if command.out is not None:
        command.out.mkdir(parents=True, exist_ok=True)
        urgency = ("drop", "repair", "use")
        order = sorted(range(len(clips)), key=lambda index: urgency.index(reports[index].verdict))
        chosen = order[: command.pictures]
        draw_sheet(command.out / "contact_sheet.png", [clips[index] for index in chosen], robot)
        sheet = MotionClip("contact_sheet", np.empty(0), 0.0)  # no clip's picture may be called so
        named = distinct([sheet, *(replace(clip, name=file_name(clip.name)) for clip in clips)])[1:]
        for index in chosen:
            picture = command.out / f"{named[index].name}.png"
            plot(picture, clips[index], reports[index], command.limits, robot)
        print(f"wrote {command.out}")
    if skipped:
        raise MotionError(
            f"{len(skipped)} of {counted(len(skipped) + len(files), 'file')} could not be used; see above"
        )
    return reports


def convert(command: Convert) -> list[Path]:
    """Write the files; return their paths."""
    needed = "--repair, --cut, --drop-bad or --smooth-steps"
    judged = command.repair or command.cut or command.drop_bad or command.smooth_steps
    check_effect("--limits", command.limits != ValidationLimits(), needed, judged)
    check_out(command.out, command.format)
    skipped: list[MotionError] = []
    files = read(command, skipped)
    if command.repair and command.resample is None and command.out.suffix.lower() == ".npz":
        command = replace(command, resample=common_rate([clip for file in files for clip in file.clips]))
    verdicts: list[tuple[str, str]] = []
    lost = Lost()
    files = [replace(file, clips=repaired(command, file, lost, verdicts)) for file in files]
    if command.repair:
        for when, which in (("before", 0), ("after", 1)):
            print(f"{when}: {counted_verdicts([pair[which] for pair in verdicts])}")
    written = write(command.out, [file for file in files if file.clips], command.format, get_robot(command.robot))
    tell_lost(command, skipped, len(files), lost)
    return written


def common_rate(clips: Sequence[MotionClip]) -> float | None:
    """Return the frames a second that most of some clips have, by their length, or None where all have the same."""
    seconds = dict.fromkeys((clip.fps for clip in clips), 0.0)
    for clip in clips:
        seconds[clip.fps] += clip.duration
    if len(seconds) < 2:
        return None
    rate = max(seconds, key=lambda fps: seconds[fps])
    print(f"all brought to {rate:.5g} fps, which most have")
    return rate


def tell_lost(command: MotionFiles, skipped: Sequence[MotionError], good: int, lost: Lost) -> None:
    """Say at the end what was not written; what was left out as asked, or found in a folder, is no error.

    Raises:
        MotionError: for files that were named and could not be used, and for clips that were too short.
    """
    counts = {
        f"{len(skipped)} of {counted(len(skipped) + good, 'file')} could not be used": len(skipped),
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


def cut(command: Convert, clip: MotionClip) -> list[MotionClip]:
    """Return the pieces of a clip between its jumps; prints what was done."""
    pieces = cut_motion(clip, get_robot(command.robot), command.limits)
    if len(pieces) != 1 or pieces[0] is not clip:
        seconds = ", ".join(f"{piece.duration:.1f}" for piece in pieces)
        least = f": none has {command.limits.min_seconds:g} s"
        print(
            f"cut {clip.name}, {clip.duration:.1f} s, into {counted(len(pieces), 'clip')}"
            + (f" of {seconds} s" if pieces else least)
        )
    return pieces


def repaired(
    command: Convert, file: MotionFile, lost: Lost, verdicts: list[tuple[str, str]] | None = None
) -> list[MotionClip]:
    """Return the clips of a file with the repairs that were asked for; print those that are dropped.

    Args:
        command: what was asked for.
        file: whose clips are to be repaired.
        lost: counts those that are not among them.
        verdicts: is given the verdict before and after ``--repair`` for each.
    """
    least = command.limits.min_seconds if command.drop_bad else _SHORTEST
    off = sum(command.trim)
    # ends of the clip, and not of each of its pieces
    pieces = [trim_motion(clip, *command.trim) for clip in file.clips if long_enough(clip, file.path, least, off)]
    short = len(file.clips) - len(pieces)
    if command.cut:
        cuts = [cut(command, clip) for clip in pieces]
        lost.dropped += sum(not some for some in cuts)
        pieces = [piece for some in cuts for piece in some]
        long = [piece for piece in pieces if long_enough(piece, file.path, least)]
        short, pieces = short + len(pieces) - len(long), long
    if command.drop_bad:
        lost.dropped += short
    else:
        lost.short += short
    kept = [repair(command, clip, verdicts) for clip in pieces]
    if command.resample is not None:
        kept, before = at_rate(kept, command.resample, file.path), len(kept)
        lost.short += before - len(kept)
    if not command.drop_bad:
        return kept
    reports = validate_motions(kept, get_robot(command.robot), command.limits)
    for report in reports:
        if report.verdict == "drop":
            print(f"dropped {report.name}: {', '.join(report.reasons)}")
            lost.dropped += 1
    return [clip for clip, report in zip(kept, reports, strict=True) if report.verdict != "drop"]


def repair(command: Convert, clip: MotionClip, verdicts: list[tuple[str, str]] | None = None) -> MotionClip:
    """Return one clip with them."""
    robot = get_robot(command.robot)
    if command.smooth_steps:
        smoothed = smooth_steps(clip, command.limits.step_speed, robot)
        if smoothed.steps:
            changed = f"joints changed by {smoothed.largest_change:.2f} rad at most"
            print(f"smoothed {counted(smoothed.steps, 'single-frame step')} of {clip.name}: {changed}")
        clip = smoothed.clip
    if command.clip_limits:
        clip = clip_to_limits(clip, robot)
    if command.level_feet:
        clip = level_feet(clip, robot)
    if command.ground:
        clip = ground_feet(clip, command.ground, robot)
    if command.repair:
        mended = mend_motion(clip, robot, command.limits)
        clip = mended.clip
        if verdicts is not None:
            verdicts.append((mended.before.verdict, mended.after.verdict))
        if mended.before.reasons:
            done = ", ".join(mended.done) or "nothing that could be repaired"
            left = f" ({', '.join(mended.after.reasons)})" if mended.after.reasons else ""
            told = f"{mended.before.verdict} ({', '.join(mended.before.reasons)}) -> {mended.after.verdict}{left}"
            print(f"{clip.name}: {told}: {done}")
    return clip


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


def mirror(command: Mirror) -> list[Path]:
    """Write the files; return their paths."""
    check_out(command.out, "npz")
    robot = get_robot(command.robot)
    skipped: list[MotionError] = []
    lost = Lost()
    files = []
    for file in read(command, skipped):
        clips = [mirror_motion(clip, robot) for clip in file.clips if long_enough(clip, file.path, _SHORTEST)]
        lost.short += len(file.clips) - len(clips)
        files.append(replace(file, clips=clips))
    written = write(command.out, [file for file in files if file.clips], "npz", robot)
    tell_lost(command, skipped, len(files), lost)
    return written


def retarget(command: Retarget) -> list[Retargeted]:
    """Write the files, print a line a clip, return what was made.

    Raises:
        MotionError: at the end, when a file could not be used; the others are written.
    """
    check_folder(command.out)
    told: list[str] = []
    paths = bvh_paths(command.files, told)
    turned = any(path.suffix.lower() in TURNED for path in paths)
    check_effect("--angles", command.angles is not None, "files that have angles, .bvh or .amc", turned)
    skeleton = None if command.map is None else load_map(command.map)
    made, failed = [], 0
    columns = f"{'error cm':>10}{'depth mm':>10}{'float mm':>10}{'slip cm/s':>11}{'f/s':>6}  read as"
    for line in told:
        print(line)
    names = names_apart(paths)
    if command.fps is not None:
        names = [name_at(name, command.fps) for name in names]
        names = [clip.name for clip in distinct([MotionClip(name, np.empty(0), 0.0) for name in names])]
    written = ("train", "val", "test") if command.split else names
    keep_sources(paths, [command.out / f"{name}.npz" for name in written])
    print(f"{'clip':<44}{'frames':>7}{'s':>7}{columns}")
    unknown: tuple[Path, SkeletonMap] | None = None
    results = retarget_all(
        paths,
        skeleton,
        options=command.solver,
        workers=command.workers,
        fps=command.fps,
        up=command.up,
        units=command.units,
        angles=command.angles,
    )
    for path, name, result in zip(paths, names, results, strict=True):
        if isinstance(result, MotionError):
            print(f"skipped: {result}", flush=True)
            failed += 1
            if unknown is None and (found := getattr(result, "proposed", None)) is not None:
                unknown = path, found
            continue
        result = replace(result, clip=replace(result.clip, name=name))
        if not long_enough(result.clip, path, _SHORTEST):
            failed += 1
            continue
        made.append(result)
        clip, frames = result.clip, len(result.clip.qpos)
        print(
            f"{in_table(clip.name):<44}{frames:>7}{clip.duration:>7.1f}{100 * result.error:>10.2f}"
            f"{1000 * result.penetration:>10.2f}{1000 * result.floating:>10.2f}{100 * result.slip:>11.2f}"
            f"{frames / result.seconds:>6.0f}  {', '.join(clip.notes) or 'as stated'}",
            flush=True,
        )
        if not command.split:
            command.out.mkdir(parents=True, exist_ok=True)
            save_motions(command.out / f"{clip.name}.npz", [clip])
    if command.split:
        for split in ("train", "val", "test"):
            clips = [result.clip for result in made if split_of(result.clip.name) == split]
            if clips:
                if (rate := common_rate(clips)) is not None:  # a file has one
                    clips, before = at_rate(clips, rate, command.out / f"{split}.npz"), len(clips)
                    failed += before - len(clips)
                command.out.mkdir(parents=True, exist_ok=True)
                save_motions(command.out / f"{split}.npz", clips)
            print(f"{split}: {counted(len(clips), 'clip')}, {sum(clip.duration for clip in clips):.0f} s")
            if not clips and (earlier := command.out / f"{split}.npz").exists():
                earlier.unlink()  # it would be a split of other captures
                print(f"removed {earlier} of an earlier start")
    if unknown is not None:
        proposed = _propose(command.out / "proposed_map.yaml", unknown[1])
        print(f"wrote {proposed}: a map to check and to pass with --map (plat motions map draws it)")
    if failed:
        raise MotionError(f"{failed} of {counted(len(paths), 'file')} could not be used; see above")
    return made


def _propose(path: Path, skeleton: SkeletonMap) -> Path:
    """Write a proposed map, and return where to: a number is added to the name of one that somebody has corrected."""
    for number in itertools.count(1):
        free = path if number == 1 else path.with_stem(f"{path.stem}_{number}")
        with suppress(MotionError):
            if free.exists() and replace(load_map(free), name=skeleton.name) == skeleton:
                return free
        if not free.exists():
            save_map(free, skeleton, _PROPOSED)
            return free
    raise AssertionError  # numbers do not end


def draw_maps(command: Map) -> list[Path]:
    """Write pictures, and proposed maps; return their paths.

    Raises:
        MotionError: at the end, when a file has no map, or a map that is wrong.
    """
    check_folder(command.out)
    pyplot()  # what is missing had better be said before the work
    paths = bvh_paths(command.files)
    stated = None if command.map is None else load_map(command.map)
    command.out.mkdir(parents=True, exist_ok=True)
    written: list[Path] = []
    wrong = 0
    for path, name in zip(paths, names_apart(paths), strict=True):
        where = f"{path.suffix[1:].upper()} file {str(path)!r}"
        try:
            mocap = read_capture(path, fps=_ANY_RATE)
            skeleton, kind = (
                (find_map(mocap, where), "known") if stated is None else (with_joints(stated, mocap, where), "stated")
            )
        except UnknownSkeletonError as error:
            if error.proposed is None:
                print(f"skipped: {error}")
                wrong += 1
                continue
            skeleton, kind = error.proposed, "proposed"
        except MotionError as error:
            print(f"skipped: {error}")
            wrong += 1
            continue
        if kind == "proposed":
            written.append(_propose(command.out / f"{name}_map.yaml", skeleton))
        written.append(command.out / f"{name}_map.png")
        told = draw_skeleton(written[-1], mocap, skeleton)
        wrong += bool(told)
        print(f"{path}: {kind} map {skeleton.name!r}{f', {told}' if told else ''}; wrote {written[-1]}")
    if wrong:
        raise MotionError(f"no map, or one that looks wrong: {wrong} of {counted(len(paths), 'file')}; see above")
    return written


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
        files = [part for file in files for part in by_rate(file)]
        stems = distinct([MotionClip(file.path.stem, np.empty(0), 0.0) for file in files])
        written = [out / f"{stem.name}.npz" for stem in stems]
        keep_sources(sources, written)
        out.mkdir(parents=True, exist_ok=True)
        for path, file in zip(written, files, strict=True):
            save_motions(path, distinct(file.clips), robot)
    seconds = sum(clip.duration for clip in clips)
    print(f"wrote {counted(len(clips), 'clip')}, {seconds:.0f} s, to {out}")
    if unsure := [clip for clip in clips if ASSUMED_RATE in clip.notes]:
        print(f"of {counted(len(unsure), 'clip')} nothing states the frames a second, as the file says: state --fps")
    return written


def by_rate(file: MotionFile) -> list[MotionFile]:
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
    taken: set[str] = set()
    numbers: defaultdict[str, Iterator[int]] = defaultdict(lambda: itertools.count(2))
    named = []
    for clip in clips:
        name = clip.name
        while name in taken:
            name = f"{clip.name}_{next(numbers[clip.name])}"
        taken.add(name)
        named.append(replace(clip, name=name))
    return named


def assumed(file: MotionFile, clip: MotionClip) -> str:
    """Return what a clip was taken for, in short."""
    return ", ".join((f"{clip.fps:.5g} fps", *dict.fromkeys((*file.notes, *clip.notes))))


def with_doubt(file: MotionFile, clip: MotionClip, report: MotionReport) -> str:
    """Return what a clip was taken for, with what nothing in its motion speaks for."""
    told = assumed(file, clip)
    silent = not report.shows_rate and not report.rate_assumed and file.format != GENERATED
    return f"{told}, nothing in the motion confirms this rate" if silent else told


def print_table(reports: Sequence[MotionReport], read_as: Sequence[str]) -> None:
    """Print one row a clip, and a line about all; ``read_as`` is what each was taken for."""
    width = max(len("clip"), *(min(len(in_table(report.name)), 44) for report in reports))
    print(
        f"\n{'clip':<{width}}  {'length':>7}  {'limits':>7}  {'speed':>6}  {'sunk':>5}  {'float':>5}  {'slip':>5}  "
        f"{'self':>5}  {'jumps':>5}  verdict  [read as]\n"
        f"{'':<{width}}  {'s':>7}  {'rad':>7}  {'rad/s':>6}  {'cm':>5}  {'cm':>5}  {'m/s':>5}  {'cm':>5}"
    )
    for report, told in zip(reports, read_as, strict=True):
        name = in_table(report.name)
        name = name if len(name) <= width else f"{name[: width - 1]}…"
        print(
            f"{name:<{width}}  {report.seconds:>7.2f}  {report.joint_excess:>7.3f}  {report.joint_speed:>6.1f}  "
            f"{100 * report.penetration:>5.1f}  {100 * report.floating:>5.1f}  {report.slip:>5.2f}  "
            f"{100 * report.self_penetration:>5.1f}  {len(report.jumps):>5}  "
            + ": ".join(filter(None, (report.verdict, ", ".join(report.reasons))))
            + f"  [{told}]"
        )
    total = sum(report.seconds for report in reports)
    print(f"{counted(len(reports), 'clip')}, {total:.0f} s: {counted_verdicts([report.verdict for report in reports])}")


def counted_verdicts(verdicts: Sequence[str]) -> str:
    """Return ``2 use, 0 repair, 1 drop``."""
    counts = Counter(verdicts)
    return ", ".join(f"{counts[verdict]} {verdict}" for verdict in ("use", "repair", "drop"))


def limit_line(panel: Any, value: float, told: str) -> None:
    """Draw a limit of the checks, and what it means."""
    if np.isfinite(value):
        panel.axhline(value, color="C3", linewidth=0.8, linestyle="--")
        panel.text(
            0.995, value, told, fontsize=6, color="C3", ha="right", va="bottom", transform=panel.get_yaxis_transform()
        )


def draw_sheet(path: Path, clips: Sequence[MotionClip], robot: Robot = G1) -> None:
    """Draw a row of pictures a clip."""
    try:
        stage = Stage(robot, width=240, height=240, distance=2.6)
    except RenderingError as error:
        path.unlink(missing_ok=True)  # of an earlier start
        print(f"no contact sheet: {error}")
        return
    inches = 1.5
    figure, panels = pyplot().subplots(
        len(clips),
        SHEET_COLUMNS,
        figsize=(inches * SHEET_COLUMNS, 1.3 * inches * len(clips)),
        squeeze=False,
        gridspec_kw={
            "left": 0.005,
            "right": 0.995,
            "bottom": 0,
            "top": 1 - 0.25 / len(clips),
            "hspace": 0.3,
            "wspace": 0.03,
        },
    )
    for row, clip in zip(panels, clips, strict=True):
        for panel, frame, picture in zip(row, *stills(stage, clip.qpos, SHEET_COLUMNS), strict=True):
            panel.imshow(picture)
            panel.set_axis_off()
            panel.set_title(f"{frame / clip.fps:.1f} s", fontsize=7, pad=2)
        row[0].text(0, 1.16, clip.name, fontsize=8, transform=row[0].transAxes)
    write_figure(figure, path, dpi=110)
    pyplot().close(figure)
    stage.close()


def plot(path: Path, clip: MotionClip, report: MotionReport, limits: ValidationLimits, robot: Robot = G1) -> None:
    """Plot joint angles within their limits, heights of the soles, and speeds over time, with limits of checks."""
    time = np.arange(len(clip.qpos)) / clip.fps
    low, high = robot.joint_range.numpy().T
    figure, panels = pyplot().subplots(3, 1, figsize=(9, 8), sharex=True, layout="constrained")
    share = (clip.qpos[:, 7:] - low) / (high - low)
    reach = np.abs(share - 0.5).max(0)
    for joint, name in enumerate(robot.joint_names):
        label = name.replace("_", " ") if joint in reach.argsort()[-5:] else None
        panels[0].plot(time, share[:, joint], color=None if label else "0.8", label=label, zorder=2 if label else 1)
    panels[0].axhspan(0, 1, color="0.95", zorder=0)
    panels[0].set(ylabel="joint angle within its limits", ylim=(-0.15, 1.15), title=clip.name)
    panels[0].legend(fontsize=7, ncols=5, loc="lower center", frameon=False)
    height = Soles(robot).points(torch.from_numpy(clip.qpos))[..., 2].amin(-1).numpy()
    for foot, side in enumerate(("left", "right")):
        panels[1].plot(time, 100 * height[:, foot], label=side)
    panels[1].axhline(0, color="0.3", linewidth=0.8)
    for value, told in ((limits.floating, "rests higher: repair"), (-limits.penetration, "lower: repair")):
        limit_line(panels[1], 100 * value, told)
    panels[1].set(ylabel="lowest point of the sole (cm)")
    panels[1].legend(fontsize=7, frameon=False)
    steps = np.diff(clip.qpos, axis=0) * clip.fps
    panels[2].plot(time[1:], np.abs(steps[:, 7:]).max(1), color="C2")
    limit_line(panels[2], limits.joint_speed, "faster: drop")
    limit_line(panels[2], limits.step_speed, "faster, and in one frame alone: repair")
    for step in report.steps:
        panels[2].plot((step.frame + 1) / clip.fps, step.speed, "x", color="C3")
    for moment in report.jumps:
        for panel in panels:
            panel.axvline(moment, color="C3", linewidth=0.8, linestyle=":")
    panels[2].set(ylabel="fastest joint (rad/s)", xlabel="s; dotted red: the root jumps")
    root = panels[2].twinx()
    root.plot(time[1:], np.linalg.norm(steps[:, :3], axis=1), color="C4", linewidth=1)  # limits are C3
    root.set_ylabel("root (m/s)", color="C4")
    write_figure(figure, path, dpi=100)
    pyplot().close(figure)


def file_name(name: str) -> str:
    """Return a clip's name without what a file system minds."""
    return "".join(letter if letter.isalnum() or letter in "-_. " else "_" for letter in name).lstrip(".") or "motion"


def main(command: MotionsCommand) -> list[MotionReport] | list[Path] | list[Retargeted]:
    """Run a command; return what it made."""
    if not command.files:
        name = type(command).__name__.lower()
        raise MotionError(f"no files: give motion files, folders or globs, as in plat motions {name} clips.npz")
    if isinstance(command, Inspect):
        return inspect(command)
    if isinstance(command, Convert):
        return convert(command)
    if isinstance(command, Mirror):
        return mirror(command)
    if isinstance(command, Map):
        return draw_maps(command)
    return retarget(command)
