"""Evaluation: run commands, record them, report figures."""

from typing import TYPE_CHECKING

from plat.lazy import lazy

if TYPE_CHECKING:
    from plat.evaluation.clip_playback import play
    from plat.evaluation.clip_records import ClipRecords
    from plat.evaluation.disturbance import Disturbance
    from plat.evaluation.entrant import Entrant, ReferenceTracker
    from plat.evaluation.records import CommandRecorder, CommandRecords
    from plat.evaluation.report import Estimate, Penalties, compare, report, report_clips, success_curve
    from plat.evaluation.rollout import EvaluationEnv, make_evaluation_env, policy_steps
    from plat.evaluation.score_table import (
        CLIP_METRICS,
        HEADLINE,
        METRICS,
        Metric,
        Score,
        differences,
        markdown,
        write_csv,
    )
    from plat.evaluation.scoring import evaluate
    from plat.evaluation.setting import EvaluationSetting, Interface, Observe, ReferenceView
    from plat.evaluation.success_rules import RULES, SuccessRule
    from plat.evaluation.whole_clip import evaluate_clips
else:
    lazy(__name__)

__all__ = [
    "CLIP_METRICS",
    "HEADLINE",
    "METRICS",
    "RULES",
    "ClipRecords",
    "CommandRecorder",
    "CommandRecords",
    "Disturbance",
    "Entrant",
    "Estimate",
    "EvaluationEnv",
    "EvaluationSetting",
    "Interface",
    "Metric",
    "Observe",
    "Penalties",
    "ReferenceTracker",
    "ReferenceView",
    "Score",
    "SuccessRule",
    "compare",
    "differences",
    "evaluate",
    "evaluate_clips",
    "make_evaluation_env",
    "markdown",
    "play",
    "policy_steps",
    "report",
    "report_clips",
    "success_curve",
    "write_csv",
]
