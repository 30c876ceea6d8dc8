"""Score policies on motions: timed keyframe tracking, the same commands for each.

plat evaluate runs/plat runs/dagger runs/expert --motions clips.npz --horizon mixed
"""

import time
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path

import plat.headless  # noqa: F401

# isort: split
from plat.cli.candidates import candidates_of
from plat.cli.options import EvaluateRecipe
from plat.cli.together import check_effect
from plat.control.authored import FAMILIES
from plat.envs.transforms import HORIZONS, RandomizationRanges, horizon_named
from plat.envs.transforms.settings import robot_ranges
from plat.errors import OutputError, PlatError, RecordsError
from plat.evaluation import HEADLINE, METRICS, Entrant, EvaluationSetting, Score, markdown, write_csv
from plat.evaluation.authored_cells import records_of_all
from plat.evaluation.authored_playback import play_authored
from plat.evaluation.authored_rollout import Pushes
from plat.evaluation.authored_scores import (
    AuthoredRecords,
    author_families,
    authored_table,
    remove_authored_csv,
    write_authored_csv,
)
from plat.evaluation.cells import Candidate
from plat.evaluation.disturbance import Disturbance
from plat.evaluation.families import families_of, read_manifest
from plat.evaluation.groups import GroupScore
from plat.evaluation.score_table import COLUMNS, rows
from plat.evaluation.study import Study, StudyPlan, run_study
from plat.evaluation.study_files import TABLES as TABLES_OF_STUDY
from plat.evaluation.study_files import read_study, write_study
from plat.figures import ablation_bars, film_strip, group_plot, pyplot, radar_plot, save_figure, success_plot
from plat.files import TABLES, check_file, check_folder, keep_sources, replace_file
from plat.motions import MotionLibrary
from plat.rendering import Playback, RenderingError, Stage
from plat.robots import get_robot
from plat.runs import check_logger, log_table, on_device, start_logging
from plat.runs.lock import RunLock
from plat.runs.user_modules import import_modules
from plat.spec.timing import Timing
from plat.words import counted

SCORES_PAGE, SCORES_TABLE = "scores.md", "scores.csv"
"""Files of ``--out``: all tables as a page, and the scores of commands."""

_FEW = 10  # motions: a bootstrap over fewer holds the true value in less than 88 % of cases, and not in 95 %
BY_DIFFICULTY = "by_difficulty"
FIGURES = ("radar", "success", "film_strip", *(f"bars_{horizon}" for horizon in HORIZONS), BY_DIFFICULTY)
"""Names of all figures of scores, without ending."""


