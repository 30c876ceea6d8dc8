"""What the recipes share: run directories, budgets, metrics files, saved policies."""

from plat.training.budget import Budget
from plat.training.metrics import MetricsFile
from plat.training.recipe import RecipeConfig, default_device, report_errors
from plat.training.run import Run
from plat.training.saving import load_policy, policy_spec, read_json, save_weights, write_json

__all__ = [
    "Budget",
    "MetricsFile",
    "RecipeConfig",
    "Run",
    "default_device",
    "load_policy",
    "policy_spec",
    "read_json",
    "report_errors",
    "save_weights",
    "write_json",
]
