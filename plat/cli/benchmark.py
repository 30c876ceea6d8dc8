"""Score policies and released trackers on public motions: one table, with what it takes to repeat it.

plat benchmark plat-g1 imagined-g1 --bandai Bandai-Namco-Research-Motiondataset --hard hard_val.npz \
    --trackers.twist2 twist2_1017_20k.onnx --out benchmark
"""

import json
import platform
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import plat.headless  # noqa: F401

# isort: split
from plat.cli.benchmark_page import ABOUT, FIGURES, group_figure, page
from plat.cli.candidates import Loaded, candidates_of, trackers_of
from plat.cli.evaluate import common_control_dt, long_enough, other_window
from plat.cli.options import BenchmarkRecipe
from plat.cli.public_motions import PUBLIC
from plat.cli.together import check_effect
from plat.errors import OutputError, PlatError
from plat.evaluation import RULES, Entrant, EvaluationSetting
from plat.evaluation.cells import Candidate, motions_fingerprint
from plat.evaluation.families import families_of, read_manifest
from plat.evaluation.study import Study, StudyPlan, evenly, group_metrics, run_study, tracker_and_interface
from plat.evaluation.study_files import TABLES, write_study
from plat.figures import (
    difference_plot,
    group_plot,
    horizon_plot,
    pyplot,
    radar_plot,
    robustness_plot,
    save_figure,
    success_plot,
)
from plat.files import check_folder, readable, replace_file
from plat.motions import MotionLibrary
from plat.robots import Robot, get_robot
from plat.runs import on_device
from plat.runs.lock import RunLock
from plat.runs.user_modules import import_modules
from plat.version import __version__
from plat.words import counted

_LONGER = ("distant",)


@dataclass(frozen=True)
class MotionSet:
    """Motions of a section.

    Attributes:
        name: of section and folder.
        source: where they are from, for people.
        library: of pieces of them.
        source_motions: number of the motion that each clip is a piece of.
        families: of the clips.
    """

    name: str
    source: str
    library: MotionLibrary
    source_motions: list[int]
    families: list[str] | None = None


def main(recipe: BenchmarkRecipe) -> dict[str, Study]:
    """Run the recipe; return the results on each set of motions, trackers with their best interface."""
    recipe = on_device(recipe)
    check_together(recipe)
    check_folder(recipe.out, "--out")
    pyplot()  # what is missing had better be said before the evaluation
    import_modules(recipe.imports)
    robot = get_robot(recipe.robot)  # before the policies: a description file makes theirs known
    loaded: Loaded = {}
    candidates = candidates_of(
        recipe.runs,
        recipe.trackers,
        device=recipe.device,
        interfaces=recipe.interface,
        robot=recipe.robot,
        loaded=loaded,
        lists={"--hard": recipe.hard, "--manifest": recipe.manifest},
    )
    names = list(dict.fromkeys(tracker_and_interface(candidate.name)[0] for candidate in candidates))
    if recipe.ours is not None and recipe.ours not in names:
        raise PlatError(f"--ours {recipe.ours!r}: no such row, expected one of {', '.join(names)}")
    trackers = trackers_of(recipe.runs, recipe.trackers, device=recipe.device, robot=recipe.robot, loaded=loaded)
    entrants = {candidate.name: entrant for candidate, entrant in candidates.items()}
    tracks = any(entrant.tracks for entrant in entrants.values())
    check_effect("--interface", recipe.interface != type(recipe).interface, "a dense tracker", tracks)
    control_dt = common_control_dt(entrants, (*recipe.horizons, *recipe.further_horizons))
    lock = RunLock(recipe.out)  # until this ends: one at a time
    sets = motion_sets(recipe, robot, control_dt)
    studies: dict[str, Study] = {}
    write_about(recipe.out, about(recipe, candidates, sets))
    for number, motions in enumerate(sets):
        told = f"{counted(motions.library.num_clips, 'clip')} of {counted(len(set(motions.source_motions)), 'motion')}"
        print(f"\n{motions.name}: {told}, {motions.library.duration:.0f} s", flush=True)
        folder = recipe.out / motions.name
        study = run_study(
            candidates,
            motions.library,
            plan_of(recipe, motions, recipe.ours or names[0], first=number == 0),
            folder=folder / "records",
            workers=recipe.workers or None,
            modules=recipe.imports,
            told=partial(write_study, folder=folder),
            clips=partial(long_enough, motions.library),
            trackers=trackers if number == 0 else {},
        )
        studies[motions.name] = study
        draw(folder, study, control_dt)
        # after each set: what is done can be read while the next one runs; files of an earlier start are not
        replace_file(recipe.out / "benchmark.md", partial(_write, text=page(recipe.out, sets=studies)))
    print(f"\n{recipe.out / 'benchmark.md'}")
    lock.release()
    return studies