def main(recipe: EvaluateRecipe) -> list[Score]:
    """Run the recipe: print a table, return its rows."""
    recipe = on_device(recipe)
    if recipe.csv is not None:
        check_file(recipe.csv, "--csv", TABLES)
        keep_sources(recipe.manifest, [recipe.csv, authored_csv(recipe.csv)], "--csv")
    for folder, flag in ((recipe.figures, "--figures"), (recipe.strips, "--strips")):
        if folder is not None:
            check_folder(folder, flag)
            pyplot()  # what is missing had better be said before the evaluation
    for logger in recipe.loggers:
        check_logger(logger)
    import_modules(recipe.imports)
    robot = get_robot(recipe.robot)
    if recipe.out is not None:
        check_folder(recipe.out, "--out")
        keep_sources(recipe.manifest, written_into(recipe.out))
        others = [path.resolve() for path in written_into(recipe.out) if path.name != SCORES_TABLE]
        if recipe.csv is not None and recipe.csv.resolve() in others:
            raise OutputError(f"--csv {str(recipe.csv)!r}: --out writes that file itself: give another name")
    check_together(recipe)
    found = candidates_of(
        recipe.runs,
        recipe.trackers,
        device=recipe.device,
        dense=recipe.dense,
        interfaces=recipe.interface,
        robot=recipe.robot,
        lists={"--motions": recipe.motions, "--manifest": recipe.manifest},
    )
    entrants = {candidate.name: entrant for candidate, entrant in found.items()}
    told = not recipe.dense and any(entrant.tracks for entrant in entrants.values())
    check_effect("--interface", recipe.interface != type(recipe).interface, "a dense tracker and no --dense", told)
    lock = None if recipe.out is None else RunLock(recipe.out / "records")  # until this ends: one at a time
    read: list[Path] = []
    library = MotionLibrary.load(recipe.motions, robot, dt=common_control_dt(entrants, recipe.horizon), found=read)
    if recipe.csv is not None:
        keep_sources(read, [recipe.csv, authored_csv(recipe.csv)], "--csv")
    if recipe.only is not None:
        library = library.only(*library.named(recipe.only))
    shown = first_named(library, recipe.clip)
    intervals = "95 % intervals over motions in parentheses"
    if library.num_clips == 1:
        intervals = "intervals over one motion say nothing of others"
    elif library.num_clips < _FEW:
        intervals += ", too narrow over so few"
    print(f"{counted(library.num_clips, 'motion')}, {library.duration:.0f} s; {intervals}")
    families = families_of(library.clip_names, read_manifest(recipe.manifest), read) if recipe.manifest else None
    plan = StudyPlan(
        horizons=recipe.horizon,
        setting=EvaluationSetting(
            recipe.seed,
            recipe.randomization if recipe.domain_randomization else robot_ranges(recipe.disturbed),
            Disturbance(noise=recipe.disturbed) if recipe.disturbed else None,
            num_envs=recipe.num_envs,
            device=recipe.device,
            partial=recipe.partial,
        ),
        rules=recipe.whole_clips,
        families=families,
        difficulty=recipe.difficulty,
        robustness=recipe.robustness,
    )
    conditions = conditions_of(recipe, next(iter(entrants.values())).timing)
    if conditions:
        print(f"conditions: {conditions}")
    if recipe.out is not None:
        tell_replaced(recipe.out, entrants, recipe.horizon)
    print_head()
    study = run_study(
        found,
        library,
        plan,
        folder=recipe.out and recipe.out / "records",
        workers=recipe.workers or None,
        modules=recipe.imports,
        told=Teller(recipe, conditions),
        clips=partial(long_enough, library),
    )
    scores = study.scores
    if tables := study.markdown():
        print(f"\n{tables}", end="")
    write_page(recipe, conditions, study)
    pictures: list[Path] = []
    if recipe.authored:
        score_authored(recipe, found, library, study, plan.setting, conditions)
        if recipe.strips is not None:
            pictures += draw_authored_strips(recipe, recipe.strips, entrants, library)
            remove_figures(recipe.strips, [f"authored_{family}" for family in FAMILIES], pictures)
    if recipe.figures is not None:
        pictures += draw_scores(recipe.figures, scores)
        if recipe.partial or recipe.disturbed or recipe.domain_randomization:
            print("no film strip: it shows whole keyframes and an undisturbed robot, which these scores are not of")
        else:
            pictures += draw_strips(
                recipe.figures, entrants, library, shown, recipe.horizon, recipe.seed, recipe.device
            )
        remove_figures(recipe.figures, [stem for stem in FIGURES if stem != BY_DIFFICULTY], pictures)
    if written := written_by(recipe, pictures):
        print(f"\nwrote {', '.join(map(str, written))}")
    if recipe.loggers:
        settings = {
            "runs": [str(run) for run in recipe.runs],
            "motions": recipe.motions,
            "dense": recipe.dense,
            "domain_randomization": recipe.domain_randomization,
            "disturbed": recipe.disturbed,
        }
        for logger in recipe.loggers:
            run = start_logging(logger, "evaluation", Path(), settings)
            log_table(run, "evaluation", COLUMNS, rows(scores), pictures)
            run.finish()
    if lock is not None:
        lock.release()
    return scores


def check_together(recipe: EvaluateRecipe) -> None:
    """Raise an error for options that would be without effect, or mean something else, beside others.

    Raises:
        PlatError: naming both.
    """
    disturbed = ("--disturbed", recipe.disturbed)
    randomized = ("--domain-randomization", recipe.domain_randomization)
    partial = ("--partial", recipe.partial)
    robustness = ("--robustness", recipe.robustness, "measures one disturbance at a time")
    authored = ("--authored", recipe.authored)
    for (flag, given, why), (other, there) in (
        ((*disturbed, "has randomization of its own"), randomized),
        (("--whole-clips", recipe.whole_clips, "judges whole poses"), partial),
        (robustness, disturbed),
        (robustness, randomized),
        ((*authored, "scores robots that nothing but --pushes disturbs"), disturbed),
        ((*authored, "scores robots that nothing but --pushes disturbs"), randomized),
        ((*authored, "has families that say what they command"), partial),
        ((*authored, "has no motion between its keyframes"), ("--dense", recipe.dense)),
    ):
        if given and there:
            raise PlatError(f"{flag}: {why}, expected no {other} beside it; run {other} without {flag}")
    for flag, changed, (needed, there) in (
        ("--pushes", recipe.pushes, authored),
        ("--strips", recipe.strips is not None, authored),
        ("--clip", recipe.clip is not None, ("--figures", recipe.figures is not None)),
        ("--randomization", recipe.randomization != RandomizationRanges(), randomized),
    ):
        check_effect(flag, changed, needed, there)


