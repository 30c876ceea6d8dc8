"""Evaluation: run commands, record them, report figures."""

from typing import TYPE_CHECKING

from plat.lazy import lazy

if TYPE_CHECKING:
    from plat.evaluation.authored_rollout import Pushes
    from plat.evaluation.authored_scores import (
        AuthoredRecords,
        AuthoredScore,
        author_families,
        authored_table,
        evaluate_authored,
    )
    from plat.evaluation.clip_playback import play
    from plat.evaluation.clip_records import ClipRecords
    from plat.evaluation.difficulty import command_bins, command_difficulty
    from plat.evaluation.disturbance import Disturbance
    from plat.evaluation.entrant import Entrant, ReferenceTracker
    from plat.evaluation.families import families_of, read_manifest
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
    "AuthoredRecords",
    "AuthoredScore",
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
    "Pushes",
    "ReferenceTracker",
    "ReferenceView",
    "Score",
    "SuccessRule",
    "author_families",
    "authored_table",
    "command_bins",
    "command_difficulty",
    "compare",
    "differences",
    "evaluate",
    "evaluate_authored",
    "evaluate_clips",
    "families_of",
    "make_evaluation_env",
    "markdown",
    "play",
    "policy_steps",
    "read_manifest",
    "report",
    "report_clips",
    "success_curve",
    "write_csv",
]
