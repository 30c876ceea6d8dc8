"""Study: every test of a comparison on one set of motions, and its tables."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

import torch

from plat.bounds import as_names
from plat.envs.transforms import HORIZONS
from plat.errors import ConfigError
from plat.evaluation.authored_cells import AUTHORED, authored_groups, records_of_all
from plat.evaluation.cells import Candidate, Cell, Records, evaluate_cells
from plat.evaluation.clip_records import ClipRecords
from plat.evaluation.difficulty import BINS, command_bins
from plat.evaluation.disturbance import STRENGTHS, is_undisturbed
from plat.evaluation.entrant import Entrant
from plat.evaluation.groups import GroupScore, group_table, score_groups
from plat.evaluation.in_between import INTERFACES
from plat.evaluation.names import DisturbanceName, RuleName
from plat.evaluation.records import CommandRecords
from plat.evaluation.report import Estimate, report, report_clips
from plat.evaluation.score_table import CLIP_METRICS, METRICS, Difference, Score, paired, table
from plat.evaluation.setting import EvaluationSetting
from plat.motions.library import MotionLibrary
from plat.robots.robot import Robot
from plat.spec.timing import Timing

__all__ = [
    "ClipScore",
    "CurvePoint",
    "Study",
    "StudyPlan",
    "best_interfaces",
    "clip_table",
    "evenly",
    "group_metrics",
    "run_study",
    "tracker_and_interface",
]

_Item = TypeVar("_Item")

_DENSE = "dense"  # label of the cells in which trackers see the reference


@dataclass(frozen=True, kw_only=True)
class StudyPlan:
    """Tests of a study.

    Attributes:
        horizons: names of the commands' horizons.
        setting: conditions of every test.
        rules: of whole-clip success.
        families: family of each clip, for scores by family; None for none.
        sources: number of the motion that each clip is a piece of, over which intervals are; None where clips are
            whole motions.
        difficulty: whether to score by difficulty.
        robustness: disturbances whose curves are measured.
        strengths: how many of each, beside the undisturbed robot; None for all of
            :data:`plat.evaluation.disturbance.STRENGTHS`.
        robustness_clips: motions of the curves, spread evenly; None for all.
        longer: further horizons, for those policies alone whose longest command is long enough.
        authored: chains of each family of authored keyframes.
        choose: whether only the best interface of each dense tracker goes through all tests, by TKS@3 at the main
            horizon.
        ours: policy whose paired differences to each other one are taken, at the horizons long and mixed.

    Raises:
        ConfigError: for curves of robots that are disturbed already, and for partial keyframes beside tests that say
            themselves what is commanded.
    """

    horizons: Sequence[str]
    setting: EvaluationSetting = EvaluationSetting()
    rules: Sequence[RuleName] = ()
    families: Sequence[str] | None = None
    sources: Sequence[int] | None = None
    difficulty: bool = False
    robustness: Sequence[DisturbanceName] = ()
    strengths: int | None = None
    robustness_clips: int | None = None
    longer: Sequence[str] = ()
    authored: int = 0
    choose: bool = False
    ours: str | None = None

    def __post_init__(self) -> None:
        if self.families is not None:
            object.__setattr__(self, "families", as_names(self.families))
        for names in ("horizons", "rules", "robustness", "longer"):
            once = dict.fromkeys(as_names(getattr(self, names)))  # a test that is named twice is one
            object.__setattr__(self, names, tuple(once))
        object.__setattr__(self, "longer", tuple(name for name in self.longer if name not in self.horizons))
        if self.robustness and (self.setting.disturbance is not None or self.setting.randomization is not None):
            raise ConfigError("robustness: curves are of one disturbance at a time, expected an undisturbed setting")
        for test, asked in (("rules", self.rules), ("authored", self.authored)):
            if asked and self.setting.partial is not None:
                told = f"the setting's partial is {self.setting.partial!r}, expected None"
                raise ConfigError(f"{test}: says itself what is commanded; {told}")

    @property
    def main_horizon(self) -> str:
        """Return the horizon of whole clips, groups and curves: mixed, or else the first."""
        return "mixed" if "mixed" in self.horizons else self.horizons[0]

    def cells(self, candidates: Mapping[Candidate, Entrant], library: MotionLibrary) -> list[Cell]:
        """Return every cell in the order in which results are wanted."""
        cells = [Cell(one, horizon, self.setting) for horizon in self.horizons for one in candidates]
        for horizon in self.longer:
            longest = HORIZONS[horizon].longest
            able = [one for one, entrant in candidates.items() if entrant.timing.max_steps >= longest]
            cells += [Cell(one, horizon, self.setting) for one in able]
        cells += [Cell(one, self.main_horizon, self.setting, rule) for rule in self.rules for one in candidates]
        clips = self.clips_of_curves(library)
        for name in self.robustness:
            for value in self.strengths_of(name, library.robot):
                setting = replace(self.setting, disturbance=STRENGTHS[name].disturbance(name, value))
                label = f"{name}={value:g}"
                cells += [Cell(one, self.main_horizon, setting, label=label, clips=clips) for one in candidates]
        return cells

    def dense_cells(self, trackers: Mapping[Candidate, Entrant]) -> list[Cell]:
        """Return the cells of trackers that see the reference: commands of the main horizon, and whole clips."""
        tests = (None, *self.rules)
        return [Cell(one, self.main_horizon, self.setting, rule, _DENSE) for rule in tests for one in trackers]

    def strengths_of(self, name: DisturbanceName, robot: Robot) -> tuple[float, ...]:
        """Return the strengths at which a disturbance is measured: spread evenly, the strongest among them.

        The first one of the curve is among them only where it is not the undisturbed robot, whose scores are there
        anyway.
        """
        first, *values = STRENGTHS[name].values
        measured = () if is_undisturbed(name, first, robot) else (first,)
        return (*measured, *(values if self.strengths is None else evenly(values, self.strengths, last=True)))

    def clips_of_curves(self, library: MotionLibrary) -> tuple[int, ...] | None:
        """Return the numbers of the clips of the curves; None for all."""
        if self.robustness_clips is None or self.robustness_clips >= library.num_clips:
            return None
        return evenly(range(library.num_clips), self.robustness_clips)


def evenly(items: Sequence[_Item], count: int, last: bool = False) -> tuple[_Item, ...]:
    """Return some items, spread evenly; all where there are no more.

    Args:
        items: to choose from.
        count: how many.
        last: whether the last one is among them; otherwise it is the first.

    >>> evenly(range(10), 3), evenly((1, 2, 3, 4, 5), 3, last=True)
    ((0, 3, 6), (2, 4, 5))
    """
    total = len(items)
    if count >= total:
        return tuple(items)
    if last:
        return tuple(items[-(-total * (number + 1) // count) - 1] for number in range(count))
    return tuple(items[total * number // count] for number in range(count))


@dataclass(frozen=True)
class ClipScore:
    """Metrics of a policy on whole clips, by one rule.

    Attributes:
        policy: its name.
        rule: of success.
        count: clips.
        figures: their report.
    """

    policy: str
    rule: str
    count: int
    figures: Mapping[str, Estimate]

    @classmethod
    def of(cls, policy: str, records: ClipRecords) -> "ClipScore":
        """Return the score of records."""
        return cls(policy, records.rule, len(records.clip), report_clips(records))

    @property
    def failed(self) -> int:
        """Return how many clips failed."""
        return round(self.count * (1 - self.figures["clip_success"].value / 100))


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
        dense: of dense trackers that see the reference, at the main horizon.
        dense_clips: of the same on whole clips.
        groups: by what grouped, families, difficulty or authored keyframes: the scores of each policy on each group.
        curves: of robustness.
        interfaces: scores of dense trackers with every interface, where the best one is chosen.
        differences: of the plan's policy to each other one.
    """

    scores: list[Score] = field(default_factory=list)
    clips: list[ClipScore] = field(default_factory=list)
    dense: list[Score] = field(default_factory=list)
    dense_clips: list[ClipScore] = field(default_factory=list)
    groups: dict[str, list[GroupScore]] = field(default_factory=dict)
    curves: list[CurvePoint] = field(default_factory=list)
    interfaces: list[Score] = field(default_factory=list)
    differences: list[Difference] = field(default_factory=list)

    @property
    def main_horizon(self) -> str:
        """Return the horizon of whole clips, groups and curves: mixed, or else the first."""
        horizons = [score.horizon for score in self.scores]
        return "mixed" if "mixed" in horizons else horizons[0]

    def curve_table(self, name: DisturbanceName) -> str:
        """Return TKS@3 against the strength of a disturbance as a Markdown table."""
        strength, tks = STRENGTHS[name], METRICS["tks"]
        points = [point for point in self.curves if point.disturbance == name]
        values = [value for value in strength.values if any(point.strength == value for point in points)]
        lines = [[f"{name} ({strength.unit})", *(f"{value:g}" for value in values)]]
        for policy in dict.fromkeys(point.policy for point in points):
            found = {point.strength: tks.text(point.tks) for point in points if point.policy == policy}
            lines.append([policy, *(found.get(value, "") for value in values)])
        return table(lines) + "\n"

    def markdown(self) -> str:
        """Return the tables beside those of :func:`plat.evaluation.markdown`: whole clips, groups and curves."""
        parts = []
        main = f"at {self.main_horizon.capitalize()}" if self.scores else ""
        if self.clips:
            parts.append(f"**whole clips** {main}\n\n{clip_table(self.clips)}")
        for kind, scores in self.groups.items():
            parts += [f"**by {kind}** {main}\n\n{group_table(scores, metric)}" for metric in group_metrics(scores)]
        names = dict.fromkeys(point.disturbance for point in self.curves)
        parts += [f"**robustness: {name}** {main}, TKS@3 (%)\n\n{self.curve_table(name)}" for name in names]
        return "\n".join(parts)