def conditions_of(recipe: EvaluateRecipe, timing: Timing) -> str:
    """Return what a test has of its own, in words: scores of it are not those of the usual one.

    Headings of tables say TKS@3. The conditions say so where the policies' arrival window is another.
    """
    told = {
        f"partial keyframes ({recipe.partial})": recipe.partial,
        "dense reference": recipe.dense,
        f"interface {recipe.interface[0]}": len(recipe.interface) == 1 and recipe.interface != type(recipe).interface,
        "domain randomization": recipe.domain_randomization,
        f"disturbed {recipe.disturbed:g}": recipe.disturbed,
        f"only {recipe.only}": recipe.only,
    }
    return ", ".join(filter(None, (other_window(timing), *(words for words, given in told.items() if given))))


def other_window(timing: Timing) -> str:
    """Return what there is to say where headings have @3 and the arrival window is another; "" where it is 3."""
    told = f"arrival window of {counted(timing.window, 'control step')}, not {Timing().window}"
    return told if timing.window != Timing().window else ""


def tell_replaced(folder: Path, policies: Collection[str], horizons: Collection[str]) -> None:
    """Say which rows of the table in a folder are none of this evaluation, which replaces it."""
    others: dict[str, list[str]] = {}
    with suppress(RecordsError):
        for score in read_study(folder).scores:
            if score.policy not in policies or score.horizon not in horizons:
                others.setdefault(score.policy, []).append(score.horizon)
    if others:
        told = "; ".join(f"{policy} at {', '.join(names)}" for policy, names in others.items())
        print(f"tables in {str(folder)!r} are replaced, which were of {told}: their records stay")


def write_page(recipe: EvaluateRecipe, conditions: str, study: Study, authored: Sequence[str] = ()) -> None:
    """Write the page of all tables that there are so far into the folder for them."""
    if recipe.out is not None:
        told = conditions and f"Conditions: {conditions}.\n"
        text = "\n".join(filter(None, (told, markdown(study.scores), study.markdown(), *authored)))
        replace_file(recipe.out / SCORES_PAGE, lambda part: part.write_text(text, encoding="utf-8"))


def written_by(recipe: EvaluateRecipe, pictures: Sequence[Path]) -> list[Path]:
    """Return the tables, folders and figures that are there now, of those that were asked for."""
    tables = [recipe.csv] if recipe.csv is not None else []
    if recipe.csv is not None and recipe.authored:
        tables.append(authored_csv(recipe.csv))
    folders = [recipe.out] if recipe.out is not None else []
    return [path for path in (*tables, *folders) if path.exists()] + list(dict.fromkeys(pictures))


def written_into(folder: Path) -> list[Path]:
    """Return the files of the folder for tables that are replaced."""
    return [folder / name for name in (SCORES_PAGE, authored_csv(Path(SCORES_TABLE)), *TABLES_OF_STUDY)]


class Teller:
    """Line of the table for each score as it comes, and files that hold what there is so far."""

    def __init__(self, recipe: EvaluateRecipe, conditions: str):
        self._recipe = recipe
        self._conditions = conditions
        self._told = 0
        self._begun = False
        self._since = time.monotonic()

    def __call__(self, study: Study) -> None:
        """Print the scores that are new."""
        if not self._begun:  # what is not replaced below is of an earlier start
            for path in tables_of(self._recipe):
                remove_authored_csv(authored_csv(path))
        self._begun = True
        for score in study.scores[self._told :]:
            print_score(score, time.monotonic() - self._since)
        if len(study.scores) > self._told and self._recipe.csv is not None:
            write_csv(self._recipe.csv, study.scores, self._conditions)
        self._told, self._since = len(study.scores), time.monotonic()
        if self._recipe.out is not None:
            write_study(study, self._recipe.out, self._conditions)
            write_page(self._recipe, self._conditions, study)


def fitting(library: MotionLibrary, horizon: str) -> list[int]:
    """Return the numbers of the motions that a horizon's shortest command fits into."""
    shortest = HORIZONS[horizon].shortest if horizon in HORIZONS else 1
    kept: list[int] = (library.clip_length - 1 >= shortest).nonzero()[:, 0].tolist()
    return kept


