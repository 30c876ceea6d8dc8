"""The paper's ablation: every row at every horizon, by the same commands, as tables and figures.

plat ablations --runs runs/ablations --motions test.npz --out runs/ablations/scores

``--runs`` holds one run a row: sonic-style, expert (Scratch RL), plain (without the privileged latent), dagger,
finetune, action, plat, imagined and imagined-latent; of rows with several training seeds plat-seed0, plat-seed1 and so
on. A row whose run is not there is left out. ``--train`` trains what is missing or unfinished first. Everything that is
done is kept: started again after it was killed, the recipe goes on where it was.

``--ray`` trains and scores on a Ray cluster, whose machines all see the folders. Each row is in the table as soon as
it is scored.
"""

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field, fields, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, Literal

import torch
from torch import nn

from plat.baselines import CATALOG, ReleasedTrackers
from plat.cli import evaluate
from plat.cli.options import HorizonName
from plat.cli.settings import parse
from plat.cli.together import check_effect
from plat.collectors.cluster import Cluster
from plat.envs.transforms import RandomizationRanges
from plat.errors import PlatError, WorkerError
from plat.evaluation import CommandRecords, Entrant, EvaluationSetting, Score, cells, differences, markdown, write_csv
from plat.evaluation.cells import Cell, evaluate_cells, fingerprint
from plat.evaluation.difficulty import BINS, command_bins
from plat.evaluation.groups import GroupScore, group_table, score_groups
from plat.evaluation.score_table import COLUMNS
from plat.evaluation.score_table import rows as table_rows
from plat.figures import pyplot
from plat.files import check_folder, replace_file
from plat.motions import MotionLibrary
from plat.recipes import distill, expert, imagine, refine
from plat.recipes.options import AblationsRecipe, ImaginationRecipe, Training
from plat.robots import get_robot
from plat.runs import RecipeConfig, SavedRun, is_run, log_table, on_device, report_errors, run_inputs, start_logging
from plat.runs.changes import compared
from plat.runs.inputs import weights_print
from plat.runs.ray_tasks import RayTask, run_tasks
from plat.runs.user_modules import import_modules, imported_code
from plat.spec.timing import Timing


@dataclass(frozen=True)
class Row:
    """A row that plat trains.

    Attributes:
        name: in tables and figures.
        folder: of its run.
        steps: the setting that says how long it is trained.
        recipe: returns how it is trained, from the folder of all runs and settings.
        seeds: whether it is trained with every seed.
        needs: folder of the row that it is trained from.
    """

    name: str
    folder: str
    steps: Literal["expert_steps", "student_steps", "refine_steps", "imagine_steps"]
    recipe: Callable[[Path, dict[str, Any]], RecipeConfig]
    seeds: bool = False
    needs: str | None = None


def expert_recipe(runs: Path, settings: dict[str, Any], ahead: tuple[int, ...] | None = None) -> RecipeConfig:
    """Stage 1; ``ahead`` for other reference frames than the recipe's."""
    recipe = expert.ExpertRecipe(**settings)
    if ahead:
        recipe.policy = replace(recipe.policy, ahead=ahead)
    return recipe


def student_recipe(runs: Path, settings: dict[str, Any], student: Literal["latent", "plain"]) -> RecipeConfig:
    """Stage 2."""
    return distill.DistillRecipe(expert=runs / "expert", student=student, **settings)


def refined_recipe(
    runs: Path, settings: dict[str, Any], variant: Literal["latent", "action", "finetune"]
) -> RecipeConfig:
    """Stage 3."""
    return refine.RefineRecipe(student=runs / "dagger", variant=variant, **settings)


def imagined_recipe(runs: Path, settings: dict[str, Any], student: Literal["plain", "latent"]) -> RecipeConfig:
    """By imagination, from nothing; with a latent, some robots act through its posterior, as the student of stage 2."""
    posterior = POSTERIOR if student == "latent" else 0.0
    return imagine.ImagineRecipe(student=student, posterior=posterior, **settings)


POSTERIOR = 0.5
"""Share of the imagined robots that act through the privileged posterior."""

