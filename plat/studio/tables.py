"""Markdown tables of errors and scores."""

import math
from collections.abc import Mapping, Sequence

from plat.control import FELL, ChaseStep, KeyframeScore, PoseErrors, distance_text, error_text, tally
from plat.studio.player import Summary
from plat.studio.timeline import Timeline

__all__ = ["drawn_scores", "grade", "keyframe_table", "live_line", "policy_table"]

_GRADES = ("reached", "late", "fell")  # the worst last


def live_line(timeline: Timeline, step: ChaseStep, errors: PoseErrors) -> str:
    """Return the status line of a playing robot: keyframe, time left and current errors.

    Args:
        timeline: the keyframes.
        step: the last step.
        errors: of the robot against the commanded keyframe, at its end.
    """
    called = _plain(timeline.labels[timeline.toward(step.command.keyframe.time)])
    when = "held" if step.holding else f"in {(step.command.steps_left - 1) * step.timing.control_dt:.2f} s"
    fallen = " **fallen**" if errors.down else ""
    figures = ((errors.keypoint, "m"), (errors.joint, "rad"))
    away = " and ".join(f"{value:.2f} {unit}" for value, unit in figures if not math.isnan(value))
    return f"{step.time:.1f} s: keyframe **{called}** {when}{away and f', {away} away'}{fallen}"


def grade(score: KeyframeScore) -> str:
    """Return the outcome in a word, for a color: ``"reached"``, ``"late"`` or ``"fell"``."""
    if score.fell_afterwards or score.outcome == FELL:
        return "fell"
    return "reached" if score.reached else "late"


def drawn_scores(timeline: Timeline, scores: Sequence[KeyframeScore]) -> dict[int, KeyframeScore]:
    """Return the score of each keyframe that was drawn, by its number: of its arrival and its hold, the worst.

    Poses on the way to it, at which a long interval is split, nobody drew: of them counts a fall.
    """
    found: dict[int, KeyframeScore] = {}
    for score in scores:
        number = timeline.toward(score.time)
        if score.outcome != FELL and _on_the_way(timeline, score):
            continue
        if number not in found or _GRADES.index(grade(score)) > _GRADES.index(grade(found[number])):
            found[number] = score
    return found


def _on_the_way(timeline: Timeline, score: KeyframeScore) -> bool:
    arrival = timeline.poses[timeline.toward(score.time)].time
    return timeline.timing.steps(score.time) < timeline.timing.steps(arrival)


def keyframe_table(timeline: Timeline, scores: Sequence[KeyframeScore] | None) -> str:
    """Return a table with a row per keyframe: its outcome in words, and its errors. Empty without scores.

    Poses on the way, at which a long interval is split, have rows of their own.
    """
    if scores is None:
        return ""
    rows = ["| keyframe | at | outcome | joints rad | keypoints mm |", "|---|---|---|---|---|"]
    for score in scores:
        errors = f"{error_text(score.joint_error)} | {distance_text(score.keypoint_error)}"
        way = "way to " if _on_the_way(timeline, score) else ""
        label = way + _plain(timeline.labels[timeline.toward(score.time)])
        rows.append(f"| {label} | {score.time:.2f} s | {score.words} | {errors} |")
    return "\n".join(rows)


def policy_table(timeline: Timeline, scores: Mapping[str, Sequence[KeyframeScore]], notes: Mapping[str, str]) -> str:
    """Return a table with a row per policy: the outcomes of the drawn keyframes, and mean errors. Empty without any.

    Args:
        timeline: the keyframes.
        scores: by policy.
        notes: by policy, why it did not play, or when and why its simulation ended early.
    """
    if not scores and not notes:
        return ""
    rows = ["| policy | outcome | joints rad | keypoints mm |", "|---|---|---|---|"]
    for policy, all_scores in scores.items():
        of_policy = [*drawn_scores(timeline, all_scores).values()]
        mean = Summary.of(of_policy)
        errors = f"{error_text(mean.joint_error)} | {distance_text(mean.keypoint_error)}"
        note = f"; {_plain(notes[policy])}" if policy in notes else ""
        rows.append(f"| {_plain(policy)} | {tally(of_policy)}{note} | {errors} |")
    rows += [f"| {_plain(policy)} | {_plain(note)} | - | - |" for policy, note in notes.items() if policy not in scores]
    return "\n".join(rows)


def _plain(text: str) -> str:
    """Return text with Markdown's special characters escaped."""
    return "".join(f"\\{letter}" if letter in r"\`*_{}[]()#+-.!|<>" else letter for letter in text)
