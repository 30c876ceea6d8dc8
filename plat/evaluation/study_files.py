"""Files of a study: a CSV file for each kind of result, written and read."""

import csv
from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

from plat.errors import PlatError, RecordsError
from plat.evaluation.disturbance import STRENGTHS
from plat.evaluation.groups import GroupScore
from plat.evaluation.report import Estimate
from plat.evaluation.score_table import COLUMNS, Difference, Score, rows, with_conditions
from plat.evaluation.study import ClipScore, CurvePoint, Study
from plat.files import replace_table
from plat.json_file import short

__all__ = ["TABLES", "read_study", "write_study"]

_FIGURES = ("metric", "value", "low", "high")
_CLIP_KEYS = ("policy", "rule", "clips")
_SCORES, _INTERFACES, _DENSE = "scores.csv", "interfaces.csv", "dense.csv"
_CLIPS, _DENSE_CLIPS = "whole_clips.csv", "dense_whole_clips.csv"
_GROUPS, _CURVES, _DIFFERENCES = "groups.csv", "robustness.csv", "differences.csv"
TABLES = (_SCORES, _INTERFACES, _DENSE, _CLIPS, _DENSE_CLIPS, _GROUPS, _CURVES, _DIFFERENCES)
"""Names of all files that a study may have."""


def write_study(study: Study, folder: Path, conditions: str = "") -> None:
    """Write a CSV file for each kind of result; values are in SI units, with six digits.

    Args:
        study: results.
        folder: of the files.
        conditions: what the tests had of their own, in words: a last column. Without any there is no such column.
    """

    def write(path: Path, columns: tuple[str, ...], found: list[tuple[Any, ...]]) -> None:
        _write(path, *with_conditions(columns, found, conditions))

    for name, table in ((_SCORES, study.scores), (_INTERFACES, study.interfaces), (_DENSE, study.dense)):
        write(folder / name, COLUMNS, rows(table))
    for name, scores in ((_CLIPS, study.clips), (_DENSE_CLIPS, study.dense_clips)):
        clips = [(score.policy, score.rule, score.count, *row) for score in scores for row in _rows(score.figures)]
        write(folder / name, (*_CLIP_KEYS, *_FIGURES), clips)
    groups = [
        (kind, score.group, score.count, score.policy, score.test, *row)
        for kind, scores in study.groups.items()
        for score in scores
        for row in _rows(score.figures)
    ]
    write(folder / _GROUPS, ("grouping", "group", "count", "policy", "test", *_FIGURES), groups)
    curves = [
        (point.disturbance, point.strength, STRENGTHS[point.disturbance].unit, point.policy, *row)
        for point in study.curves
        for row in _rows({"tks": point.tks})
    ]
    write(folder / _CURVES, ("disturbance", "strength", "unit", "policy", *_FIGURES), curves)
    differences = [
        (found.ours, found.policy, found.horizon, *row) for found in study.differences for row in _rows(found.figures)
    ]
    write(folder / _DIFFERENCES, ("ours", "policy", "horizon", *_FIGURES), differences)


def read_study(folder: Path) -> Study:
    """Return the results that :func:`write_study` wrote, without records.

    Raises:
        RecordsError: for a file that cannot be read, or lacks a column.
    """
    try:
        return _study(folder)
    except (KeyError, ValueError) as error:
        if isinstance(error, PlatError):
            raise
        raise RecordsError(f"{str(folder)!r}: not the tables of a study ({short(error)})") from None


def _study(folder: Path) -> Study:
    study = Study(
        scores=_scores(folder / _SCORES),
        interfaces=_scores(folder / _INTERFACES),
        dense=_scores(folder / _DENSE),
        clips=_clips(folder / _CLIPS),
        dense_clips=_clips(folder / _DENSE_CLIPS),
    )
    keys = ("grouping", "group", "count", "policy", "test")
    for (kind, group, count, policy, test), figures in _read(folder / _GROUPS, keys):
        study.groups.setdefault(kind, []).append(GroupScore(policy, test, group, int(count), figures))
    for (name, strength, _, policy), figures in _read(folder / _CURVES, ("disturbance", "strength", "unit", "policy")):
        disturbance = next((known for known in STRENGTHS if known == name), None)
        if disturbance is None:
            raise RecordsError(f"{str(folder / _CURVES)!r}: {short(name)} is no disturbance")
        study.curves.append(CurvePoint(policy, disturbance, float(strength), figures["tks"]))
    for (ours, policy, horizon), figures in _read(folder / _DIFFERENCES, ("ours", "policy", "horizon")):
        study.differences.append(Difference(ours, policy, horizon, figures))
    return study


def _scores(path: Path) -> list[Score]:
    found = _read(path, ("policy", "horizon"))
    return [Score(policy, horizon, (), figures) for (policy, horizon), figures in found]


def _clips(path: Path) -> list[ClipScore]:
    found = _read(path, _CLIP_KEYS)
    return [ClipScore(policy, rule, int(count), figures) for (policy, rule, count), figures in found]


def _rows(figures: Mapping[str, Estimate]) -> list[tuple[Any, ...]]:
    return [(name, figure.value, figure.low, figure.high) for name, figure in figures.items()]


def _write(path: Path, head: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    if rows:
        replace_table(path, head, rows)
    else:
        path.unlink(missing_ok=True)  # of an earlier plan


def _read(path: Path, keys: Sequence[str]) -> Iterable[tuple[tuple[str, ...], dict[str, Estimate]]]:
    """Yield the keys of each result with its figures; nothing where there is no file."""
    if not path.exists():
        return
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        for found, group in groupby(rows, key=lambda row: tuple(row[key] for key in keys)):
            yield found, {row["metric"]: Estimate(*(float(row[end]) for end in _FIGURES[1:])) for row in group}
    except (OSError, KeyError, TypeError, ValueError, csv.Error) as error:
        raise RecordsError(f"{str(path)!r}: not a table of a study ({short(error)})") from None