# in the order of the paper's table, and what is plat's own; a row is trained after those above it, which it may need
ROWS = (
    Row("SONIC-style", "sonic-style", "expert_steps", partial(expert_recipe, ahead=(1, 2, *range(6, 42, 5)))),
    Row("Scratch RL", "expert", "expert_steps", expert_recipe),
    Row("w/o privileged latent", "plain", "student_steps", partial(student_recipe, student="plain"), needs="expert"),
    Row("DAgger", "dagger", "student_steps", partial(student_recipe, student="latent"), needs="expert"),
    Row("Direct RL fine-tune", "finetune", "refine_steps", partial(refined_recipe, variant="finetune"), True, "dagger"),
    Row("Residual action", "action", "refine_steps", partial(refined_recipe, variant="action"), True, "dagger"),
    Row("PLAT", "plat", "refine_steps", partial(refined_recipe, variant="latent"), True, "dagger"),
    Row("Imagined", "imagined", "imagine_steps", partial(imagined_recipe, student="plain")),
    Row("Imagined latent", "imagined-latent", "imagine_steps", partial(imagined_recipe, student="latent")),
)
COMPARED = "PLAT"
"""Row whose difference from each other is shown."""
ORDER = ("SONIC", "SONIC 1.1", "SONIC-style", "ProtoMotions", "TWIST2", "wbc", "YAHMP", *(row.name for row in ROWS[1:]))
STAGES: dict[str, Any] = {"expert": expert, "distill": distill, "refine": refine, "imagine": imagine}
TRACKERS = (*CATALOG, "SONIC-style", "Scratch RL")
HARD = ("brisk", "hard")
"""Bins of difficulty whose commands get tables and figures of their own."""


@dataclass(frozen=True)
class RowPolicy:
    """Policy of a row: its name in files, what it is made of, and how to load it, densely or sparsely evaluated."""

    slug: str
    files: tuple[Path, ...]
    load: Callable[[bool], Entrant]


def main(recipe: AblationsRecipe) -> dict[str, list[Score]]:
    """Run the recipe: the scores of each split."""
    recipe = on_device(recipe)
    import_modules(recipe.imports)
    robot = get_robot(recipe.robot)  # first: a description file makes the policies' robot known
    check_training(recipe)
    check_folder(recipe.out)
    pyplot()  # what is missing had better be said before hours of work
    released = released_rows(recipe.trackers)
    if recipe.ray:
        with Cluster() as cluster:
            on_cluster(recipe, released, partial(run_tasks, cluster=cluster))
    elif recipe.train:
        train(recipe)
    rows = released | trained_rows(recipe)
    rows = {name: rows[name] for name in ORDER if name in rows}
    if not rows:
        raise PlatError(f"--runs {str(recipe.runs)!r}: holds none of the runs {[row.folder for row in ROWS]}")
    entrants = {candidate.slug: candidate.load(False) for candidates in rows.values() for candidate in candidates}
    control_dt = evaluate.common_control_dt(entrants, recipe.horizon)
    library = MotionLibrary.load(recipe.motions, robot, dt=control_dt)
    shown = evaluate.first_named(library, recipe.clip)
    print(f"{library.num_clips} motions, {library.duration:.0f} s; 95 % intervals over motions and training seeds")
    evaluate.print_head()
    scores = score(rows, library, recipe.horizon, recipe)
    splits = {"all": scores}
    timing = next(iter(entrants.values())).timing
    bins: dict[str, list[str]] = {
        horizon: command_bins(library, horizon, timing, recipe.seed) for horizon in recipe.horizon
    }
    splits["hard"] = hard_part(scores, bins)
    (main_horizon,) = once(recipe)
    by_difficulty = grouped(scores, bins, main_horizon)
    hard = sum(one in HARD for one in bins[main_horizon])
    print(f"{' and '.join(HARD)}: {hard} of {len(bins[main_horizon])} commands at {main_horizon}")
    print("\nrandomized and pushed")
    splits["randomized"] = score(rows, library, once(recipe), recipe, randomization=recipe.randomization)
    print("\nwith the dense reference, for comparison")
    trackers = {name: candidates for name, candidates in rows.items() if name in TRACKERS}
    splits["dense"] = score(trackers, library, once(recipe), recipe, dense=True)
    pictures: dict[str, list[Path]] = {}
    for split in [split for split, of_split in splits.items() if not of_split]:
        del splits[split]
        remove(recipe.out / split)
    for split, of_split in splits.items():
        groups = by_difficulty if split == "all" else []
        pictures[split] = write(recipe.out / split, of_split, rows, groups)
    first = {name: entrants[candidates[0].slug] for name, candidates in rows.items()}
    pictures["all"] += evaluate.draw_strips(
        recipe.out / "all", first, library, shown, recipe.horizon, recipe.seed, recipe.device
    )
    for logger in recipe.loggers:
        run = start_logging(logger, "ablations", recipe.out, {"motions": recipe.motions, "runs": str(recipe.runs)})
        log_table(run, "evaluation", COLUMNS, table_rows(scores), pictures["all"])
        run.finish()
    print(f"\ntables and figures: {recipe.out}/{{{','.join(pictures)}}}")
    return splits