def long_enough(library: MotionLibrary, horizon: str) -> list[int]:
    """Return the numbers of the motions that a horizon's shortest command fits into; say how many are left out.

    Raises:
        PlatError: when none is long enough.
    """
    kept = fitting(library, horizon)
    if len(kept) == library.num_clips:
        return kept
    shortest, short = HORIZONS[horizon].shortest, library.num_clips - len(kept)
    are = "is" if short == 1 else "are"
    told = f"horizon {horizon!r}: {short} of {counted(library.num_clips, 'motion')} {are} "
    told += f"shorter than {shortest * library.dt:g} s, its shortest command"
    if not kept:
        raise PlatError(f"{told}: give longer ones or a shorter horizon (--horizon)")
    print(f"{told}, and {are} left out")
    return kept


def common_control_dt(entrants: Mapping[str, Entrant], horizons: Sequence[str]) -> float:
    """Return the control step (s) of all entrants, by which motions are sampled.

    Raises:
        PlatError: when the entrants differ in it or in their arrival window, or cannot all be given the same commands
            at a horizon.
    """
    steps = {name: entrant.timing.control_dt for name, entrant in entrants.items()}
    if len(set(steps.values())) > 1:
        told = ", ".join(f"{name} {step:g} s" for name, step in steps.items())
        raise PlatError(f"policies of different control steps: {told}; score those of each step separately")
    windows = {name: entrant.timing.window for name, entrant in entrants.items()}
    if len(set(windows.values())) > 1:
        told = ", ".join(f"{name} {window}" for name, window in windows.items())
        raise PlatError(f"policies of different arrival windows: {told} control steps; score those of each separately")
    for horizon in horizons:
        lengths = {name: _longest(name, entrant, horizon) for name, entrant in entrants.items()}
        if len(set(lengths.values())) > 1:
            told = ", ".join(f"{name} {length}" for name, length in lengths.items())
            raise PlatError(f"horizon {horizon!r}: longest commands of {told} control steps, expected them all alike")
    return next(iter(steps.values()))


def _longest(name: str, entrant: Entrant, horizon: str) -> int:
    """Return the control steps of a horizon's longest command, for an entrant that knows as many."""
    try:
        return horizon_named(horizon, entrant.timing).longest
    except PlatError as error:
        raise type(error)(f"{name}: {error}") from None


def score_authored(
    recipe: EvaluateRecipe,
    entrants: Mapping[Candidate, Entrant],
    library: MotionLibrary,
    study: Study,
    setting: EvaluationSetting,
    conditions: str,
) -> None:
    """Print a table of authored keyframes for every entrant, and write what there is so far, beside the study."""
    scored: dict[str, AuthoredRecords] = {}
    tables = []
    folder, pushes = recipe.out and recipe.out / "records", pushes_of(recipe)
    pushed = f"pushes of {recipe.pushes:g} m/s every 1.5 s" if pushes else ""
    told = ", ".join(filter(None, (conditions, pushed)))
    for candidate, records in records_of_all(entrants, library, recipe.authored, setting, folder, pushes):
        scored[candidate.name] = records
        head = ", ".join(filter(None, (candidate.name, "authored keyframes", pushed)))
        table = authored_table(records)
        print(f"\n{head}\n{table}", end="", flush=True)
        tables.append(f"{head}\n\n{table}")
        for path in tables_of(recipe):
            write_authored_csv(authored_csv(path), scored, told)
        write_page(recipe, conditions, study, tables)


def tables_of(recipe: EvaluateRecipe) -> list[Path]:
    """Return the tables of scores that are asked for."""
    tables = [recipe.csv] if recipe.csv is not None else []
    return tables + ([recipe.out / SCORES_TABLE] if recipe.out is not None else [])


def authored_csv(scores: Path) -> Path:
    """Return the table of authored keyframes that goes beside one of scores."""
    return scores.with_stem(f"{scores.stem}_authored")


def pushes_of(recipe: EvaluateRecipe) -> Pushes | None:
    """Return the pushes that were asked for."""
    return Pushes(recipe.pushes, seed=recipe.seed) if recipe.pushes else None


