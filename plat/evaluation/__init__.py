"""Evaluation: run commands, record them, report figures."""

from plat.evaluation.records import CommandRecorder, CommandRecords
from plat.evaluation.report import Estimate, Penalties, report, success_curve
from plat.evaluation.runner import evaluate, make_evaluation_env

__all__ = [
    "CommandRecorder",
    "CommandRecords",
    "Estimate",
    "Penalties",
    "evaluate",
    "make_evaluation_env",
    "report",
    "success_curve",
]
