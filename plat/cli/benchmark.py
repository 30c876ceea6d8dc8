"""Score policies and released trackers on public motions: one table, with what it takes to repeat it.

plat benchmark plat-g1 imagined-g1 --bandai Bandai-Namco-Research-Motiondataset --hard hard_val.npz \
    --trackers.twist2 twist2_1017_20k.onnx --out benchmark
"""

import platform
import shlex
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import plat.headless  # noqa: F401

# isort: split
from plat.cli.candidates import candidates_of
from plat.cli.evaluate import common_control_dt
from plat.cli.options import BenchmarkRecipe
from plat.envs.transforms import HORIZONS
from plat.errors import PlatError
from plat.evaluation import RULES, Entrant, EvaluationSetting, differences, markdown
from plat.evaluation.cells import Candidate, motions_fingerprint
from plat.evaluation.families import families_of, read_manifest
from plat.evaluation.study import Study, StudyPlan, best_interfaces, group_metric, run_study
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
from plat.files import check_folder, replace_file
from plat.motions import MotionLibrary
from plat.motions.files import load_motions, save_motions
from plat.motions.paths import find_files
from plat.motions.split import split_of
from plat.robots import Robot, get_robot
from plat.runs import on_device
from plat.runs.user_modules import import_modules
from plat.version import __version__

_PAPER = ("single", "short", "medium", "long", "mixed")


@dataclass(frozen=True)
class MotionSet:
    """Motions of a section."""

    name: str
    source: str
    library: MotionLibrary
    families: list[str] | None = None


def main(recipe: BenchmarkRecipe) -> dict[str, Study]:
    """Run the recipe; return the results on each set of motions, trackers with their best interface."""
    recipe = on_device(recipe)
    check_folder(recipe.out, "--out")
    pyplot()  # what is missing had better be said before the evaluation
    import_modules(recipe.imports)
    candidates = candidates_of(
        recipe.runs, recipe.trackers, device=recipe.device, interfaces=recipe.interface, robot=recipe.robot
    )
    entrants = {candidate.name: entrant for candidate, entrant in candidates.items()}
    control_dt = common_control_dt(entrants, _PAPER)
    sets = motion_sets(recipe, get_robot(recipe.robot), control_dt)
    studies: dict[str, Study] = {}
    sections: list[str] = []
    for number, motions in enumerate(sets):
        print(f"\n{motions.name}: {motions.library.num_clips} motions, {motions.library.duration:.0f} s", flush=True)
        folder = recipe.out / motions.name
        study = run_study(
            candidates,
            motions.library,
            plan_of(recipe, entrants, motions, first=number == 0),
            folder=folder / "records",
            workers=recipe.workers or None,
            modules=recipe.imports,
            told=partial(Study.write, folder=folder),
        )
        chosen = study.of(best_interfaces(study.scores, "mixed"))
        studies[motions.name] = chosen
        sections.append(section(motions, study, chosen, recipe.ours))
        draw(folder, chosen, recipe.ours)
        # after each set: what is done can be read while the next one runs
        text = "\n".join([head(recipe, candidates, sets), *sections])
        replace_file(recipe.out / "benchmark.md", partial(Path.write_text, data=text, encoding="utf-8"))
    print(f"\n{recipe.out / 'benchmark.md'}")
    return studies


def motion_sets(recipe: BenchmarkRecipe, robot: Robot, control_dt: float) -> list[MotionSet]:
    """Return the sets of motions: those that files were given for, and the generated one."""
    families = read_manifest(recipe.manifest) if recipe.manifest else None
    sets = []
    if recipe.bandai is not None:
        path = bandai_motions(recipe.bandai, recipe.out, robot)
        library = thinned(MotionLibrary.load([path], robot, dt=control_dt), recipe.every)
        sets.append(MotionSet("bandai", f"Bandai-Namco Research Motion Dataset, split val ({path.name})", library))
    for path in recipe.hard:
        library = thinned(MotionLibrary.load([path], robot, dt=control_dt), recipe.every)
        of_clips = families_of(library.clip_names, families) if families is not None else None
        sets.append(MotionSet(path.stem, path.name, library, of_clips))
    generated = f"generated:test@{recipe.generated:g}"
    library = thinned(MotionLibrary.load([generated], robot, dt=control_dt), recipe.every)
    of_clips = [name.partition("_")[0] for name in library.clip_names]
    return [*sets, MotionSet("generated", generated, library, of_clips)]


def thinned(library: MotionLibrary, every: int) -> MotionLibrary:
    """Return every n-th motion."""
    return library if every == 1 else library.only(*range(0, library.num_clips, every))


