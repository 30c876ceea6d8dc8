"""Study: every test of a comparison on one set of motions, and its tables."""

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from pathlib import Path
from typing import Any

from plat.envs.transforms import CommandSchedule, horizon_named
from plat.evaluation.cells import Candidate, Cell, evaluate_cells
from plat.evaluation.clip_records import ClipRecords
from plat.evaluation.difficulty import BINS, bin_of, command_difficulty
from plat.evaluation.disturbance import STRENGTHS
from plat.evaluation.entrant import Entrant
from plat.evaluation.groups import GroupScore, group_table, score_groups
from plat.evaluation.names import DisturbanceName, RuleName
from plat.evaluation.records import CommandRecords
from plat.evaluation.report import Estimate, report, report_clips
from plat.evaluation.score_table import CLIP_METRICS, METRICS, Score, write_csv
from plat.evaluation.setting import EvaluationSetting
from plat.files import replace_file
from plat.motions.library import MotionLibrary
from plat.spec.timing import Timing

__all__ = ["ClipScore", "CurvePoint", "Study", "StudyPlan", "best_interfaces", "group_metric", "run_study"]


@dataclass(frozen=True, kw_only=True)
class StudyPlan:
    """Tests of a study.

    Attributes:
        horizons: names of the commands' horizons.
        setting: conditions of every test.
        rules: of whole-clip success.
        families: family of each clip, for scores by family; None for none.
        difficulty: whether to score by difficulty.
        robustness: disturbances whose curves are measured.
    """

    horizons: Sequence[str]
    setting: EvaluationSetting = EvaluationSetting()
    rules: Sequence[RuleName] = ()
    families: Sequence[str] | None = None
    difficulty: bool = False
    robustness: Sequence[DisturbanceName] = ()

    @property
    def main_horizon(self) -> str:
        """Return the horizon of whole clips, groups and curves: mixed, or else the first."""
        return "mixed" if "mixed" in self.horizons else self.horizons[0]

    def cells(self, candidates: Sequence[Candidate]) -> list[Cell]:
        """Return every cell in the order in which results are wanted."""
        cells = [Cell(one, horizon, self.setting) for horizon in self.horizons for one in candidates]
        cells += [Cell(one, self.main_horizon, self.setting, rule) for rule in self.rules for one in candidates]
        for name in self.robustness:
            for value in STRENGTHS[name].values[1:]:
                setting = replace(self.setting, disturbance=STRENGTHS[name].disturbance(name, value))
                cells += [Cell(one, self.main_horizon, setting, label=f"{name}={value:g}") for one in candidates]
        return cells


@dataclass(frozen=True)
class ClipScore:
    """Metrics of a policy on whole clips, by one rule."""

    policy: str
    rule: str
    records: ClipRecords
    figures: Mapping[str, Estimate]


@dataclass(frozen=True)
class CurvePoint:
    """TKS@3 (%) of a policy under a disturbance of some strength."""

    policy: str
    disturbance: DisturbanceName
    strength: float
    tks: Estimate


