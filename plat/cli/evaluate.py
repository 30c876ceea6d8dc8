"""Score policies on motions: timed keyframe tracking, the same commands for each.

plat evaluate runs/plat runs/dagger runs/expert --motions clips.npz --horizon mixed
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

import plat.headless  # noqa: F401

# isort: split
from plat.baselines import ReleasedTrackers
from plat.envs.transforms import HORIZONS, RandomizationRanges
from plat.errors import PlatError
from plat.evaluation import HEADLINE, METRICS, CommandRecords, Entrant, EvaluationSetting, Score, write_csv
from plat.evaluation.score_table import COLUMNS, rows
from plat.figures import ablation_bars, film_strip, pyplot, radar_plot, save_figure, success_plot
from plat.motions import MotionLibrary
from plat.rendering import RenderingError, Stage
from plat.runs import check_logger, default_device, log_table, start_logging
from plat.runs.loggers import LoggerName, chosen_loggers

HorizonName = Literal["single", "short", "medium", "long", "mixed"]


@dataclass(kw_only=True)
class ScoringConfig:
    """What the recipes that score policies have in common."""

    trackers: ReleasedTrackers = field(default_factory=ReleasedTrackers)
    motions: tuple[str, ...]
    """motion files, folders or globs; "generated:val" or "generated:test" for generated motion"""
    horizon: tuple[HorizonName, ...] = ("single", "short", "medium", "long", "mixed")
    """lengths of the commands"""
    randomization: RandomizationRanges = field(default_factory=RandomizationRanges)
    """ranges of the domain randomization, and pushes"""
    clip: str | None = None
    """film strips show the first motion whose name this matches; by default the first of all"""
    seed: int = 0
    """draws the commands, and the disturbances"""
    num_envs: int = 256
    """robots that are simulated at a time; undisturbed, the figures do not depend on it"""
    wandb: bool = False
    """log table and figures to Weights & Biases; offline unless you are logged in"""
    trackio: bool = False
    """log table and figures to trackio, which keeps its files on this machine"""
    device: str = field(default_factory=default_device)
    """where networks and tensors live"""

    @property
    def loggers(self) -> tuple[LoggerName, ...]:
        """Experiment loggers that were asked for."""
        return chosen_loggers(self.wandb, self.trackio)

    def records(
        self, entrant: Entrant, library: MotionLibrary, horizon: str, randomization: RandomizationRanges | None
    ) -> CommandRecords:
        """What an entrant does with the commands of every motion."""
        setting = EvaluationSetting(self.seed, randomization, num_envs=self.num_envs, device=self.device)
        return entrant.evaluate(library, horizon, setting)


@dataclass(kw_only=True)
class EvaluateRecipe(ScoringConfig):
    """Score policies on motions."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional] = ()
    """run directories; an expert sees the keyframe as its next reference frame (Scratch RL)"""
    only: str | None = None
    """regular expression: score only motions whose names it matches, as in run|kick"""
    dense: bool = False
    """show policies the reference instead of the keyframe: how well a dense tracker tracks"""
    domain_randomization: bool = False
    """draw robot, motors and ground anew for each motion, and push the robots"""
    csv: Path | None = None
    """file to write every figure to, with its interval"""
    figures: Path | None = None
    """folder to draw radar plot, bars, success curves and film strips into, as PDF and PNG"""


def main(recipe: EvaluateRecipe) -> list[Score]:
    """Run the recipe: print a table, return its rows."""
    if recipe.figures is not None:
        pyplot()  # what is missing had better be said before the evaluation
    for logger in recipe.loggers:
        check_logger(logger)
    library = MotionLibrary.load(recipe.motions)
    if recipe.only is not None:
        library = library.only(*library.named(recipe.only))
    shown = first_named(library, recipe.clip)
    names = [run.name for run in recipe.runs]
    entrants = {
        run.name if names.count(run.name) == 1 else str(run): Entrant.of_run(run, recipe.device, recipe.dense)
        for run in recipe.runs
    }
    entrants |= {name: Entrant.of_tracker(tracker, recipe.dense) for name, tracker in recipe.trackers.load().items()}
    if not entrants:
        raise PlatError("nothing to evaluate: give run directories, or files of released trackers (--trackers.twist2)")
    print(f"{library.num_clips} motions, {library.duration:.0f} s; 95 % intervals over motions in parentheses")
    randomization = recipe.randomization if recipe.domain_randomization else None
    print_head()
    scores = []
    for horizon in recipe.horizon:
        for name, entrant in entrants.items():
            started = time.monotonic()
            records = recipe.records(entrant, library, horizon, randomization)
            scores.append(Score.of(name, horizon, [records]))
            print_score(scores[-1], time.monotonic() - started)
    if recipe.csv is not None:
        write_csv(recipe.csv, scores)
    pictures: list[Path] = []
    if recipe.figures is not None:
        pictures = draw_scores(recipe.figures, scores)
        pictures += draw_strips(recipe.figures, entrants, shown, recipe.seed, recipe.device)
    if recipe.loggers:
        settings = {
            "runs": [str(run) for run in recipe.runs],
            "motions": recipe.motions,
            "dense": recipe.dense,
            "domain_randomization": recipe.domain_randomization,
        }
        for logger in recipe.loggers:
            run = start_logging(logger, "evaluation", Path(), settings)
            log_table(run, "evaluation", COLUMNS, rows(scores), pictures)
            run.finish()
    return scores


def first_named(library: MotionLibrary, pattern: str | None) -> MotionLibrary:
    """The first motion, or the first one whose name a regular expression is found in."""
    return library.only(0 if pattern is None else library.named(pattern)[0])


def print_head() -> None:
    """Headings of the lines that :func:`print_score` prints."""
    print(f"{'policy':<22}{'horizon':<9}{'TKS@3 %':<21}{'MPJPE@3 rad':<22}{'MPKPE@3 m':<22}{'falls %':<9}seconds")


def print_score(score: Score, seconds: float) -> None:
    """A line of the table."""
    cells = (f"{score.figures[name]:.{METRICS[name].digits}f}" for name in HEADLINE)
    falls = f"{score.figures['fall_rate'].value:.1f}"
    tks, mpjpe, mpkpe = cells
    print(f"{score.policy:<22}{score.horizon:<9}{tks:<21}{mpjpe:<22}{mpkpe:<22}{falls:<9}{seconds:.0f}", flush=True)


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


def draw_strips(
    folder: Path, entrants: Mapping[str, Entrant], library: MotionLibrary, seed: int, device: str
) -> list[Path]:
    """Draw a film strip of each policy on a library's only motion; where this machine cannot, say what to install."""
    horizon = HORIZONS["long"]
    if int(library.clip_length[0]) <= horizon.shortest:
        print(f"no film strip: motion {library.clip_names[0]!r} is shorter than a long command; choose another --clip")
        return []
    try:
        stage = Stage(library.robot, width=400, height=440, distance=2.2)
        playbacks = {
            name: entrant.play(library, horizon, seed=seed, device=device) for name, entrant in entrants.items()
        }
        written = save_figure(film_strip(stage, playbacks), folder / "film_strip")
        stage.close()
    except RenderingError as error:
        print(f"no film strip: {error}")
        return []
    return written


COMMAND = EvaluateRecipe