def bandai_motions(source: Path, out: Path, robot: Robot) -> Path:
    """Return the motion file of the validation split: retarget a folder of ``.bvh`` files once."""
    if source.is_file():
        return source
    path = out / "motions" / "bandai_val.npz"
    if not path.exists():
        files = [file for file in find_files(source, {".bvh"}) if split_of(file.stem) == "val"]
        if not files:
            raise PlatError(f"--bandai {str(source)!r}: no .bvh file of the split val in it")
        print(f"retargeting {len(files)} files", flush=True)
        clips = load_motions(files, robot)
        replace_file(path, lambda part: save_motions(part, clips, robot))
    return path


def plan_of(recipe: BenchmarkRecipe, entrants: Mapping[str, Entrant], motions: MotionSet, first: bool) -> StudyPlan:
    """Return the tests of a set."""
    horizons = list(_PAPER)
    longest = {entrant.timing.max_steps for entrant in entrants.values()}
    if min(longest) >= HORIZONS["distant"].longest:
        horizons.append("distant")
    return StudyPlan(
        horizons=horizons,
        setting=EvaluationSetting(recipe.seed, num_envs=recipe.num_envs, device=recipe.device),
        rules=(recipe.rule,),
        families=motions.families,
        difficulty=True,
        robustness=recipe.robustness if first else (),
    )


def head(recipe: BenchmarkRecipe, candidates: Mapping[Candidate, Entrant], sets: list[MotionSet]) -> str:
    """Return what it takes to repeat the table."""
    packages = []
    for package in ("mujoco", "torch", "torchrl", "onnxruntime"):
        try:
            packages.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            continue
    lines = [
        "# Results",
        "",
        "Written by `plat benchmark`; see [evaluation](evaluation.md) for what is measured.",
        "",
        "```sh",
        shlex.join(["plat", "benchmark", *sys.argv[2:]] if sys.argv[1:2] == ["benchmark"] else ["plat", "benchmark"]),
        "```",
        "",
        f"- plat {__version__}, {', '.join(packages)}, {platform.machine()}",
        f"- success rule of whole clips: `{recipe.rule}` ({RULES[recipe.rule].says})",
        f"- seed {recipe.seed} of the commands; intervals are 95 %, bootstrapped over motions",
        "- intervals of each value in parentheses; files hold meters, tables millimeters",
        "",
        "| set | motions | clips | seconds | fingerprint |",
        "|---|---|---|---|---|",
        *(
            f"| {one.name} | {one.source} | {one.library.num_clips} | {one.library.duration:.0f} | "
            f"`{motions_fingerprint(one.library)[:12]}` |"
            for one in sets
        ),
        "",
        "| row | fingerprint |",
        "|---|---|",
        *(f"| {candidate.name} | `{candidate.fingerprint[:12]}` |" for candidate in candidates),
        "",
    ]
    return "\n".join(lines)


def section(motions: MotionSet, study: Study, chosen: Study, ours: str | None) -> str:
    """Return the tables of a set."""
    parts = [f"## {motions.name}\n", markdown(chosen.scores)]
    ours = ours or chosen.scores[0].policy
    compared = [score for score in chosen.scores if score.horizon in ("long", "mixed")]
    if difference := differences(compared, ours):
        parts.append(f"Paired differences. **Bold**: {ours} is ahead beyond chance. *Italic*: it is behind.\n")
        parts.append(difference)
    parts.append(chosen.markdown())
    others = [score for score in study.scores if ", " in score.policy and score.horizon == "mixed"]
    if others:
        parts.append("**interfaces of dense trackers**: each as it is told of its keyframe\n")
        parts.append(markdown(others).split("\n\n")[0] + "\n")
    parts.append(
        "Calm and everyday motion saturates TKS@3: rows differ on brisk and hard motion, and in their errors.\n"
    )
    return "\n".join(parts)


def draw(folder: Path, study: Study, ours: str | None) -> list[Path]:
    """Draw the figures of a set."""
    scores = study.scores
    written = save_figure(radar_plot(scores), folder / "radar")
    written += save_figure(success_plot(scores, ("long", "mixed")), folder / "success")
    written += save_figure(horizon_plot(scores), folder / "horizon")
    for kind, groups in study.groups.items():
        name = kind.partition(",")[0] + ("_clips" if "," in kind else "")
        written += save_figure(group_plot(groups, group_metric(groups)), folder / f"by_{name}")
    if study.curves:
        written += save_figure(robustness_plot(study.curves), folder / "robustness")
    if len({score.policy for score in scores}) > 1:
        written += save_figure(difference_plot(scores, ours or scores[0].policy), folder / "differences")
    return written
