"""What the recipes share: run directories, budgets, metrics files, saved policies."""

from plat.runs.budget import Budget
from plat.runs.loggers import check_logger, log_table, log_video, start_logging
from plat.runs.metrics import MetricsFile
from plat.runs.recipe import RecipeConfig, default_device, report_errors
from plat.runs.run import Run
from plat.runs.saving import load_policy, policy_spec, read_json, register_policy, save_weights, write_json

__all__ = [
    "Budget",
    "MetricsFile",
    "RecipeConfig",
    "Run",
    "check_logger",
    "default_device",
    "load_policy",
    "log_table",
    "log_video",
    "policy_spec",
    "read_json",
    "register_policy",
    "report_errors",
    "save_weights",
    "start_logging",
    "write_json",
]
