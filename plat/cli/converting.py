"""Convert, repair and mirror motion files: ``plat motions convert`` and ``mirror``."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from plat.cli.motion_files import SHORTEST, Lost, at_rate, check_out, common_rate, long_enough, read, tell_lost, write
from plat.cli.options import Convert, Mirror
from plat.cli.together import check_effect
from plat.errors import MotionError
from plat.motions import (
    MotionClip,
    MotionFile,
    ValidationLimits,
    clip_to_limits,
    cut_motion,
    ground_feet,
    level_feet,
    mend_motion,
    mirror_motion,
    smooth_steps,
    trim_motion,
    validate_motions,
)
from plat.robots import get_robot
from plat.words import counted

__all__ = ["convert", "counted_verdicts", "mirror"]


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
    tell_lost(command, skipped, files, lost)
    return written


def mirror(command: Mirror) -> list[Path]:
    """Write the files; return their paths."""
    check_out(command.out, "npz")
    robot = get_robot(command.robot)
    skipped: list[MotionError] = []
    lost = Lost()
    files = []
    for file in read(command, skipped):
        clips = [mirror_motion(clip, robot) for clip in file.clips if long_enough(clip, file.path, SHORTEST)]
        lost.short += len(file.clips) - len(clips)
        files.append(replace(file, clips=clips))
    written = write(command.out, [file for file in files if file.clips], "npz", robot)
    tell_lost(command, skipped, files, lost)
    return written


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
    least = command.limits.min_seconds if command.drop_bad else SHORTEST
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


def counted_verdicts(verdicts: Sequence[str]) -> str:
    """Return ``2 use, 0 repair, 1 drop``."""
    counts = Counter(verdicts)
    return ", ".join(f"{counts[verdict]} {verdict}" for verdict in ("use", "repair", "drop"))