def clip_table(scores: Sequence[ClipScore]) -> str:
    """Return whole-clip success and errors as a Markdown table, with the rule and the number of failed clips."""
    head = ["rule", "policy", "failed clips", *(metric.heading for metric in CLIP_METRICS.values())]
    rows = [head]
    for score in scores:
        cells = (metric.text(score.figures[name]) for name, metric in CLIP_METRICS.items())
        rows.append([score.rule, score.policy, f"{score.failed} of {score.count}", *cells])
    return table(rows) + "\n"


def run_study(
    candidates: Mapping[Candidate, Entrant],
    library: MotionLibrary,
    plan: StudyPlan,
    *,
    folder: Path | None = None,
    workers: int | None = None,
    modules: Sequence[str] = (),
    told: Callable[[Study], None] = lambda study: None,
    clips: Callable[[str], Sequence[int]] | None = None,
    trackers: Mapping[Candidate, Entrant] = MappingProxyType({}),
) -> Study:
    """Run every test of a plan and return the results.

    Args:
        candidates: with their policies.
        library: motions.
        plan: the tests.
        folder: for the records, so that a study that was stopped goes on; None keeps nothing.
        workers, modules: as for :func:`plat.evaluation.cells.evaluate_cells`.
        told: called with what there is after each test.
        clips: numbers of the motions of a horizon, where it leaves some of the library out; by default all.
        trackers: dense trackers that see the reference, which are scored for comparison.
    """
    study = Study()
    longest = max(entrant.timing.max_steps for entrant in candidates.values())
    frames = int(library.clip_length.max()) - 1
    able = [name for name in plan.longer if HORIZONS[name].longest <= longest and HORIZONS[name].shortest <= frames]
    plan = replace(plan, longer=able)
    every = tuple(range(library.num_clips))
    numbers = {horizon: every if clips is None else tuple(clips(horizon)) for horizon in (*plan.horizons, *plan.longer)}
    of_horizon = {horizon: library if kept == every else library.only(*kept) for horizon, kept in numbers.items()}
    main = of_horizon[plan.main_horizon]
    labels = _Groups(plan, main, numbers[plan.main_horizon], next(iter(candidates.values())).timing)
    shown = {candidate.name: candidate.name for candidate in candidates}

    def run(cells: Sequence[Cell]) -> None:
        for _, group in groupby(cells, key=lambda cell: id(of_horizon[cell.horizon])):
            wanted = list(group)
            chosen = of_horizon[wanted[0].horizon]
            for cell, found in evaluate_cells(wanted, chosen, folder=folder, workers=workers, modules=modules):
                records = _with_sources(found, plan.sources, numbers[cell.horizon])
                if cell.label == _DENSE:
                    _add_dense(study, cell, records)
                else:
                    _add(study, plan, cell, shown[cell.candidate.name], records, labels)
                told(study)

    rest = dict(candidates)
    done: list[Cell] = []
    if plan.choose:
        done = [Cell(one, plan.main_horizon, plan.setting) for one in candidates]
        run(done)
        shown = best_interfaces(study.scores, plan.main_horizon)
        study.interfaces = [score for score in study.scores if tracker_and_interface(score.policy)[1]]
        study.scores = _renamed(study.scores, shown)
        study.groups = {kind: _renamed(scores, shown) for kind, scores in study.groups.items()}
        study.curves = _renamed(study.curves, shown)
        rest = {one: entrant for one, entrant in candidates.items() if one.name in shown}
    run([cell for cell in plan.cells(rest, main) if cell not in done])
    run(plan.dense_cells(trackers))
    order = list(of_horizon)
    study.scores.sort(key=lambda score: order.index(score.horizon))  # stable: policies stay in order
    authored = records_of_all(rest if plan.authored else {}, library, plan.authored, plan.setting, folder)
    for one, records in authored:
        study.groups.setdefault(AUTHORED, []).extend(authored_groups(shown[one.name], records))
        told(study)
    if plan.ours is not None:
        compared = [score for score in study.scores if score.horizon in ("long", "mixed")]
        ours = [name for row, name in shown.items() if tracker_and_interface(row)[0] == plan.ours]
        study.differences = [found for name in ours for found in paired(compared, name)]
        told(study)
    return study


