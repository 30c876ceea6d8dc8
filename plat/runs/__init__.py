"""Run directories, budgets, metrics files and saved policies."""

from typing import TYPE_CHECKING

from plat.lazy import lazy

if TYPE_CHECKING:
    from plat.runs.average import average_runs, average_weights
    from plat.runs.budget import Budget
    from plat.runs.dynamics import DYNAMICS_FILE, load_dynamics, save_dynamics
    from plat.runs.hub import download_run, upload_run
    from plat.runs.inputs import check_drives, run_inputs, same_robot, training_motions
    from plat.runs.json_object import read_json, write_json
    from plat.runs.locate import is_run, run_folder, shipped_runs
    from plat.runs.loggers import check_logger, log_table, log_video, start_logging
    from plat.runs.metrics import MetricsFile
    from plat.runs.outputs import check_out
    from plat.runs.policies import Policy, policy_spec, register_policy
    from plat.runs.recipe import RecipeConfig, begin, default_device, on_device, report_errors
    from plat.runs.run import Run
    from plat.runs.saved_run import RunScore, SavedRun, load_policy, save_weights
else:
    lazy(__name__)

__all__ = [
    "DYNAMICS_FILE",
    "Budget",
    "MetricsFile",
    "Policy",
    "RecipeConfig",
    "Run",
    "RunScore",
    "SavedRun",
    "average_runs",
    "average_weights",
    "begin",
    "check_drives",
    "check_logger",
    "check_out",
    "default_device",
    "download_run",
    "is_run",
    "load_dynamics",
    "load_policy",
    "log_table",
    "log_video",
    "on_device",
    "policy_spec",
    "read_json",
    "register_policy",
    "report_errors",
    "run_folder",
    "run_inputs",
    "same_robot",
    "save_dynamics",
    "save_weights",
    "shipped_runs",
    "start_logging",
    "training_motions",
    "upload_run",
    "write_json",
]
