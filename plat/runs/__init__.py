"""What the recipes share: run directories, budgets, metrics files, saved policies."""

from plat.runs.budget import Budget
from plat.runs.metrics import MetricsFile, wandb_run
from plat.runs.recipe import RecipeConfig, default_device, report_errors
from plat.runs.run import Run
from plat.runs.saving import load_policy, policy_spec, read_json, register_policy, save_weights, write_json
from plat.runs.wandb_media import log_scores, log_video

__all__ = [
    "Budget",
    "MetricsFile",
    "RecipeConfig",
    "Run",
    "default_device",
    "load_policy",
    "log_scores",
    "log_video",
    "policy_spec",
    "read_json",
    "register_policy",
    "report_errors",
    "save_weights",
    "wandb_run",
    "write_json",
]
