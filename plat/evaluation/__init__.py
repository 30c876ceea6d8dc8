"""Evaluation: run commands, record them, report figures."""

from plat.evaluation.clip_playback import play
from plat.evaluation.records import CommandRecorder, CommandRecords
from plat.evaluation.report import Estimate, Penalties, compare, report, success_curve
from plat.evaluation.runner import Observe, evaluate, make_evaluation_env
from plat.evaluation.table import HEADLINE, METRICS, Metric, Score, differences, markdown, write_csv

__all__ = [
    "HEADLINE",
    "METRICS",
    "CommandRecorder",
    "CommandRecords",
    "Estimate",
    "Metric",
    "Observe",
    "Penalties",
    "Score",
    "compare",
    "differences",
    "evaluate",
    "make_evaluation_env",
    "markdown",
    "play",
    "report",
    "success_curve",
    "write_csv",
]