def check_training(recipe: AblationsRecipe) -> None:
    """Raise an error for settings of a training when none is asked for."""
    for each in fields(Training):
        needed, there = ("--ray", recipe.ray) if each.name == "cpus" else ("--train", recipe.train)
        flag = f"--training.{each.name.replace('_', '-')}"
        check_effect(flag, getattr(recipe.training, each.name) != each.default, needed, there)


@dataclass(frozen=True)
class Planned:
    """A training that is left to do.

    Attributes:
        row: what is trained.
        recipe: how.
    """

    row: Row
    recipe: RecipeConfig = field(hash=False)

    @property
    def out(self) -> Path:
        """Folder of the run."""
        return self.recipe.out

    def train(self) -> None:
        """Train, from the last checkpoint if there is one."""
        STAGES[self.recipe.name].main(replace(self.recipe, resume=is_run(self.out)))


def planned(recipe: AblationsRecipe) -> list[Planned]:
    """Every training whose run is not there or not finished.

    Raises:
        PlatError: naming the first row whose run was trained otherwise, or from one that would train on.
    """
    if not recipe.training.motions:
        raise PlatError("--train needs motions to train on: --training.motions")
    motions = cache(partial(motions_to_train_on, recipe))
    left: list[Planned] = []
    for row in ROWS:
        steps = getattr(recipe.training, row.steps)
        for seed in recipe.training.seeds if row.seeds else recipe.training.seeds[:1]:
            out = recipe.runs / (f"{row.folder}-seed{seed}" if row.seeds else row.folder)
            settings = {
                "motions": recipe.training.motions,
                "mirror": recipe.training.mirror,
                "drop_bad": recipe.training.drop_bad,
                "num_envs": recipe.training.num_envs,
                "out": out,
                "steps": steps,
                "seed": seed,
                "wandb": recipe.wandb,
                "trackio": recipe.trackio,
                "device": recipe.device,
                "robot": recipe.robot,
                "imports": recipe.imports,
            }
            training = Planned(row, row.recipe(recipe.runs, settings))
            if has_weights(out) and SavedRun(out).recipe is not None:
                check_made_so(training, motions())
                if row.needs in {other.out.name for other in left}:
                    raise PlatError(
                        f"{row.name}: {str(out)!r} was made from {row.needs!r} as it is, which would train on: choose "
                        "another --runs, or steps as they were"
                    )
            if steps_of(out) >= steps:
                print(f"{row.name}: {out} is done")
            else:
                left.append(training)
    return left


def motions_to_train_on(recipe: AblationsRecipe) -> dict[str, Any]:
    """Fingerprints of motions and robot."""
    how, robot, dt = recipe.training, get_robot(recipe.robot), Timing().control_dt
    return run_inputs(MotionLibrary.load(how.motions, robot, dt=dt, mirror=how.mirror, drop_bad=how.drop_bad))


