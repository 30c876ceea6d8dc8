"""What became of each keyframe of a chase: reached, late or off, or fell."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Literal, TypeAlias

import mujoco
import numpy as np
from numpy.typing import NDArray

from plat.control.chase import Chase, ChaseStep
from plat.control.pose_errors import PoseComparison, PoseErrors
from plat.envs.settings import ReachLimits
from plat.errors import ActionError, StateError
from plat.keyframes import Keyframe, KeyframeSequence
from plat.keyframes.roots import with_commanded_root
from plat.robots.robot import Robot
from plat.words import beyond

__all__ = [
    "FELL",
    "LATE_OR_OFF",
    "REACHED",
    "HoldScore",
    "KeyframeScore",
    "KeyframeScorer",
    "Outcome",
    "StepErrors",
    "distance_text",
    "error_text",
    "mean_errors",
    "tally",
]

Outcome: TypeAlias = Literal["reached", "late or off", "fell"]
"""What became of a keyframe."""
REACHED: Outcome = "reached"
LATE_OR_OFF: Outcome = "late or off"
FELL: Outcome = "fell"


@dataclass(frozen=True)
class KeyframeScore:
    """Score of a keyframe.

    A keyframe is *reached* if the robot is near enough at its arrival, meets TKS@3 at each step of the arrival window,
    and has not fallen on the way. Near enough: the root within 0.2 m and the joints within 0.2 rad on average; for a
    partial keyframe all that it commands (:class:`plat.control.ReachLimits`). If the robot fell, it is *fell*; else the
    keyframe is *late or off*.

    Args:
        index: its number in the sequence.
        name: its name.
        time: of the keyframe (s), as it is written; it arrives on the control step nearest to it.
        outcome: ``"reached"``, ``"late or off"`` or ``"fell"``.
        faults: by how much it is late or off, in words: ``("0.24 s late", "0.35 m off")``.
        late: seconds from the arrival until the robot first came near enough, while the next keyframe was
            commanded or in the hold; None when it was in time or never did.
        fell_afterwards: of the last keyframe, whether the robot fell while holding it.
        arrival: the robot's distance from the keyframe at its arrival.
        success: TKS@3: in the pose at each step of the arrival window, and its root not off before.
        root_off: whether the root's height or tilt was beyond the limits of TKS@3 at some step of the command.
        joint_error: mean absolute joint error over the arrival window (rad): MPJPE@3. NaN where a partial keyframe
            commands no joint, and where the simulation diverged before the arrival.
        keypoint_error: mean error of the keypoints in the world over the arrival window (m): MPKPE@3. NaN where it
            commands no place, and likewise.
    """

    index: int
    name: str | None
    time: float
    outcome: Outcome
    faults: tuple[str, ...]
    late: float | None
    fell_afterwards: bool
    arrival: PoseErrors
    success: bool
    root_off: bool
    joint_error: float
    keypoint_error: float

    @property
    def reached(self) -> bool:
        """Return whether it was reached."""
        return self.outcome == REACHED

    @property
    def fell(self) -> bool:
        """Return whether the robot lay down before the arrival."""
        return self.outcome == FELL

    @property
    def words(self) -> str:
        """Return the outcome for a person: ``"late or off: 0.24 s late, 0.35 m off; fell afterwards"``."""
        told = self.outcome + (f": {', '.join(self.faults)}" if self.faults else "")
        return f"{told}; fell afterwards" if self.fell_afterwards else told


@dataclass(frozen=True)
class HoldScore:
    """Score of the hold of the last keyframe.

    Args:
        seconds: held so far.
        fell_at: second of the hold at which the robot lay down; None when it did not, or lay already.
        down: whether the robot lies at the end.
        foot_travel: greatest distance of a foot from where it was when the hold had settled (m); None before that.
        stepped: whether that is a step, of a robot that was in the pose.
        in_pose: whether the robot was near enough to the keyframe when the hold had settled; None before that.
    """

    seconds: float
    fell_at: float | None
    down: bool
    foot_travel: float | None
    stepped: bool
    in_pose: bool | None

    @property
    def words(self) -> str:
        """Return the hold for a person: ``"held for 3.0 s"``."""
        if self.fell_at is not None:
            return f"fell afterwards: {self.fell_at:.2f} s after the last arrival"
        if self.down:
            return "on the floor"
        if self.in_pose is False:
            return f"not in the pose, no fall in {self.seconds:.1f} s"
        feet = f", a foot moved by {self.foot_travel:.2f} m" if self.stepped else ""
        if self.foot_travel is None:
            feet = ", too short to see a step"
        return f"held for {self.seconds:.1f} s{feet}"


@dataclass(frozen=True)
class StepErrors(PoseErrors):
    """Distance of the robot from the sequence at the end of a control step."""

    failed: bool
    """whether this step alone fails the command by TKS@3: off the pose in the arrival window, fallen before it"""


class KeyframeScorer:
    """Scorer of every command of a chase, without resets.

    A command's arrival window is its last three control steps. The robot is compared with the sequence at the same time
    (:meth:`plat.keyframes.KeyframeSequence.sample`), which is the keyframe at the arrival. TKS@3 and its errors follow
    the rules of :func:`plat.evaluation.evaluate`.

    Keyframes are told apart by their numbers: where a chase's sequence is replaced, begin with another scorer.

    Args:
        robot: the robot.
        limits: what counts as reached, as too far, and as fallen.
    """

    def __init__(self, robot: Robot, limits: ReachLimits | None = None):
        self.limits = limits or ReachLimits()
        self.ended = ""
        """When and why a chase that it followed ended early; empty where none did."""
        self._compare = PoseComparison(robot, self.limits)
        self._feet = _Feet(robot)
        self._steps: dict[int, list[tuple[ChaseStep, StepErrors]]] = {}
        self._near_after: dict[int, float] = {}
        # time, whether down, whether in the pose, and where the feet are: nowhere for a robot that is lost
        self._hold: list[tuple[float, bool, bool, NDArray[np.floating] | None]] = []
        self._lost: Sequence[Keyframe] = ()

    def add(self, step: ChaseStep) -> StepErrors:
        """Add a step; return the robot's distance from the sequence at its end."""
        errors = self._compare(step.after, step.reference, step.command.keyframe.commands, step.root, step.ends)
        failed = errors.off_pose if step.in_window else errors.fallen
        scored = StepErrors(**{field.name: getattr(errors, field.name) for field in fields(errors)}, failed=failed)
        self._watch_late(step)
        if step.holding:
            self._hold.append((step.time, errors.down, self._near(errors), self._feet(step.after.qpos)))
        else:
            self._steps.setdefault(step.command.index, []).append((step, scored))
        return scored

    def follow(self, chase: Chase) -> Iterator[tuple[ChaseStep, StepErrors]]:
        """Take the steps of a chase and add them; yield each with the robot's distance from the sequence at its end.

        Where the simulation diverges, or the policy gives no finite target, the robot is lost (:meth:`lose`) and the
        steps end.
        """
        try:
            for step in chase:
                yield step, self.add(step)
        except (ActionError, StateError) as error:
            self.lose(chase.sequence, chase.time)
            self.ended = f"at {chase.time:.2f} s: {error}; it fell from there on"

    def lose(self, sequence: KeyframeSequence, time: float) -> None:
        """Count the robot as fallen from a time on (s), at which its simulation diverged or no target was left.

        Keyframes of the sequence that have not arrived *fell*, without figures. In the hold it fell afterwards.
        """
        self._lost = sequence.keyframes
        if len(self._arrived()) == len(sequence):
            self._hold.append((time, True, False, None))

    def scores(self) -> list[KeyframeScore]:
        """Return the scores of the keyframes that have arrived, and of those that never will (:meth:`lose`)."""
        arrived = self._arrived()
        lost = [_lost(index, frame) for index, frame in enumerate(self._lost) if index not in arrived]
        return [self._score(steps) for _, steps in sorted(arrived.items())] + lost

    def _arrived(self) -> dict[int, list[tuple[ChaseStep, StepErrors]]]:
        return {index: steps for index, steps in self._steps.items() if steps[-1][0].command.steps_left == 1}

    def hold(self) -> HoldScore | None:
        """Return the score of the hold so far; None before it, and of a chase whose last arrival was not added."""
        if not self._hold or not self._steps:
            return None
        arrival = self._steps[max(self._steps)][-1]
        held = [(time - arrival[0].time, down, near, feet) for time, down, near, feet in self._hold]
        lay = [] if arrival[1].down else [time for time, down, _, _ in held if down]
        # times are multiples of the control step up to rounding
        settled = [
            (near, feet) for time, _, near, feet in held if feet is not None and time > self.limits.settling - 1e-6
        ]
        seconds, down = held[-1][:2]
        fell_at = lay[0] if lay else None
        if len(settled) < 2:  # one position has not moved yet
            return HoldScore(seconds, fell_at, down, None, False, None)
        (in_pose, place), places = settled[0], np.array([feet for _, feet in settled])
        travel = float(np.linalg.norm(places - place, axis=-1).max())
        # a robot on its way to the keyframe has to step
        return HoldScore(seconds, fell_at, down, travel, in_pose and travel > self.limits.foot_travel, in_pose)

    def _watch_late(self, step: ChaseStep) -> None:
        """Find out when a keyframe that was missed is come near to after its arrival."""
        index = step.command.index if step.holding else step.command.index - 1
        steps = self._steps.get(index)
        if index in self._near_after or not steps or self._near(steps[-1][1]):
            return
        missed = steps[-1][0]
        keyframe = missed.command.keyframe
        root = missed.root and with_commanded_root(missed.root, keyframe)
        if self._near(self._compare(step.after, keyframe, keyframe.commands, root)):
            self._near_after[index] = round(step.time - missed.time, 6)

    def _near(self, errors: PoseErrors) -> bool:
        return not errors.down and errors.near

    def _score(self, steps: list[tuple[ChaseStep, StepErrors]]) -> KeyframeScore:
        last, arrival = steps[-1]
        window = [errors for step, errors in steps if step.in_window]
        fell = any(errors.down for _, errors in steps)
        reached = not fell and self._near(arrival) and not any(errors.off_pose for errors in window)
        late = None if fell else self._near_after.get(last.command.index)
        hold = self.hold() if last.command.index == max(self._steps) else None
        return KeyframeScore(
            last.command.index,
            last.command.keyframe.name,
            last.command.keyframe.time,
            outcome=FELL if fell else REACHED if reached else LATE_OR_OFF,
            faults=() if fell or reached else self._faults(arrival, window, late, not last.command.keyframe.whole),
            late=late,
            fell_afterwards=hold is not None and hold.fell_at is not None,
            arrival=PoseErrors(**{field.name: getattr(arrival, field.name) for field in fields(PoseErrors)}),
            success=not any(errors.failed for _, errors in steps),
            root_off=any(errors.fallen for _, errors in steps),
            joint_error=_mean([errors.joint for errors in window]),
            keypoint_error=_mean([errors.keypoint for errors in window]),
        )

    def _faults(
        self, arrival: PoseErrors, window: Sequence[PoseErrors], late: float | None, partial: bool
    ) -> tuple[str, ...]:
        limits = self.limits
        edge = min(limits.window.anchor_height, limits.window.end_effector_height)
        height, turn = (max(getattr(errors, name) for errors in window) for name in ("height", "turn"))
        turned = partial and arrival.turn > limits.turn
        far_turned = limits.turn if turned else math.sqrt(limits.window.anchor_rot_squared)
        faults = [
            (late is not None, f"{late or 0:.2f} s late"),
            (arrival.root > limits.root, f"{beyond(arrival.root, limits.root)} m off"),
            (arrival.joint > limits.joints, f"joints {beyond(arrival.joint, limits.joints)} rad off"),
            (
                partial and arrival.bodies > limits.bodies,
                f"a commanded body {beyond(arrival.bodies, limits.bodies)} m off",
            ),
            (height > edge, f"a hand, a foot or the torso {beyond(height, edge)} m too high or low"),
            (turn > far_turned, f"turned by {beyond(turn, far_turned)} rad"),
        ]
        # what no part of the keyframe says is left: the root fell by TKS, of a partial one that does not command it
        return tuple(words for present, words in faults if present) or ("the root too low or tilted",)