def _with_sources(records: Records, sources: Sequence[int] | None, clips: Sequence[int]) -> Records:
    """Return records that say which motion each clip is a piece of.

    Args:
        records: of some clips of a library.
        sources: motion of each clip of the library.
        clips: numbers of the clips in the library.
    """
    if sources is None:
        return records
    return replace(records, source=torch.tensor([sources[clip] for clip in clips])[records.clip])


def _renamed(items: Sequence[Any], names: Mapping[str, str]) -> list[Any]:
    """Return the items of some policies, under other names."""
    return [replace(item, policy=names[item.policy]) for item in items if item.policy in names]


class _Groups:
    """Groups of the clips and commands of the main horizon."""

    def __init__(self, plan: StudyPlan, motions: MotionLibrary, clips: Sequence[int], timing: Timing):
        self.families = [plan.families[clip] for clip in clips] if plan.families else None
        self.curve_clips = plan.clips_of_curves(motions)
        firsts = {name: STRENGTHS[name].values[0] for name in plan.robustness}
        # what no cell measures is the undisturbed robot
        self.undisturbed = {name: at for name, at in firsts.items() if at not in plan.strengths_of(name, motions.robot)}
        self.difficulty: list[str] = []
        if plan.difficulty:
            self.difficulty = command_bins(motions, plan.main_horizon, timing, plan.setting.seed)


