"""Evaluation: run commands, record them, report figures."""

from typing import TYPE_CHECKING

from plat.lazy import lazy

if TYPE_CHECKING:
    from plat.evaluation.clip_playback import play
    from plat.evaluation.entrant import Entrant, ReferenceTracker
    from plat.evaluation.records import CommandRecorder, CommandRecords
    from plat.evaluation.report import Estimate, Penalties, compare, report, success_curve
    from plat.evaluation.rollout import EvaluationEnv, make_evaluation_env, policy_steps
    from plat.evaluation.score_table import HEADLINE, METRICS, Metric, Score, differences, markdown, write_csv
    from plat.evaluation.scoring import evaluate
    from plat.evaluation.setting import EvaluationSetting, Observe, ReferenceView
else:
    lazy(__name__)

__all__ = [
    "HEADLINE",
    "METRICS",
    "CommandRecorder",
    "CommandRecords",
    "Entrant",
    "Estimate",
    "EvaluationEnv",
    "EvaluationSetting",
    "Metric",
    "Observe",
    "Penalties",
    "ReferenceTracker",
    "ReferenceView",
    "Score",
    "compare",
    "differences",
    "evaluate",
    "make_evaluation_env",
    "markdown",
    "play",
    "policy_steps",
    "report",
    "success_curve",
    "write_csv",
]
