"""The paper's ablation: every row at every horizon, by the same commands, as tables and figures.

plat ablations --runs runs/ablations --motions test.npz --out runs/ablations/scores

``--runs`` holds one run a row: sonic-style, expert (Scratch RL), plain (without the privileged latent), dagger,
finetune, action and plat; of rows with several training seeds plat-seed0, plat-seed1 and so on. A row whose run is not
there is left out. ``--train`` trains what is missing or unfinished first. Everything that is done is kept: started
again after it was killed, the recipe goes on where it was.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

from plat.baselines import CATALOG, ReleasedTrackers
from plat.cli import evaluate
from plat.cli.options import HorizonName
from plat.cli.settings import parse
from plat.envs.transforms import RandomizationRanges
from plat.errors import MotionError, PlatError
from plat.evaluation import CommandRecords, Entrant, EvaluationSetting, Score, cells, differences, markdown, write_csv
from plat.evaluation.cells import Cell, evaluate_cells, fingerprint
from plat.evaluation.score_table import COLUMNS
from plat.evaluation.score_table import rows as table_rows
from plat.figures import pyplot
from plat.files import check_folder, replace_file
from plat.motions import MotionLibrary
from plat.recipes import distill, expert, refine
from plat.recipes.options import AblationsRecipe
from plat.robots import get_robot
from plat.runs import SavedRun, is_run, log_table, on_device, report_errors, start_logging


@dataclass(frozen=True)
class Row:
    """A row that plat trains.

    Attributes:
        name: in tables and figures.
        folder: of its run.
        steps: the setting that says how long it is trained.
        train: trains it into a folder.
        seeds: whether it is trained with every seed.
    """

    name: str
    folder: str
    steps: Literal["expert_steps", "student_steps", "refine_steps"]
    train: Callable[[Path, dict[str, Any]], None]
    seeds: bool = False


def train_expert(runs: Path, settings: dict[str, Any], ahead: tuple[int, ...] | None = None) -> None:
    """Stage 1; ``ahead`` for other reference frames than the recipe's."""
    recipe = expert.ExpertRecipe(**settings)
    if ahead:
        recipe.policy = replace(recipe.policy, ahead=ahead)
    expert.main(recipe)


def train_student(runs: Path, settings: dict[str, Any], student: Literal["latent", "plain"]) -> None:
    """Stage 2."""
    distill.main(distill.DistillRecipe(expert=runs / "expert", student=student, **settings))


def train_refined(runs: Path, settings: dict[str, Any], variant: Literal["latent", "action", "finetune"]) -> None:
    """Stage 3."""
    refine.main(refine.RefineRecipe(student=runs / "dagger", variant=variant, **settings))


# in the order of the paper's table; a row is trained after those above it, which it may need
ROWS = (
    Row("SONIC-style", "sonic-style", "expert_steps", partial(train_expert, ahead=(1, 2, *range(6, 42, 5)))),
    Row("Scratch RL", "expert", "expert_steps", train_expert),
    Row("w/o privileged latent", "plain", "student_steps", partial(train_student, student="plain")),
    Row("DAgger", "dagger", "student_steps", partial(train_student, student="latent")),
    Row("Direct RL fine-tune", "finetune", "refine_steps", partial(train_refined, variant="finetune"), True),
    Row("Residual action", "action", "refine_steps", partial(train_refined, variant="action"), True),
    Row("PLAT", "plat", "refine_steps", partial(train_refined, variant="latent"), True),
)
ORDER = ("SONIC", "SONIC 1.1", "SONIC-style", "ProtoMotions", "TWIST2", "wbc", "YAHMP", *(row.name for row in ROWS[1:]))
TRACKERS = (*CATALOG, "SONIC-style", "Scratch RL")


@dataclass(frozen=True)
class Candidate:
    """A policy of a row: its name in files, what it is made of, and how to load it, densely or sparsely evaluated."""

    slug: str
    files: tuple[Path, ...]
    load: Callable[[bool], Entrant]