def check_together(recipe: BenchmarkRecipe) -> None:
    """Raise an error for options that would be without effect.

    Raises:
        PlatError: naming the option and what it is for.
    """
    default, curves = type(recipe), ("--robustness", recipe.robustness)
    several = recipe.hard or any(getattr(recipe, name) is not None for name in PUBLIC)
    further = "motions beside the generated ones, as of --hard"
    for flag, changed, (needed, there) in (
        ("--manifest", recipe.manifest, ("--hard", recipe.hard)),
        ("--strengths", recipe.strengths != default.strengths, curves),
        ("--robustness-clips", recipe.robustness_clips != default.robustness_clips, curves),
        ("--further-horizons", recipe.further_horizons != default.further_horizons, (further, several)),
    ):
        check_effect(flag, changed, needed, there)


def motion_sets(recipe: BenchmarkRecipe, robot: Robot, control_dt: float) -> list[MotionSet]:
    """Return the sets of motions: those that files were given for, and the generated one.

    Raises:
        PlatError: when two sets have one name.
        OutputError: when the folder of a set is, holds, or is in what is read.
    """
    names = [name for name in PUBLIC if getattr(recipe, name) is not None] + ["generated"]
    for path in recipe.hard:
        if (name := readable(path.stem)) in names:
            raise PlatError(f"--hard {str(path)!r}: there is a set {name!r} already, expected another file name")
        names.append(name)
    _keep_inputs(recipe, names)
    families = read_manifest(recipe.manifest) if recipe.manifest else None
    sets = []

    def add(
        name: str,
        source: str,
        motions: str | Path,
        family: Callable[[list[str]], list[str]] | None,
        found: list[Path] | None = None,
    ) -> None:
        library = MotionLibrary.load([motions], robot, dt=control_dt, found=found)
        cut = library.pieces(recipe.longest)
        chosen = evenly(range(cut.num_clips), recipe.clips or cut.num_clips)
        # pieces are frames of the same table
        sources = library.clip_of(cut.clip_start[list(chosen)]).tolist()
        of_motions = None if family is None else family(library.clip_names)
        of_clips = None if of_motions is None else [of_motions[motion] for motion in sources]
        sets.append(MotionSet(name, source, cut.only(*chosen), sources, of_clips))

    for name, public in PUBLIC.items():
        if (source := getattr(recipe, name)) is not None:
            path = public.file(source, recipe.out, robot)
            add(name, f"{public.says} ({readable(path.name)})", path, None if public.clips is None else public.families)
    for path in recipe.hard:
        files: list[Path] = []
        known = None if families is None else partial(families_of, families=families, files=files)
        add(readable(path.stem), readable(path.name), path, known, files)
    add("generated", f"generated:test@{recipe.generated:g}", f"generated:test@{recipe.generated:g}", _kinds)
    return sets


def _keep_inputs(recipe: BenchmarkRecipe, names: Iterable[str]) -> None:
    given = {f"--{name.replace('_', '-')}": [getattr(recipe, name)] for name in PUBLIC}
    given |= {"--hard": list(recipe.hard), "--manifest": list(recipe.manifest)}
    for flag, paths in given.items():
        for path in paths:
            for folder in (recipe.out / name for name in names) if path is not None else ():
                # what is written into a folder of hard motions would be one of them at the next start
                if folder.resolve() in (path.resolve(), *path.resolve().parents) or (
                    flag == "--hard" and path.resolve() in folder.resolve().parents
                ):
                    told = f"{flag} {str(path)!r}: results go to {str(folder)!r}, which it is in or holds"
                    raise OutputError(f"{told}: give another --out")


def _kinds(clips: list[str]) -> list[str]:
    """Return the families of generated motions, which begin their names."""
    return [clip.partition("_")[0] for clip in clips]


def plan_of(recipe: BenchmarkRecipe, motions: MotionSet, ours: str, first: bool) -> StudyPlan:
    """Return the tests of a set: all of them on the first, those of motion on the others."""
    return StudyPlan(
        horizons=recipe.horizons if first else recipe.further_horizons,
        longer=_LONGER,
        setting=EvaluationSetting(recipe.seed, num_envs=recipe.num_envs, device=recipe.device),
        rules=recipe.rules,
        families=motions.families,
        sources=motions.source_motions,
        difficulty=True,
        robustness=recipe.robustness if first else (),
        strengths=recipe.strengths,
        robustness_clips=recipe.robustness_clips,
        authored=recipe.authored if first else 0,
        choose=True,
        ours=ours,
    )


