"""Make motions from human motion capture, and draw maps of skeletons: ``plat motions retarget`` and ``map``."""

import itertools
import re
from contextlib import suppress
from dataclasses import fields, replace
from pathlib import Path

from plat.cli.motion_files import SHORTEST, at_rate, common_rate, distinct_names, long_enough
from plat.cli.options import Map, Retarget
from plat.cli.together import check_effect
from plat.errors import MotionError
from plat.figures import draw_skeleton, pyplot
from plat.files import check_folder, keep_sources
from plat.motions import save_motions
from plat.motions.files import name_at
from plat.motions.paths import names_apart
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
from plat.words import counted, in_table

__all__ = ["draw_maps", "retarget"]

_ANY_RATE = 30.0  # a skeleton is drawn whatever the rate
_PROPOSED = "proposed from names and tree: check every joint, then pass it with --map"


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
        names = distinct_names([name_at(name, command.fps) for name in names])
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
            print(f"skipped: {_of_this(str(result))}", flush=True)
            failed += 1
            if unknown is None and (found := getattr(result, "proposed", None)) is not None:
                unknown = path, found
            continue
        result = replace(result, clip=replace(result.clip, name=name))
        if not long_enough(result.clip, path, SHORTEST):
            failed += 1
            continue
        made.append(result)
        clip, frames = result.clip, len(result.clip.qpos)
        print(
            f"{in_table(clip.name):<44}{frames:>7}{clip.duration:>7.1f}{100 * result.error:>10.2f}"
            f"{1000 * result.penetration:>10.2f}{1000 * result.floating:>10.2f}{100 * result.slip:>11.2f}"
            f"{frames / result.seconds:>6.0f}  {_of_this(', '.join(clip.notes)) or 'as stated'}",
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


def _of_this(told: str) -> str:
    """Return a line with the options that it names as those of this command, where it has them too."""
    own = "|".join(field.name.replace("_", "-") for field in fields(Retarget))
    return re.sub(rf"motions convert (?=--({own})\b)", "motions retarget ", told)


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