def main(recipe: AblationsRecipe) -> dict[str, list[Score]]:
    """Run the recipe: the scores of each split."""
    recipe = on_device(recipe)
    check_folder(recipe.out)
    pyplot()  # what is missing had better be said before hours of work
    released = released_rows(recipe.trackers)
    if recipe.train:
        train(recipe)
    rows = released | trained_rows(recipe)
    rows = {name: rows[name] for name in ORDER if name in rows}
    if not rows:
        raise PlatError(f"--runs {str(recipe.runs)!r}: holds none of the runs {[row.folder for row in ROWS]}")
    robot = get_robot(recipe.robot)
    entrants = {candidate.slug: candidate.load(False) for candidates in rows.values() for candidate in candidates}
    control_dt = evaluate.common_control_dt(entrants, recipe.horizon)
    library = MotionLibrary.load(recipe.motions, robot, dt=control_dt)
    shown = evaluate.first_named(library, recipe.clip)
    print(f"{library.num_clips} motions, {library.duration:.0f} s; 95 % intervals over motions and training seeds")
    evaluate.print_head()
    scores = score(rows, library, recipe.horizon, recipe)
    splits = {"all": scores}
    try:
        hard = library.named(recipe.hard)
        splits["hard"] = [
            Score.of(s.policy, s.horizon, [records.of_clips(hard) for records in s.records]) for s in scores
        ]
        print(f"hard: {len(hard)} of the motions")
    except MotionError as error:
        print(f"no hard split: {error}")
    once: tuple[HorizonName, ...] = ("mixed",) if "mixed" in recipe.horizon else recipe.horizon[:1]
    print("\nrandomized and pushed")
    splits["randomized"] = score(rows, library, once, recipe, randomization=recipe.randomization)
    print("\nwith the dense reference, for comparison")
    trackers = {name: candidates for name, candidates in rows.items() if name in TRACKERS}
    splits["dense"] = score(trackers, library, once, recipe, dense=True)
    pictures: dict[str, list[Path]] = {}
    for split, of_split in splits.items():
        if of_split:
            pictures[split] = write(recipe.out / split, of_split, rows)
    first = {name: entrants[candidates[0].slug] for name, candidates in rows.items()}
    pictures["all"] += evaluate.draw_strips(recipe.out / "all", first, shown, recipe.seed, recipe.device)
    for logger in recipe.loggers:
        run = start_logging(logger, "ablations", recipe.out, {"motions": recipe.motions, "runs": str(recipe.runs)})
        log_table(run, "evaluation", COLUMNS, table_rows(scores), pictures["all"])
        run.finish()
    print(f"\ntables and figures: {recipe.out}/{{{','.join(pictures)}}}")
    return splits


def train(recipe: AblationsRecipe) -> None:
    """Train every run that is not there or not finished."""
    if not recipe.training.motions:
        raise PlatError("--train needs motions to train on: --training.motions")
    for row in ROWS:
        steps = getattr(recipe.training, row.steps)
        for seed in recipe.training.seeds if row.seeds else recipe.training.seeds[:1]:
            out = recipe.runs / (f"{row.folder}-seed{seed}" if row.seeds else row.folder)
            if steps_of(out) >= steps:
                print(f"{row.name}: {out} is done")
                continue
            print(f"\n{row.name}: {out}", flush=True)
            settings = {
                "motions": recipe.training.motions,
                "mirror": recipe.training.mirror,
                "drop_bad": recipe.training.drop_bad,
                "num_envs": recipe.training.num_envs,
                "out": out,
                "steps": steps,
                "seed": seed,
                "resume": is_run(out),
                "wandb": recipe.wandb,
                "trackio": recipe.trackio,
                "device": recipe.device,
                "robot": recipe.robot,
            }
            row.train(recipe.runs, settings)


def steps_of(run: Path) -> int:
    """Steps of a finished run; 0 where there is none."""
    return SavedRun(run).steps if is_run(run) else 0


