"""Playback of a chase, for pictures and videos."""

from collections.abc import Iterable

import numpy as np

from plat.control.chase import ChaseStep
from plat.control.scores import KeyframeScore, KeyframeScorer, StepErrors
from plat.errors import StateError
from plat.rendering.playback import Playback

__all__ = ["record"]

_SHOWN = 0.8
"""Seconds that the outcome of a keyframe is shown after its arrival."""


def record(steps: Iterable[tuple[ChaseStep, StepErrors]], scorer: KeyframeScorer | None = None) -> Playback:
    """Return the playback of a chase; ``steps_left`` is 0 while the last keyframe is held.

    Args:
        steps: each step with the errors that :class:`plat.control.KeyframeScorer` found.
        scorer: the scorer that found them. Given, the playback tells the outcome of each keyframe in words.

    Raises:
        StateError: for no steps.

    >>> from plat.robots import G1
    >>> from plat.keyframes import KeyframeSequence, standing
    >>> from plat.modules import Expert
    >>> from plat.control import Chase, KeyframeScorer, PolicyController, Simulator
    >>> sequence = KeyframeSequence(G1, standing(G1), (standing(G1).at(0.1),))
    >>> chase = Chase(PolicyController(Expert(G1).deployed(), G1), sequence, Simulator(G1.model()), hold=0.02)
    >>> scorer = KeyframeScorer(G1)
    >>> playback = record(((step, scorer.add(step)) for step in chase), scorer)
    >>> playback.steps_left, playback.words[-1]
    (array([5, 4, 3, 2, 1, 0]), '1: reached')
    """
    taken = list(steps)
    if not taken:
        raise StateError("record: no steps, expected those of a chase; one may end with its first")
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
        for step, errors in taken
    ]
    qpos, targets, steps_left, lengths, failed, reached, dts = map(np.array, zip(*rows, strict=True))
    words: tuple[str, ...] = ()
    if scorer is not None:
        scores = scorer.scores()
        words = tuple(_shown(step, errors, scores) for step, errors in taken)
        failed = failed | np.array([_missed(step, scores) for step, _ in taken])
    return Playback(qpos, targets, steps_left, lengths, failed, reached, float(dts[0]), words)


def _shown(step: ChaseStep, errors: StepErrors, scores: list[KeyframeScore]) -> str:
    """Words of the last arrival while it is fresh or held; nothing before it is."""
    timing = step.timing
    begin = timing.steps(step.time) - 1
    arrived = [score for score in scores if timing.steps(score.time) <= begin]
    fresh = arrived and (begin - timing.steps(arrived[-1].time)) * timing.control_dt <= _SHOWN + 1e-9
    if not arrived or not (fresh or step.holding):
        return ""
    score = arrived[-1]
    told = score.outcome + (f": {', '.join(score.faults)}" if score.faults else "")
    afterwards = ", fell afterwards" if step.holding and score.fell_afterwards and errors.down else ""
    return f"{score.name or score.index + 1}: {told}{afterwards}"


def _missed(step: ChaseStep, scores: list[KeyframeScore]) -> bool:
    """Whether the step is the arrival of a keyframe that was not reached."""
    arrives = not step.holding and step.command.steps_left == 1
    return arrives and any(score.index == step.command.index and not score.reached for score in scores)