def check_made_so(training: Planned, inputs: dict[str, Any]) -> None:
    """Raise an error when the run that is there was trained otherwise than it would be now.

    Args:
        training: how it would be.
        inputs: fingerprints of motions and robot; that of the row that it needs is added, where that is there.

    Raises:
        PlatError: naming the row and what differs.
    """
    needs = training.row.needs
    if needs and has_weights(source := training.out.parent / needs):
        what = "expert" if isinstance(training.recipe, distill.DistillRecipe) else "student"
        inputs = {**inputs, what: weights_print(SavedRun(source).policy_as(nn.Module, "weights"))}
    before, recipe = SavedRun(training.out), training.recipe
    if isinstance(recipe, ImaginationRecipe):  # a run has all its rates, a recipe those that are given
        recipe = replace(recipe, imagination=recipe.with_rates(before.settings))
    _, differing = compared(training.out, before.config, recipe, inputs)
    if differing:
        raise PlatError(
            f"{training.row.name}: {str(training.out)!r} was trained otherwise: {differing}; train with what it had, "
            "choose another --runs, or leave out --train to score it as it is"
        )


def train(recipe: AblationsRecipe) -> None:
    """Train every run that is not there or not finished, one after the other."""
    for training in planned(recipe):
        print(f"\n{training.row.name}: {training.out}", flush=True)
        training.train()


def on_cluster(
    recipe: AblationsRecipe,
    released: dict[str, list[RowPolicy]],
    run: Callable[[Sequence[RayTask]], Iterator[tuple[RayTask, PlatError | None]]],
) -> None:
    """Train and score by tasks, and write each row into the table as soon as it is scored.

    Raises:
        PlatError: after all others have ended, when some failed.
    """
    trainings = planned(recipe) if recipe.train else []
    gpus = 1.0 if recipe.device.startswith("cuda") else 0.0
    tasks = [
        RayTask(
            f"train {training.out.name}",
            partial(task_of, recipe, training.out.name, training.train),
            tuple(f"train {other.out.name}" for other in trainings if other.out.name == training.row.needs),
            recipe.training.cpus,
            gpus,
        )
        for training in trainings
    ]
    candidates = {candidate.slug: (name, candidate) for name, (candidate,) in released.items()}
    for row in ROWS:
        runs = [run for run in runs_of(recipe.runs, row) if run not in {training.out for training in trainings}]
        runs += [training.out for training in trainings if training.row is row]
        candidates |= {run.name: (row.name, run_candidate(run, recipe.device)) for run in sorted(runs)}
    known = {task.name for task in tasks}
    scoring = {
        f"score {slug}": RayTask(
            f"score {slug}",
            partial(task_of, recipe, slug, partial(evaluate_all, name, candidate, recipe)),
            (f"train {slug}",) if f"train {slug}" in known else (),
            recipe.training.cpus,
            gpus,
        )
        for slug, (name, candidate) in candidates.items()
    }
    print(f"{len(tasks)} trainings and {len(scoring)} evaluations print into {recipe.out / 'logs'}")
    evaluate.print_head()
    rows: dict[str, list[RowPolicy]] = {}
    table: dict[str, list[Score]] = {}
    errors = {}
    for task, error in run([*tasks, *scoring.values()]):
        if error is not None:
            errors[task.name] = error
            print(f"{task.name}: {error}", flush=True)
        elif task.name in scoring:
            name, candidate = candidates[task.name.removeprefix("score ")]
            rows[name] = sorted([*rows.get(name, []), candidate], key=lambda candidate: candidate.slug)
            table[name] = score({name: rows[name]}, motions_for(candidate, recipe), recipe.horizon, recipe)
            so_far = [scores for name in ORDER for scores in table.get(name, ())]
            write_table(recipe.out / "all", so_far, {name: rows[name] for name in ORDER if name in rows})
    if errors:
        first = next(iter(errors))
        raise WorkerError(
            f"{len(errors)} of {len(tasks) + len(scoring)} tasks failed, the first of them {first!r} "
            f"({errors[first]}); started again, what is done is kept"
        )


def task_of(recipe: AblationsRecipe, name: str, work: Callable[[], None]) -> None:
    """Do some work in a process of its own, which prints into a file."""
    os.environ["PLAT_CPUS"] = str(recipe.training.cpus)
    log = recipe.out / "logs" / f"{name}.txt"
    log.parent.mkdir(parents=True, exist_ok=True)
    with log.open("a", encoding="utf-8") as file, redirect_stdout(file), redirect_stderr(file):
        import_modules(recipe.imports)
        get_robot(recipe.robot)  # this process does not know that of a description file
        work()


