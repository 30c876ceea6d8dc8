"""Playback of a chase, for pictures and videos."""

from collections.abc import Iterable

import numpy as np

from plat.control.chase import ChaseStep
from plat.control.scores import StepErrors
from plat.rendering.playback import Playback

__all__ = ["record"]


def record(steps: Iterable[tuple[ChaseStep, StepErrors]]) -> Playback:
    """Return the playback of a chase; ``steps_left`` is 0 while the last keyframe is held.

    Args:
        steps: each step with the errors that :class:`plat.control.KeyframeScorer` found.

    >>> from plat.robots import G1
    >>> from plat.keyframes import KeyframeSequence, standing
    >>> from plat.modules import Expert
    >>> from plat.control import Chase, KeyframeScorer, PolicyController, Simulator
    >>> sequence = KeyframeSequence(G1, standing(G1), (standing(G1).at(0.1),))
    >>> chase = Chase(PolicyController(Expert(G1).deployed(), G1), sequence, Simulator(G1.model()))
    >>> scorer = KeyframeScorer(G1)
    >>> record((step, scorer.add(step)) for step in chase).steps_left
    array([5, 4, 3, 2, 1])
    """
    rows = [
        (
            step.before.qpos,
            step.command.keyframe.qpos,
            0 if step.holding else step.command.steps_left,
            step.command.length,
            errors.failed,
            step.after.qpos,
            step.timing.control_dt,
        )
        for step, errors in steps
    ]
    qpos, targets, steps_left, lengths, failed, reached, dts = map(np.array, zip(*rows, strict=True))
    return Playback(qpos, targets, steps_left, lengths, failed, reached, float(dts[0]))
