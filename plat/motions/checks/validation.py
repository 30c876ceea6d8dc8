"""Whether a motion is fit to train on."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

import mujoco
import numpy as np
import torch

from plat.motions.checks.collision import self_penetration
from plat.motions.checks.feet import Soles, contact_slip, ground_level
from plat.motions.checks.flight import Flight
from plat.motions.checks.jumps import root_jumps
from plat.motions.checks.root_path import OtherPath, other_path
from plat.motions.checks.settings import ValidationLimits
from plat.motions.checks.sides import EXCHANGED, apart
from plat.motions.checks.steps import JointStep, joint_steps
from plat.motions.checks.tempo import Cadence
from plat.motions.checks.underside import Underside
from plat.motions.clip import ASSUMED_RATE, MotionClip, as_clips
from plat.progress import tracked
from plat.robots import G1, Robot
from plat.words import counted

__all__ = ["MotionReport", "MotionValidator", "ValidationLimits", "Verdict", "validate_motion", "validate_motions"]

Verdict = Literal["use", "repair", "drop"]

# A sole that is as low as the lowest part is that part (m).
_SAME = 1e-6
# So deep under the floor no drift carries the trunk (m).
_FAR_BELOW, _TRUNK = 0.3, ("pelvis", "torso_link")
# Feet that slide this fast (m/s), and with this share of the root's speed, belong to a root that goes elsewhere. Of
# 2,449 clips two are so that slip by less than 1 m/s; of 219 that move, nearly all are when the root stays in place, or
# its x and y are exchanged.
_SLIDES, _SLIDES_ALONG = 0.4, 0.6
# Up component of the root's own up axis, mean over the frames, over which someone stands rather than lies.
_UPRIGHT = 0.5
# So many changes of pose at least, and this share of alike gaps between them, where frames stand several times.
_LEAST_GAPS, _REGULAR = 8, 0.9
# Collisions are looked for this often (Hz): limbs that go through each other do so for longer.
_COLLISION_RATE = 10.0


@dataclass(frozen=True)
class MotionReport:
    """What was measured of a clip, and what to do with it.

    Attributes:
        name: of the clip.
        seconds: from the first to the last frame.
        joint_excess: largest angle beyond a joint's limits (rad).
        joint_speed: fastest joint, from frame to frame (rad/s).
        penetration: depth of the lowest point of all frames under the floor (m): of a sole, or of another part of the
            robot, looked for ten times a second.
        deepest: the body that it is of.
        floating: height of the lowest sole point while the lower foot rests, median (m); negative when it rests under
            the floor. A clip in which no foot ever rests is measured by its lowest frame, and one in which another part
            of the robot is lower, such as that of someone who lies, by that part.
        slip: how fast the lowest point of the steadier foot goes sideways, mean over the frames with a foot in contact
            (m/s). In contact is a foot less than 2 cm above the level that the feet rest on, wherever the floor is.
        root_speed: how fast the root goes sideways, mean over the frames (m/s).
        self_penetration: depth of the deepest contact of two links of the robot (m), looked for ten times a second.
        tempo: how many times as often as people with that step length it steps, None where it has no regular gait; a
            wrong frame rate shows here.
        gravity: acceleration of its fastest free fall (g), None where it has none; a wrong frame rate shows here.
        sides: roll of the left shoulder over that of the right one, mean (rad), None for a robot without and for
            who lies; negative where left and right are exchanged.
        jumps: when the root's path or turning breaks (s).
        steps: isolated single-frame steps of joints; see :func:`~plat.motions.checks.steps.joint_steps`.
        in_place: whether it strides without getting anywhere.
        path: that the feet fit better than the root's own, None where there is none: its path is mirrored, turned, or
            of another length.
        repeats: how many times each frame stands in the clip, one behind the other.
        rate_assumed: whether nothing states its frame rate and nothing in the motion confirms the usual one.
        verdict: ``use`` as it is, ``repair`` first, or ``drop``.
        reasons: what speaks against using it as it is, a phrase each.
    """

    name: str
    seconds: float
    joint_excess: float
    joint_speed: float
    penetration: float
    floating: float
    slip: float
    self_penetration: float
    jumps: tuple[float, ...]
    tempo: float | None = None
    gravity: float | None = None
    sides: float | None = None
    steps: tuple[JointStep, ...] = ()
    root_speed: float = 0.0
    in_place: bool = False
    path: OtherPath | None = None
    repeats: int = 1
    rate_assumed: bool = False
    deepest: str = ""
    verdict: Verdict = "use"
    reasons: tuple[str, ...] = ()

    @property
    def shows_rate(self) -> bool:
        """Return whether something in the motion speaks for or against its frame rate: a gait or a fall."""
        return self.tempo is not None or self.gravity is not None


def validate_motion(clip: MotionClip, robot: Robot = G1, limits: ValidationLimits | None = None) -> MotionReport:
    """Measure a clip; see :func:`validate_motions`.

    >>> standing = MotionClip("standing", G1.default_qpos[None].repeat(60, 0), 30.0)
    >>> validate_motion(standing).verdict
    'use'
    """
    return validate_motions([clip], robot, limits)[0]


def validate_motions(
    clips: MotionClip | Iterable[MotionClip], robot: Robot = G1, limits: ValidationLimits | None = None
) -> list[MotionReport]:
    """Measure clips and judge them by the limits.

    Raises:
        MotionError: when a clip is broken; see :meth:`MotionClip.checked`.
    """
    validator = MotionValidator(robot, limits)
    return [validator(clip) for clip in tracked(as_clips(clips, "validation"), "checking motions", unit="clips")]


class MotionValidator:
    """Validator of clips, one after the other; see :func:`validate_motions`.

    Args:
        robot: whose motions they are.
        limits: what they are judged by.
    """

    def __init__(self, robot: Robot = G1, limits: ValidationLimits | None = None):
        self._robot = robot
        self._limits = limits or ValidationLimits()
        self._soles, self._underside = Soles(robot), Underside(robot)

    def __call__(self, clip: MotionClip) -> MotionReport:
        """Measure a clip and judge it.

        Raises:
            MotionError: when it is broken; see :meth:`MotionClip.checked`.
        """
        clip = clip.checked(self._robot)
        return _judged(_measure(clip, self._robot, self._limits, self._soles, self._underside), self._limits)


def _measure(
    clip: MotionClip, robot: Robot, limits: ValidationLimits, soles: Soles, underside: Underside
) -> MotionReport:
    qpos = torch.from_numpy(clip.qpos).double()
    joint_pos = qpos[:, 7:]
    low, high = robot.joint_range.double().unbind(-1)
    feet_pos, feet_quat = soles.feet(qpos)
    points = soles.points_of(feet_pos, feet_quat)
    cadence = Cadence.of(clip, robot, feet_pos)
    tempo = None if cadence is None else cadence.tempo
    level = ground_level(points, clip.fps)
    if level > limits.floating:
        level = ground_level(points, clip.fps, underside.heights(clip.qpos).min(1))
    inside, deep, part = _looked_at(clip, robot, underside)
    sole = float(points[..., 2].min())
    return MotionReport(
        name=clip.name,
        seconds=clip.duration,
        joint_excess=float((low - joint_pos).maximum(joint_pos - high).max().clamp_min(0)),
        joint_speed=float(joint_pos.diff(dim=0).abs().max()) * clip.fps,
        penetration=max(0.0, -sole, -deep),
        deepest="a foot" if sole <= deep + _SAME else part,
        floating=level,
        slip=contact_slip(points, level, clip.fps),
        self_penetration=inside,
        jumps=tuple(frame / clip.fps for frame in root_jumps(qpos, limits)),
        sides=apart(clip.qpos[:, 7:], robot, "shoulder_roll") if _stands(qpos) else None,
        gravity=None if (flight := Flight.of(clip, robot, points)) is None else flight.gravity(clip.fps),
        tempo=None if tempo is None else tempo.ratio(clip.fps),
        steps=tuple(joint_steps(clip, limits.step_speed, robot)),
        root_speed=float(qpos[:, :2].diff(dim=0).norm(dim=-1).mean()) * clip.fps,
        in_place=cadence is not None and cadence.in_place,
        path=other_path(points, clip.qpos[:, :3], clip.fps) if _stands(qpos) else None,
        repeats=_repeats(clip.qpos),
        rate_assumed=ASSUMED_RATE in clip.notes,
    )


def _repeats(qpos: np.ndarray) -> int:
    """Return how many times each frame of a motion stands in it, as where a rate was raised by writing frames again."""
    moves = np.flatnonzero((np.diff(qpos, axis=0) != 0).any(1))
    gaps = np.diff(moves)
    if len(gaps) < _LEAST_GAPS:
        return 1
    usual = int(np.median(gaps))
    return usual if usual > 1 and (gaps % usual == 0).mean() > _REGULAR else 1


def _stands(qpos: torch.Tensor) -> bool:
    """Return whether the root is upright, more or less, in the mean of the frames."""
    x, y = qpos[:, 4], qpos[:, 5]
    return float((1 - 2 * (x * x + y * y)).mean()) > _UPRIGHT


def _looked_at(clip: MotionClip, robot: Robot, underside: Underside) -> tuple[float, float, str]:
    """Return how deep links are inside each other, and the height and name of the lowest part, ten times a second."""
    model, data = robot.shared_model, mujoco.MjData(robot.shared_model)
    inside, lowest, part = 0.0, float("inf"), ""
    for pose in clip.qpos[:: max(1, round(clip.fps / _COLLISION_RATE))]:
        inside = max(inside, self_penetration(model, pose, data))
        lowest, part = min((lowest, part), underside.lowest(data))
    return inside, lowest, part


def _judged(report: MotionReport, limits: ValidationLimits) -> MotionReport:
    drop, repair = [], []
    if report.seconds < limits.min_seconds:
        drop.append(f"{report.seconds:.2f} s long")
    if report.joint_excess > limits.max_joint_excess:
        drop.append(f"{report.joint_excess:.2f} rad beyond a joint's limits")
    elif report.joint_excess > limits.joint_excess:
        repair.append(f"{report.joint_excess:.2f} rad beyond a joint's limits")
    if report.joint_speed > limits.joint_speed:
        drop.append(f"a joint at {report.joint_speed:.0f} rad/s")
    if report.steps:
        first, count = report.steps[0], len(report.steps)
        repair.append(f"{counted(count, 'single-frame step')} of joints, the first {first}")
    if report.floating > limits.floating:
        repair.append(f"feet float at {100 * report.floating:.1f} cm")
    if report.penetration > limits.penetration:
        part = report.deepest.removesuffix("_link").replace("_", " ")
        doubt = ": is its up axis right? (--up)" if report.penetration > _FAR_BELOW and report.deepest in _TRUNK else ""
        repair.append(f"{part} {100 * report.penetration:.1f} cm under the floor{doubt}")
    if report.slip > limits.slip:
        drop.append(f"feet slip at {report.slip:.1f} m/s")
    elif report.slip > max(_SLIDES, _SLIDES_ALONG * report.root_speed):
        told = f"feet slip at {report.slip:.1f} m/s under a root at {report.root_speed:.1f} m/s"
        drop.append(f"{told}: are the root's unit, axes and frame right?")
    if report.path is not None:
        drop.append(f"{report.path}: are the root's unit and axes right?")
    if report.self_penetration > limits.self_penetration:
        drop.append(f"links {100 * report.self_penetration:.1f} cm inside each other")
    if report.tempo is not None and not 1 / limits.tempo < report.tempo < limits.tempo:
        repair.append(f"{report.tempo:.2g} times as many steps a second as people take: is its frame rate right?")
    if report.gravity is not None and not 1 / limits.gravity < report.gravity < limits.gravity:
        repair.append(f"it falls at {report.gravity:.2g} g: is its frame rate right?")
    if report.repeats > 1:
        repair.append(f"each frame stands {report.repeats} times: is its frame rate right?")
    if report.rate_assumed:
        repair.append("nothing states or shows its frame rate: state it (--fps)")
    if report.sides is not None and report.sides < EXCHANGED:
        drop.append("left and right arms are exchanged: are its joint names right?")
    if report.in_place:
        repair.append("it strides and its root stays in place: is the root's position relative?")
    if report.jumps:
        inside = [time for time in report.jumps if limits.trim_seconds < time < report.seconds - limits.trim_seconds]
        (drop if inside else repair).append(f"the root jumps at {(inside or report.jumps)[0]:.2f} s")
    verdict: Verdict = "drop" if drop else "repair" if repair else "use"
    return replace(report, verdict=verdict, reasons=(*drop, *repair))