def draw_authored_strips(
    recipe: EvaluateRecipe, folder: Path, entrants: Mapping[str, Entrant], library: MotionLibrary
) -> list[Path]:
    """Draw a film strip of the first chain of each family; where this machine cannot, say what to install."""
    playbacks: dict[str, dict[str, Playback]] = {}
    for name, entrant in entrants.items():
        motions = library.for_robot(entrant.robot)
        if not (chains := author_families(entrant.robot, motions, 1, recipe.seed, entrant.timing)):
            continue
        observe = entrant.view.keyframes().transforms
        played = play_authored(
            entrant.policy, entrant.robot, chains, observe=observe, pushes=pushes_of(recipe), device=recipe.device
        )
        for chain, playback in zip(chains, played, strict=True):
            playbacks.setdefault(chain.family, {})[name] = playback
    written = []
    try:
        with Stage(library.robot, width=400, height=440, distance=2.2) as stage:
            for family, of_family in playbacks.items():
                strip = film_strip(stage, of_family, commands=6, last="held")
                written += save_figure(strip, folder / f"authored_{family}")
    except RenderingError as error:
        print(f"no film strips: {error}")
    return written


def first_named(library: MotionLibrary, pattern: str | None) -> int:
    """Return the number of the first motion, or of the first one whose name a regular expression is found in."""
    return 0 if pattern is None else library.named(pattern)[0]


def print_head() -> None:
    """Print the headings of the lines that :func:`print_score` prints."""
    print(f"{'policy':<21} {'horizon':<9}{'TKS@3 %':<21}{'MPJPE@3 rad':<22}{'MPKPE@3 mm':<22}{'falls %':<9}seconds")


def print_score(score: Score, seconds: float) -> None:
    """Print a line of the table."""
    cells = (METRICS[name].text(score.figures[name]) for name in HEADLINE)
    falls = METRICS["fall_rate"].text(score.figures["fall_rate"].value)
    tks, mpjpe, mpkpe = cells
    print(f"{score.policy:<21} {score.horizon:<9}{tks:<21}{mpjpe:<22}{mpkpe:<22}{falls:<9}{seconds:.0f}", flush=True)


def draw_scores(folder: Path, scores: Sequence[Score]) -> list[Path]:
    """Draw radar plot (of three horizons or more), bars and success curves; what was written."""
    horizons = list(dict.fromkeys(score.horizon for score in scores))
    written = []
    if len(horizons) >= 3:
        written += save_figure(radar_plot(scores), folder / "radar")
    for horizon in horizons:
        written += save_figure(ablation_bars(scores, horizon), folder / f"bars_{horizon}")
    shown = [horizon for horizon in horizons if horizon in ("long", "mixed")] or horizons
    return written + save_figure(success_plot(scores, shown), folder / "success")


def remove_figures(folder: Path, stems: Iterable[str], drawn: Collection[Path]) -> None:
    """Remove figures of an earlier start that were not drawn now."""
    for path in (folder / f"{stem}.{kind}" for stem in stems for kind in ("pdf", "png")):
        if path not in drawn:
            path.unlink(missing_ok=True)


def draw_groups(folder: Path, groups: Sequence[GroupScore]) -> list[Path]:
    """Draw a metric by difficulty; what was written."""
    return save_figure(group_plot(groups), folder / BY_DIFFICULTY)


def draw_strips(
    folder: Path,
    entrants: Mapping[str, Entrant],
    library: MotionLibrary,
    clip: int,
    horizons: Sequence[str],
    seed: int,
    device: str,
) -> list[Path]:
    """Draw a film strip of each policy on a motion; where this machine cannot, say what to install.

    Commands are those that were scored: Long ones, or else those of the horizon with the longest.

    Args:
        folder: for the figure.
        entrants: by name, of one timing.
        library: all motions that were given, for a motion's commands depend on its number among those of a horizon.
        clip: number of the motion that is shown.
        horizons: that were scored.
        seed: of the commands.
        device: of the policies.
    """
    timing = next(iter(entrants.values())).timing
    lengths = {name: horizon_named(name, timing) for name in horizons}
    longest = max(lengths, key=lambda name: (lengths[name].longest, lengths[name].shortest))
    horizon = "long" if "long" in lengths else longest
    scored = fitting(library, horizon)
    if clip not in scored:
        motion = library.clip_names[clip]
        print(f"no film strip: motion {motion!r} is shorter than a {horizon} command; choose another --clip")
        return []
    number = scored.index(clip)
    motions = library if len(scored) == library.num_clips else library.only(*scored)
    try:
        with Stage(library.robot, width=400, height=440, distance=2.2) as stage:
            playbacks = {
                name: entrant.play(motions, lengths[horizon], number, seed=seed, device=device)
                for name, entrant in entrants.items()
            }
            written = save_figure(film_strip(stage, playbacks), folder / "film_strip")
    except RenderingError as error:
        print(f"no film strip: {error}")
        return []
    return written
