"""Metadata of a run for its bundle."""

import math

from plat.deploy.bundle import Bundle, BundleScore, PolicyFacts, TrainingFacts
from plat.modules import LatentPolicy, ResidualActionPolicy, ResidualLatentPolicy
from plat.robots.describe import describe_robot
from plat.runs import Policy, SavedRun, policy_spec
from plat.spec.observation import optional_groups
from plat.spec.timing import Timing, timing_of

__all__ = ["describe_policy"]


def describe_policy(policy: Policy, run: SavedRun) -> Bundle:
    """Return the metadata of a bundle: everything but the network.

    Args:
        policy: the run's policy.
        run: the run on disk.

    Raises:
        CheckpointError: when the run's table of scores cannot be read.
    """
    timing = timing_of(policy) or Timing()
    student = getattr(policy, "student", policy)
    refined = isinstance(policy, ResidualLatentPolicy | ResidualActionPolicy)
    scores = run.scores or ()
    return Bundle(
        robot=describe_robot(policy.robot, timing.control_dt),
        timing=timing,
        policy=PolicyFacts(
            kind=policy_spec(policy)["kind"],
            latent_size=student.config.latent_size if isinstance(student, LatentPolicy) else None,
            residual_alpha=policy.config.alpha if refined else None,
        ),
        training=TrainingFacts(
            run=run.name,
            recipe=run.recipe,
            **{name: run.made_with.get(name) for name in ("plat", "torch", "commit")},
        ),
        # a metric without a case is NaN, which JSON does not have
        scores=tuple(BundleScore(*score) for score in scores if all(map(math.isfinite, score[2:]))) or None,
        also=optional_groups(policy.deployed().in_keys),
    )
