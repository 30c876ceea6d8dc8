"""The repairs that the checks ask for, and no others."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import torch

from plat.motions.checks.feet import Soles, ground_level, stance
from plat.motions.checks.repair import clip_to_limits, ground_feet, trim_motion
from plat.motions.checks.settings import ValidationLimits
from plat.motions.checks.steps import smooth_steps
from plat.motions.checks.validation import MotionReport, validate_motion
from plat.motions.clip import MotionClip
from plat.robots import G1, Robot

__all__ = ["Mended", "mend_motion"]

_URGENCY = ("use", "repair", "drop")
# Share of the frames with a resting foot in which a repair may lift it.
_FEW = 0.1


@dataclass(frozen=True)
class Mended:
    """Clip that was repaired as the checks ask.

    Attributes:
        clip: the repaired motion, or the same one where nothing was to be done or could be.
        before, after: what the checks say of it.
        done: the repairs, a phrase each.
    """

    clip: MotionClip
    before: MotionReport
    after: MotionReport
    done: tuple[str, ...] = ()


def mend_motion(clip: MotionClip, robot: Robot = G1, limits: ValidationLimits | None = None) -> Mended:
    """Return a clip with what :func:`validate_motion` asks for repaired, and everything else as it was.

    Ends with a jump are trimmed, single-frame steps smoothed, angles clipped to limits, and feet put on the floor: all
    frames alike if that is enough, else following a floor that drifts. A repair is kept only if less is left to repair,
    in kind or amount, and the verdict is no worse. It must not lift standing feet off the floor because a hand is under
    it.

    Args:
        clip: a motion.
        robot: whose motion it is.
        limits: what is to be repaired.

    >>> qpos = G1.default_qpos[None].repeat(60, 0)
    >>> qpos[:, 2] += 0.1
    >>> mended = mend_motion(MotionClip("floating", qpos, 30.0))
    >>> mended.before.verdict, mended.after.verdict, mended.done
    ('repair', 'use', ('feet put on the floor',))
    """
    limits = limits or ValidationLimits()
    before = after = validate_motion(clip, robot, limits)
    done = []
    for what, needed, repair in _repairs(robot, limits):
        if not needed(after, clip):
            continue
        repaired = repair(clip, after)
        report = validate_motion(repaired, robot, limits)
        worse = _URGENCY.index(report.verdict) > _URGENCY.index(after.verdict)
        if _left(report) < _left(after) and not worse and not _lifts_feet(clip, repaired, robot, limits):
            clip, after = repaired, report
            done.append(what)
    return Mended(clip, before, after, tuple(done))


def _left(report: MotionReport) -> tuple[int, float, int]:
    """Return how much is left to repair: reasons, centimeters off the floor, steps; where feet rest counts double."""
    centimeters = 100 * (2 * abs(report.floating) + max(report.penetration, 0.0))
    return len(report.reasons), round(centimeters), len(report.steps)


def _lifts_feet(before: MotionClip, after: MotionClip, robot: Robot, limits: ValidationLimits) -> bool:
    """Return whether a repair puts feet into the air that rest on the floor, in more than a few of these frames."""
    if len(before.qpos) != len(after.qpos):
        return False
    soles = Soles(robot)
    points, repaired = (soles.points(torch.from_numpy(clip.qpos)) for clip in (before, after))
    low, height = (each[..., 2].amin((1, 2)) for each in (points, repaired))
    floor = ground_level(points, before.fps)  # of a clip that floats or sinks
    standing = stance(points, before.fps) & ((low - floor).abs() < limits.floating)
    few = _FEW * standing.sum()
    # what leaves the feet of a clip that floats where they are is not to blame for their height
    moved = (height - low).abs() > limits.floating
    lifted = height > limits.penetration
    return bool((standing & moved).sum() > few and (standing & lifted).sum() > few)


_Needed = Callable[[MotionReport, MotionClip], bool]
_Repair = Callable[[MotionClip, MotionReport], MotionClip]


def _repairs(robot: Robot, limits: ValidationLimits) -> Iterator[tuple[str, _Needed, _Repair]]:
    """Return name, whether it is needed, and the repair itself, in the order in which they are tried."""

    def off(report: MotionReport, clip: MotionClip) -> tuple[float, float]:
        """Return the seconds that jumps near the ends take off start and end."""
        middle = 0.5 * report.seconds
        start = max((time + 1 / clip.fps for time in report.jumps if time < middle), default=0.0)
        end = max((report.seconds - time + 1 / clip.fps for time in report.jumps if time >= middle), default=0.0)
        return start, end

    def near_ends(report: MotionReport, clip: MotionClip) -> bool:
        start, end = off(report, clip)
        near = max(start, end) <= limits.trim_seconds + 2 / clip.fps
        return bool(report.jumps) and near and report.seconds - start - end >= limits.min_seconds

    def ungrounded(report: MotionReport, _: MotionClip) -> bool:
        return report.floating > limits.floating or report.penetration > limits.penetration

    yield "ends trimmed", near_ends, lambda clip, report: trim_motion(clip, *off(report, clip))
    yield (
        "single-frame steps smoothed",
        lambda report, _: bool(report.steps),
        lambda clip, _: smooth_steps(clip, limits.step_speed, robot).clip,
    )
    yield (
        "joints clipped to their limits",
        lambda report, _: limits.joint_excess < report.joint_excess <= limits.max_joint_excess,
        lambda clip, _: clip_to_limits(clip, robot),
    )
    yield "feet put on the floor", ungrounded, lambda clip, _: ground_feet(clip, "clip", robot)
    yield "feet put on a floor that drifts", ungrounded, lambda clip, _: ground_feet(clip, "smooth", robot)