def evaluate_all(name: str, candidate: RowPolicy, recipe: AblationsRecipe) -> None:
    """Evaluate a policy under all conditions; the records stay in their folder."""
    library = motions_for(candidate, recipe)
    conditions = [(recipe.horizon, False, None), (once(recipe), False, recipe.randomization)]
    if name in TRACKERS:
        conditions.append((once(recipe), True, None))
    wanted = [cell for condition in conditions for cell in cells_of([candidate], recipe, *condition)]
    for _ in evaluate_cells(wanted, library, folder=recipe.out / "records", workers=1, modules=recipe.imports):
        pass


def motions_for(candidate: RowPolicy, recipe: AblationsRecipe) -> MotionLibrary:
    """The motions, sampled by the control step of a policy."""
    control_dt = evaluate.common_control_dt({candidate.slug: candidate.load(False)}, recipe.horizon)
    return MotionLibrary.load(recipe.motions, get_robot(recipe.robot), dt=control_dt)


def once(recipe: AblationsRecipe) -> tuple[HorizonName, ...]:
    """The horizon of the comparisons that are made at one."""
    return ("mixed",) if "mixed" in recipe.horizon else recipe.horizon[:1]


def steps_of(run: Path) -> int:
    """Steps of a finished run; 0 where there is none."""
    return SavedRun(run).steps if is_run(run) else 0


def released_rows(trackers: ReleasedTrackers) -> dict[str, list[RowPolicy]]:
    """Rows of the released trackers whose files were given."""
    rows = {}
    for name, path in trackers.files().items():
        baseline = CATALOG[name]
        if path is None:
            print(f"{name}: left out, give --trackers.{baseline.flag}")
            continue
        released_entrant(name, path, dense=False)  # what is wrong with a file had better be said first
        rows[name] = [RowPolicy(baseline.flag, tuple(baseline.paths(path)), partial(released_entrant, name, path))]
    return rows


def released_entrant(name: str, path: Path, dense: bool) -> Entrant:
    """A released tracker."""
    return Entrant.of_tracker(CATALOG[name].load(path), dense)


def trained_rows(recipe: AblationsRecipe) -> dict[str, list[RowPolicy]]:
    """Rows whose runs are there."""
    rows = {}
    for row in ROWS:
        runs = runs_of(recipe.runs, row)
        if not runs:
            print(f"{row.name}: left out, no run {recipe.runs / row.folder} (or {row.folder}-seed0 and so on)")
            continue
        for run in runs:
            if SavedRun(run).unfinished:
                print(f"{row.name}: {run} is not finished, the weights are those of its last checkpoint")
        rows[row.name] = [run_candidate(run, recipe.device) for run in runs]
    return rows


def runs_of(folder: Path, row: Row) -> list[Path]:
    """Folders of a row's runs that are there."""
    places = (folder / row.folder, *sorted(folder.glob(f"{row.folder}-seed*")))
    return [run for run in places if has_weights(run)]


def has_weights(run: Path) -> bool:
    """Whether a folder holds a run that got to its first checkpoint."""
    return is_run(run) and (run / "model.safetensors").exists()


def run_candidate(run: Path, device: str) -> RowPolicy:
    """The policy of a run."""
    files = (run / "config.json", run / "model.safetensors")
    return RowPolicy(run.name, files, partial(Entrant.of_run, run, device))


def score(
    rows: dict[str, list[RowPolicy]],
    library: MotionLibrary,
    horizons: Sequence[str],
    recipe: AblationsRecipe,
    dense: bool = False,
    randomization: RandomizationRanges | None = None,
) -> list[Score]:
    """Scores of every row, from records that are there or made now."""
    named = {candidate.slug: name for name, candidates in rows.items() for candidate in candidates}
    entered = [candidate for candidates in rows.values() for candidate in candidates]
    wanted = cells_of(entered, recipe, horizons, dense, randomization)
    scores: list[Score] = []
    waiting: list[CommandRecords] = []
    since = time.monotonic()
    done = evaluate_cells(
        wanted, library, folder=recipe.out / "records", workers=recipe.workers or None, modules=recipe.imports
    )
    for cell, records in done:
        assert isinstance(records, CommandRecords)
        waiting.append(records)
        name = named[cell.candidate.name]
        if len(waiting) == len(rows[name]):
            scores.append(Score.of(name, cell.horizon, waiting))
            evaluate.print_score(scores[-1], time.monotonic() - since)
            waiting, since = [], time.monotonic()
    return scores