def _lost(index: int, keyframe: Keyframe) -> KeyframeScore:
    """Return the score of a keyframe that never arrived."""
    nan = math.nan
    nowhere = PoseErrors(nan, nan, nan, nan, nan, nan, near=False, off_pose=True, fallen=True, down=True)
    return KeyframeScore(
        index,
        keyframe.name,
        keyframe.time,
        outcome=FELL,
        faults=(),
        late=None,
        fell_afterwards=False,
        arrival=nowhere,
        success=False,
        root_off=True,
        joint_error=nan,
        keypoint_error=nan,
    )


def _mean(values: Sequence[float]) -> float:
    mean = float(np.mean(values))
    # always the same NaN, so that equal scores compare as equal
    return math.nan if math.isnan(mean) else mean


def mean_errors(scores: Sequence[KeyframeScore]) -> tuple[float, float]:
    """Return the means of MPJPE@3 (rad) and MPKPE@3 (m) over the keyframes that command joints, and places of bodies.

    NaN where none does.
    """
    columns = ([score.joint_error for score in scores], [score.keypoint_error for score in scores])
    known = [[value for value in column if not math.isnan(value)] for column in columns]
    joint, keypoint = (float(np.mean(column)) if column else math.nan for column in known)
    return joint, keypoint


def error_text(value: float, unit: str = "") -> str:
    """Return an error for a table, with three digits; a dash where nothing was commanded.

    >>> error_text(0.0321, " rad"), error_text(math.nan)
    ('0.032 rad', '-')
    """
    return "-" if math.isnan(value) else f"{value:.3f}{unit}"