@dataclass
class Study:
    """Results of a study.

    Attributes:
        scores: of commands, by policy and horizon.
        clips: of whole clips, by policy and rule.
        groups: by what grouped, families or difficulty: the scores of each policy on each group.
        curves: of robustness.
    """

    scores: list[Score] = field(default_factory=list)
    clips: list[ClipScore] = field(default_factory=list)
    groups: dict[str, list[GroupScore]] = field(default_factory=dict)
    curves: list[CurvePoint] = field(default_factory=list)

    def of(self, policies: Mapping[str, str]) -> "Study":
        """Return the results of some policies, under other names."""

        def chosen(items: Sequence[Any]) -> list[Any]:
            return [replace(item, policy=policies[item.policy]) for item in items if item.policy in policies]

        groups = {kind: chosen(scores) for kind, scores in self.groups.items()}
        return Study(chosen(self.scores), chosen(self.clips), groups, chosen(self.curves))

    def clip_table(self) -> str:
        """Return whole-clip success and errors as a Markdown table, with the rule."""
        lines = [f"| rule | policy | {' | '.join(metric.heading for metric in CLIP_METRICS.values())} |"]
        lines.append("|" + "---|" * (2 + len(CLIP_METRICS)))
        for score in self.clips:
            cells = (metric.text(score.figures[name]) for name, metric in CLIP_METRICS.items())
            lines.append(f"| {score.rule} | {score.policy} | {' | '.join(cells)} |")
        return "\n".join(lines) + "\n"

    def curve_table(self, name: DisturbanceName) -> str:
        """Return TKS@3 against the strength of a disturbance as a Markdown table."""
        strength, tks = STRENGTHS[name], METRICS["tks"]
        lines = [f"| {name} ({strength.unit}) | {' | '.join(f'{value:g}' for value in strength.values)} |"]
        lines.append("|" + "---|" * (1 + len(strength.values)))
        points = [point for point in self.curves if point.disturbance == name]
        for policy in dict.fromkeys(point.policy for point in points):
            found = {point.strength: tks.text(point.tks) for point in points if point.policy == policy}
            lines.append(f"| {policy} | {' | '.join(found.get(value, '') for value in strength.values)} |")
        return "\n".join(lines) + "\n"

    def markdown(self) -> str:
        """Return the tables beside those of :func:`plat.evaluation.markdown`: whole clips, groups and curves."""
        parts = []
        if self.clips:
            parts.append(f"**whole clips**\n\n{self.clip_table()}")
        for kind, scores in self.groups.items():
            parts.append(f"**by {kind}**\n\n{group_table(scores, group_metric(scores))}")
        names = dict.fromkeys(point.disturbance for point in self.curves)
        parts += [f"**robustness: {name}**, TKS@3 (%)\n\n{self.curve_table(name)}" for name in names]
        return "\n".join(parts)

    def write(self, folder: Path) -> None:
        """Write a CSV file for each kind of result; values are in SI units."""
        write_csv(folder / "scores.csv", self.scores)
        clips = [(score.policy, score.rule, *row) for score in self.clips for row in _figures(score.figures)]
        _write(folder / "whole_clips.csv", ("policy", "rule", *_FIGURES), clips)
        groups = [
            (kind, score.group, score.count, score.policy, score.test, *row)
            for kind, scores in self.groups.items()
            for score in scores
            for row in _figures(score.figures)
        ]
        _write(folder / "groups.csv", ("grouping", "group", "count", "policy", "test", *_FIGURES), groups)
        curves = [
            (point.disturbance, point.strength, STRENGTHS[point.disturbance].unit, point.policy, *row)
            for point in self.curves
            for row in _figures({"tks": point.tks})
        ]
        _write(folder / "robustness.csv", ("disturbance", "strength", "unit", "policy", *_FIGURES), curves)


_FIGURES = ("metric", "value", "low", "high")


def _figures(figures: Mapping[str, Estimate]) -> list[tuple[Any, ...]]:
    return [(name, figure.value, figure.low, figure.high) for name, figure in figures.items()]


