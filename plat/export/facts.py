"""What a bundle tells of a run's policy beside its network."""

import csv
from pathlib import Path
from typing import Any

from plat.deploy.bundle import Bundle, PolicyFacts, Score, TrainingFacts
from plat.errors import BundleError
from plat.keyframes import CONTROL_DT, MAX_STEPS
from plat.modules import PlainPolicy, ResidualActionPolicy, ResidualLatentPolicy
from plat.robots.describe import describe_robot
from plat.runs.saving import policy_spec, read_json

__all__ = ["EVALUATION_FILE", "describe_policy"]

EVALUATION_FILE = "evaluation.csv"
"""In a run directory: the table that ``recipes/evaluate.py --csv`` wrote."""


def describe_policy(policy: Any, run: Path) -> Bundle:
    """Everything in a bundle but the network.

    Args:
        policy: of a run; see :func:`plat.runs.load_policy`.
        run: its directory.

    Raises:
        BundleError: when the table of scores in the directory cannot be used.
    """
    config = read_json(run / "config.json")
    made_with = config.get("made_with", {})
    student = getattr(policy, "student", policy)
    refined = isinstance(policy, ResidualLatentPolicy | ResidualActionPolicy)
    return Bundle(
        robot=describe_robot(policy.robot, CONTROL_DT),
        max_steps=MAX_STEPS,
        policy=PolicyFacts(
            kind=policy_spec(policy)["kind"],
            latent_size=None if isinstance(student, PlainPolicy) else student.config.latent_size,
            residual_alpha=policy.config.alpha if refined else None,
        ),
        training=TrainingFacts(
            run=run.resolve().name,
            recipe=config.get("recipe", {}).get("name"),
            **{name: made_with.get(name) for name in ("plat", "torch", "commit")},
        ),
        scores=_scores(run),
    )


def _scores(run: Path) -> tuple[Score, ...] | None:
    path = run / EVALUATION_FILE
    if not path.exists():
        return None
    name = run.resolve().name
    try:
        with path.open(newline="", encoding="utf-8") as file:
            scores = tuple(
                Score(row["horizon"], row["metric"], *(float(row[figure]) for figure in ("value", "low", "high")))
                for row in csv.DictReader(file)
                if row["policy"] == name
            )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise BundleError(f"{str(path)!r}: not a table of recipes/evaluate.py --csv ({error!r})") from None
    if not scores:
        raise BundleError(f"{str(path)!r}: no row of the policy {name!r}, expected those of its own run")
    return scores
