"""Look at motion files, convert them, mirror them, and make them from human motion capture.

plat motions inspect FILES --out pictures
plat motions convert FILES --out motions.npz --repair --cut --drop-bad
plat motions mirror  FILES --out mirrored.npz
plat motions retarget MOCAP --out folder
plat motions map      MOCAP --out folder
"""

from collections.abc import Sequence
from pathlib import Path

import plat.headless  # noqa: F401

# isort: split

from plat.cli.captures import draw_maps, retarget
from plat.cli.converting import convert, counted_verdicts, mirror
from plat.cli.motion_files import GENERATED, distinct_names, file_name, read, unused
from plat.cli.options import Convert, Inspect, Map, Mirror, MotionsCommand
from plat.cli.together import check_effect
from plat.errors import MotionError
from plat.figures import motion_plot, motion_sheet, pyplot, write_figure
from plat.files import check_folder
from plat.motions import MotionClip, MotionFile, MotionReport, ValidationLimits, validate_motions
from plat.motions.retargeting import Retargeted
from plat.rendering import RenderingError, Stage
from plat.robots import G1, Robot, get_robot
from plat.words import counted, in_table


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
        # no clip's picture may be called as the sheet is
        names = distinct_names(["contact_sheet", *(file_name(clip.name) for clip in clips)])[1:]
        for index in chosen:
            picture = command.out / f"{names[index]}.png"
            plot(picture, clips[index], reports[index], command.limits, robot)
        print(f"wrote {command.out}")
    if skipped:
        raise MotionError(f"{unused(skipped, files)}; see above")
    return reports


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


def assumed(file: MotionFile, clip: MotionClip) -> str:
    """Return what a clip was taken for, in short."""
    return ", ".join((f"{clip.fps:.5g} fps", *dict.fromkeys((*file.notes, *clip.notes))))


def with_doubt(file: MotionFile, clip: MotionClip, report: MotionReport) -> str:
    """Return what a clip was taken for, with what nothing in its motion speaks for."""
    told = assumed(file, clip)
    silent = not report.shows_rate and not report.rate_assumed and file.format != GENERATED
    return f"{told}, nothing in the motion confirms this rate" if silent else told


def draw_sheet(path: Path, clips: Sequence[MotionClip], robot: Robot = G1) -> None:
    """Write a row of pictures a clip, where this machine can draw."""
    try:
        stage = Stage(robot, width=240, height=240, distance=2.6)
    except RenderingError as error:
        path.unlink(missing_ok=True)  # of an earlier start
        print(f"no contact sheet: {error}")
        return
    figure = motion_sheet(stage, clips)
    write_figure(figure, path, dpi=110)
    pyplot().close(figure)
    stage.close()


def plot(path: Path, clip: MotionClip, report: MotionReport, limits: ValidationLimits, robot: Robot = G1) -> None:
    """Write the plot of a clip."""
    figure = motion_plot(clip, report, limits, robot)
    write_figure(figure, path, dpi=100)
    pyplot().close(figure)


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