def released_rows(trackers: ReleasedTrackers) -> dict[str, list[Candidate]]:
    """Rows of the released trackers whose files were given."""
    rows = {}
    for name, path in trackers.files().items():
        baseline = CATALOG[name]
        if path is None:
            print(f"{name}: left out, give --trackers.{baseline.flag}")
            continue
        released_entrant(name, path, dense=False)  # what is wrong with a file had better be said first
        rows[name] = [Candidate(baseline.flag, tuple(baseline.paths(path)), partial(released_entrant, name, path))]
    return rows


def released_entrant(name: str, path: Path, dense: bool) -> Entrant:
    """A released tracker."""
    return Entrant.of_tracker(CATALOG[name].load(path), dense)


def trained_rows(recipe: AblationsRecipe) -> dict[str, list[Candidate]]:
    """Rows whose runs are there."""
    rows = {}
    for row in ROWS:
        places = (recipe.runs / row.folder, *sorted(recipe.runs.glob(f"{row.folder}-seed*")))
        runs = [run for run in places if (run / "model.safetensors").exists()]
        if not runs:
            print(f"{row.name}: left out, no run {recipe.runs / row.folder} (or {row.folder}-seed0 and so on)")
            continue
        for run in runs:
            if SavedRun(run).unfinished:
                print(f"{row.name}: {run} is not finished, the weights are those of its last checkpoint")
        rows[row.name] = [
            Candidate(
                run.name,
                (run / "config.json", run / "model.safetensors"),
                partial(Entrant.of_run, run, recipe.device),
            )
            for run in runs
        ]
    return rows


def score(
    rows: dict[str, list[Candidate]],
    library: MotionLibrary,
    horizons: Sequence[str],
    recipe: AblationsRecipe,
    dense: bool = False,
    randomization: RandomizationRanges | None = None,
) -> list[Score]:
    """Scores of every row, from records that are there or made now."""
    setting = EvaluationSetting(recipe.seed, randomization, num_envs=recipe.num_envs, device=recipe.device)
    label = "-".join(["dense"] * dense + ["randomized"] * (randomization is not None))
    named = {candidate.slug: name for name, candidates in rows.items() for candidate in candidates}
    policies = {candidate.slug: entrant_of(candidate, dense) for row in rows.values() for candidate in row}
    wanted = [
        Cell(policies[candidate.slug], horizon, setting, label=label)
        for horizon in horizons
        for candidates in rows.values()
        for candidate in candidates
    ]
    scores: list[Score] = []
    waiting: list[CommandRecords] = []
    since = time.monotonic()
    done = evaluate_cells(wanted, library, folder=recipe.out / "records", workers=recipe.workers or None)
    for cell, records in done:
        assert isinstance(records, CommandRecords)
        waiting.append(records)
        name = named[cell.candidate.name]
        if len(waiting) == len(rows[name]):
            scores.append(Score.of(name, cell.horizon, waiting))
            evaluate.print_score(scores[-1], time.monotonic() - since)
            waiting, since = [], time.monotonic()
    return scores


def entrant_of(candidate: Candidate, dense: bool) -> cells.Candidate:
    """The policy of a row as any process can load it."""
    weights = [path.read_bytes() for path in candidate.files]
    return cells.Candidate(candidate.slug, partial(candidate.load, dense), fingerprint([*weights, str(dense).encode()]))


def write(folder: Path, scores: Sequence[Score], rows: dict[str, list[Candidate]]) -> list[Path]:
    """Write ``scores.md``, ``scores.csv`` and the figures of a split; the figures."""
    write_csv(folder / "scores.csv", scores)
    made_of = ["| row | runs |", "|---|---|"]
    made_of += [f"| {name} | {', '.join(map(described, candidates))} |" for name, candidates in rows.items()]
    parts = (markdown(scores), differences(scores, ROWS[-1].name), "\n".join(made_of) + "\n")
    text = "\n".join(filter(None, parts))
    replace_file(folder / "scores.md", lambda part: part.write_text(text, encoding="utf-8"))
    return evaluate.draw_scores(folder, scores)


def described(candidate: Candidate) -> str:
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