def _write(path: Path, head: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    if not rows:
        return

    def write(part: Path) -> None:
        with part.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(head)
            writer.writerows([f"{cell:.6g}" if isinstance(cell, float) else cell for cell in row] for row in rows)

    replace_file(path, write)


def run_study(
    candidates: Mapping[Candidate, Entrant],
    library: MotionLibrary,
    plan: StudyPlan,
    *,
    folder: Path | None = None,
    workers: int | None = None,
    modules: Sequence[str] = (),
    told: Callable[[Study], None] = lambda study: None,
    motions: Callable[[str], MotionLibrary] | None = None,
) -> Study:
    """Run every test of a plan and return the results.

    Args:
        candidates: with their policies.
        library: motions.
        plan: the tests.
        folder: for the records, so that a study that was stopped goes on; None keeps nothing.
        workers, modules: as for :func:`plat.evaluation.cells.evaluate_cells`.
        told: called with what there is after each test.
        motions: the motions of a horizon, where it leaves some of the library out; by default all.
    """
    study = Study()
    cells = plan.cells(list(candidates))
    of_horizon = {horizon: library if motions is None else motions(horizon) for horizon in plan.horizons}
    labels = _Labels(plan, library, of_horizon[plan.main_horizon], next(iter(candidates.values())).timing)
    for _, group in groupby(cells, key=lambda cell: id(of_horizon[cell.horizon])):
        wanted = list(group)
        chosen = of_horizon[wanted[0].horizon]
        for cell, records in evaluate_cells(wanted, chosen, folder=folder, workers=workers, modules=modules):
            _add(study, plan, cell, records, labels)
            told(study)
    return study


class _Labels:
    """Groups of the clips and commands of the main horizon."""

    def __init__(self, plan: StudyPlan, library: MotionLibrary, motions: MotionLibrary, timing: Timing):
        families = dict(zip(library.clip_names, plan.families or (), strict=False))
        self.families = [families[name] for name in motions.clip_names] if families else None
        self.difficulty: list[str] = []
        if plan.difficulty:
            schedule = CommandSchedule(motions, horizon_named(plan.main_horizon, timing), plan.setting.seed)
            self.difficulty = bin_of(command_difficulty(motions, schedule))


def _add(study: Study, plan: StudyPlan, cell: Cell, records: CommandRecords | ClipRecords, labels: _Labels) -> None:
    name = cell.candidate.name
    if isinstance(records, ClipRecords):
        study.clips.append(ClipScore(name, records.rule, records, report_clips(records)))
        if labels.families is not None:
            of_rows = [labels.families[clip] for clip in records.clip.tolist()]
            scores = score_groups(name, records.rule, [records], of_rows, resamples=200)
            study.groups.setdefault(f"family, {records.rule}", []).extend(scores)
        return
    if cell.label:
        disturbance, _, strength = cell.label.partition("=")
        figure = report(records)["tks"]
        study.curves.append(CurvePoint(name, _named(disturbance), float(strength), figure))
        return
    score = Score.of(name, cell.horizon, [records])
    study.scores.append(score)
    if cell.horizon != plan.main_horizon:
        return
    for disturbance in plan.robustness:
        undisturbed = STRENGTHS[disturbance].values[0]
        study.curves.append(CurvePoint(name, disturbance, undisturbed, score.figures["tks"]))
    if labels.families is not None:
        of_rows = [labels.families[clip] for clip in records.clip.tolist()]
        scores = score_groups(name, cell.horizon, [records], of_rows, resamples=200)
        study.groups.setdefault("family", []).extend(scores)
    if plan.difficulty:
        order = [part.name for part in BINS]
        scores = score_groups(name, cell.horizon, [records], labels.difficulty, order, resamples=200)
        study.groups.setdefault("difficulty", []).extend(scores)


def group_metric(scores: Sequence[GroupScore]) -> str:
    """Return the metric that tables and figures of groups show: TKS@3 of commands, success of whole clips."""
    return "tks" if "tks" in scores[0].figures else "clip_success"


def _named(disturbance: str) -> DisturbanceName:
    return next(name for name in STRENGTHS if name == disturbance)


def best_interfaces(scores: Sequence[Score], horizon: str) -> dict[str, str]:
    """Return the policies of a table, each tracker with its best interface by TKS@3 at a horizon.

    Rows of one tracker are called "NAME, INTERFACE". A tie goes to the smaller position error.

    Args:
        scores: of all rows.
        horizon: by which the best is chosen.

    Returns:
        Names of the chosen rows, and what they are called in the table: "NAME (INTERFACE)".
    """
    best: dict[str, Score] = {}
    for score in scores:
        if score.horizon != horizon:
            continue
        tracker = score.policy.partition(", ")[0]
        if tracker not in best or _rank(score) > _rank(best[tracker]):
            best[tracker] = score
    shown = {}
    for tracker, score in best.items():
        interface = score.policy.partition(", ")[2]
        shown[score.policy] = f"{tracker} ({interface})" if interface else tracker
    return shown


def _rank(score: Score) -> tuple[float, float]:
    return round(score.figures["tks"].value, 6), -score.figures["mpkpe_all"].value