def _add(
    study: Study, plan: StudyPlan, cell: Cell, name: str, records: CommandRecords | ClipRecords, labels: _Groups
) -> None:
    if isinstance(records, ClipRecords):
        study.clips.append(ClipScore.of(name, records))
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
    if plan.robustness:
        # on the clips of the curves
        clips = labels.curve_clips
        figure = score.figures["tks"] if clips is None else report(records.of_clips(clips))["tks"]
        for undisturbed, first in labels.undisturbed.items():
            study.curves.append(CurvePoint(name, undisturbed, first, figure))
    if labels.families is not None:
        of_rows = [labels.families[clip] for clip in records.clip.tolist()]
        scores = score_groups(name, cell.horizon, [records], of_rows, resamples=200)
        study.groups.setdefault("family", []).extend(scores)
    if plan.difficulty:
        order = [part.name for part in BINS]
        scores = score_groups(name, cell.horizon, [records], labels.difficulty, order, resamples=200)
        study.groups.setdefault("difficulty", []).extend(scores)


def _add_dense(study: Study, cell: Cell, records: CommandRecords | ClipRecords) -> None:
    if isinstance(records, ClipRecords):
        study.dense_clips.append(ClipScore.of(cell.candidate.name, records))
    else:
        study.dense.append(Score.of(cell.candidate.name, cell.horizon, [records]))


def group_metrics(scores: Sequence[GroupScore]) -> tuple[str, ...]:
    """Return the metrics that tables and figures of groups show.

    TKS@3 of commands, success of whole clips, keyframes reached and chains with a fall of authored ones.
    """
    figures = scores[0].figures
    if "tks" in figures:
        return ("tks",)
    return ("clip_success",) if "clip_success" in figures else ("reached", "fell")


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
        tracker, _ = tracker_and_interface(score.policy)
        if tracker not in best or _rank(score) > _rank(best[tracker]):
            best[tracker] = score
    shown = {}
    for tracker, score in best.items():
        _, interface = tracker_and_interface(score.policy)
        # "SONIC (unverified)" has its parentheses already
        named = f"{tracker[:-1]}, {interface})" if tracker.endswith(")") else f"{tracker} ({interface})"
        shown[score.policy] = named if interface else tracker
    return shown


def tracker_and_interface(row: str) -> tuple[str, str]:
    """Return the tracker and the interface of a row; the row itself and nothing where it has none.

    >>> tracker_and_interface("wbc, line"), tracker_and_interface("plat, seed 1")
    (('wbc', 'line'), ('plat, seed 1', ''))
    """
    tracker, _, interface = row.rpartition(", ")
    return (tracker, interface) if interface in INTERFACES else (row, "")


def _rank(score: Score) -> tuple[float, float]:
    return round(score.figures["tks"].value, 6), -score.figures["mpkpe_all"].value
