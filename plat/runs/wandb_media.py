"""Scores, figures and videos for wandb."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from plat.evaluation import Score
from plat.evaluation.table import COLUMNS, rows

__all__ = ["log_scores", "log_video"]


def log_scores(run: Any, scores: Sequence[Score], figures: Sequence[Path] = ()) -> None:
    """Log the evaluation's table, one row a policy, horizon and metric, and its pictures.

    Args:
        run: of wandb, as :func:`plat.runs.wandb_run` starts it.
        scores: the table.
        figures: files; of them, the ``.png`` are logged under their names.
    """
    import wandb  # as in wandb_run: seconds that only those who ask for it pay

    table = wandb.Table(columns=list(COLUMNS), data=rows(scores))
    images = {f"figures/{path.stem}": wandb.Image(str(path)) for path in figures if path.suffix == ".png"}
    run.log({"evaluation": table, **images})


def log_video(run: Any, path: Path, step: int) -> None:
    """Log an MP4."""
    import wandb

    run.log({"video": wandb.Video(str(path), format="mp4")}, step=step)