def cells_of(
    candidates: Sequence[RowPolicy],
    recipe: AblationsRecipe,
    horizons: Sequence[str],
    dense: bool,
    randomization: RandomizationRanges | None,
) -> list[Cell]:
    """What is to be evaluated, by horizons."""
    setting = EvaluationSetting(recipe.seed, randomization, num_envs=recipe.num_envs, device=recipe.device)
    label = "-".join(["dense"] * dense + ["randomized"] * (randomization is not None))
    policies = [entrant_of(candidate, dense) for candidate in candidates]
    return [Cell(policy, horizon, setting, label=label) for horizon in horizons for policy in policies]


def entrant_of(candidate: RowPolicy, dense: bool) -> cells.Candidate:
    """The policy of a row as any process can load it."""
    made_of = [*(path.read_bytes() for path in candidate.files), *imported_code(), str(dense).encode()]
    return cells.Candidate(candidate.slug, partial(candidate.load, dense), fingerprint(made_of))


def hard_part(scores: Sequence[Score], bins: dict[str, list[str]]) -> list[Score]:
    """Scores on the commands of :data:`HARD` bins; none where a horizon has no such command."""
    rows = {horizon: torch.tensor([one in HARD for one in of_horizon]) for horizon, of_horizon in bins.items()}
    if not all(of_horizon.any() for of_horizon in rows.values()):
        return []
    return [Score.of(s.policy, s.horizon, [records.of_rows(rows[s.horizon]) for records in s.records]) for s in scores]


def grouped(scores: Sequence[Score], bins: dict[str, list[str]], horizon: str) -> list[GroupScore]:
    """Scores by difficulty at a horizon."""
    order = [part.name for part in BINS]
    return [
        one
        for score in scores
        if score.horizon == horizon
        for one in score_groups(score.policy, horizon, score.records, bins[horizon], order, resamples=200)
    ]


def write(
    folder: Path, scores: Sequence[Score], rows: dict[str, list[RowPolicy]], groups: Sequence[GroupScore] = ()
) -> list[Path]:
    """Write ``scores.md``, ``scores.csv`` and the figures of a split; the figures."""
    write_table(folder, scores, rows, groups)
    drawn = evaluate.draw_scores(folder, scores) + (evaluate.draw_groups(folder, groups) if groups else [])
    evaluate.remove_figures(folder, evaluate.FIGURES, drawn)
    return drawn


def remove(folder: Path) -> None:
    """Remove what :func:`write` wrote at an earlier start, for a split that has no scores now."""
    for name in ("scores.md", "scores.csv"):
        (folder / name).unlink(missing_ok=True)
    evaluate.remove_figures(folder, evaluate.FIGURES, ())


def write_table(
    folder: Path, scores: Sequence[Score], rows: dict[str, list[RowPolicy]], groups: Sequence[GroupScore] = ()
) -> None:
    """Write ``scores.md`` and ``scores.csv`` of a split."""
    write_csv(folder / "scores.csv", scores)
    made_of = ["| row | runs |", "|---|---|"]
    made_of += [f"| {name} | {', '.join(map(described, candidates))} |" for name, candidates in rows.items()]
    by_difficulty = f"**by difficulty, {groups[0].test}**\n\n{group_table(groups)}" if groups else ""
    parts = (markdown(scores), by_difficulty, differences(scores, COMPARED), "\n".join(made_of) + "\n")
    text = "\n".join(filter(None, parts))
    replace_file(folder / "scores.md", lambda part: part.write_text(text, encoding="utf-8"))


def described(candidate: RowPolicy) -> str:
    """Name of a policy, and how long it was trained where that is known."""
    run = candidate.files[0].parent
    if candidate.files[0].name != "config.json":
        return candidate.slug
    if SavedRun(run).unfinished:
        return f"{candidate.slug} (not finished)"
    steps = steps_of(run)
    return f"{candidate.slug} ({steps:,} steps)" if steps else candidate.slug


if __name__ == "__main__":
    with report_errors():
        main(parse(AblationsRecipe))