def distance_text(value: float, unit: str = "") -> str:
    """Return a position error (m) for a table, in whole millimeters; a dash where nothing was commanded.

    >>> distance_text(0.0321, " mm"), distance_text(math.nan)
    ('32 mm', '-')
    """
    return "-" if math.isnan(value) else f"{1000 * value:.0f}{unit}"


def tally(scores: Sequence[KeyframeScore]) -> str:
    """Return how many keyframes had each outcome: ``"3 of 5 reached, 2 late or off; fell afterwards"``."""
    counts = {outcome: sum(score.outcome == outcome for score in scores) for outcome in (LATE_OR_OFF, FELL)}
    told = [f"{sum(score.reached for score in scores)} of {len(scores)} {REACHED}"]
    told += [f"{count} {outcome}" for outcome, count in counts.items() if count]
    afterwards = "; fell afterwards" if any(score.fell_afterwards for score in scores) else ""
    return ", ".join(told) + afterwards


class _Feet:
    """Places of a robot's feet ``[feet, 3]`` (m, world) in a pose."""

    def __init__(self, robot: Robot):
        self._model = robot.model()
        self._data = mujoco.MjData(self._model)
        self._bodies = [self._model.body(name).id for name in robot.feet]

    def __call__(self, qpos: NDArray[np.floating]) -> NDArray[np.floating]:
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        return self._data.xpos[self._bodies].copy()