def about(recipe: BenchmarkRecipe, candidates: Mapping[Candidate, Entrant], sets: list[MotionSet]) -> dict[str, Any]:
    """Return what it takes to repeat the tables, as JSON values."""
    packages = []
    for package in ("mujoco", "torch", "torchrl", "onnxruntime"):
        try:
            packages.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            continue
    rows = {tracker_and_interface(candidate.name)[0]: candidate for candidate in candidates}
    window = other_window(next(iter(candidates.values())).timing)
    return {
        "command": command_of(recipe),
        "versions": [f"plat {__version__}", *packages, platform.machine()],
        "rules": [[rule, RULES[rule].says] for rule in recipe.rules],
        "seed": recipe.seed,
        "longest": recipe.longest,
        "robustness_clips": recipe.robustness_clips,
        **({"window": window} if window else {}),  # said of the usual one, it would end what was begun without
        "sets": [
            [
                one.name,
                one.source,
                one.library.num_clips,
                round(one.library.duration),
                motions_fingerprint(one.library)[:12],
            ]
            for one in sets
        ],
        "rows": [[name, one.weights[:12], one.made_by, one.trained_on] for name, one in rows.items()],
    }


def write_about(folder: Path, told: dict[str, Any]) -> None:
    """Write what a benchmark says of itself; tables and figures of one that said something else are removed."""
    text = json.dumps(told, indent=1) + "\n"
    path = folder / ABOUT
    # one that was begun without a line break at the end goes on
    if path.exists() and path.read_bytes().rstrip() != text.encode().rstrip():
        (folder / "benchmark.md").unlink(missing_ok=True)
        for name, *_ in told["sets"]:
            _remove(folder / name, (*TABLES, *FIGURES))
    replace_file(path, partial(_write, text=text))


def _remove(folder: Path, names: Iterable[str]) -> None:
    """Remove files of an earlier start; others of the folder are not plat's."""
    for name in names:
        (folder / name).unlink(missing_ok=True)


def command_of(recipe: BenchmarkRecipe) -> list[str]:
    """Return the words of the command: what differs from the defaults, with files by their names."""
    default = BenchmarkRecipe(out=recipe.out)
    words = ["plat", "benchmark", *map(_word, recipe.runs)]
    for field in fields(recipe):
        name, value = field.name, getattr(recipe, field.name)
        if name == "trackers":
            given = {one.name: getattr(value, one.name) for one in fields(value)}
            for tracker, path in given.items():
                words += [f"--trackers.{tracker.replace('_', '-')}", _word(path)] if path is not None else []
        elif name not in ("runs", "out", "device", "workers") and value != getattr(default, name):
            words += [f"--{name.replace('_', '-')}", *map(_word, value if isinstance(value, tuple) else (value,))]
    return [*words, "--out", _word(recipe.out)]


def _word(value: Any) -> str:
    if isinstance(value, Path):
        return readable(value.name if value.is_absolute() or ".." in value.parts else str(value))
    return f"{value:g}" if isinstance(value, float) else readable(str(value))


def _write(part: Path, text: str) -> None:
    part.write_text(text, encoding="utf-8")


def draw(folder: Path, study: Study, control_dt: float) -> list[Path]:
    """Draw the figures of a set, in the place of those that were there."""
    _remove(folder, FIGURES)
    scores = study.scores
    usual = [score for score in scores if score.horizon not in _LONGER]
    horizons = {score.horizon for score in usual}
    written = []
    if len(horizons) >= 3:
        written += save_figure(radar_plot(usual), folder / "radar")
    written += save_figure(
        success_plot(scores, [name for name in ("long", "mixed") if name in horizons] or sorted(horizons)),
        folder / "success",
    )
    written += save_figure(horizon_plot(scores, control_dt), folder / "horizon")
    for kind, groups in study.groups.items():
        written += save_figure(group_plot(groups, group_metrics(groups)[0]), folder / group_figure(kind))
    if study.curves:
        written += save_figure(robustness_plot(study.curves), folder / "robustness")
    if study.differences:
        written += save_figure(difference_plot(scores, study.differences[0].ours), folder / "differences")
    return written
