"""Partial keyframes in a line: hands, bodies, joints or the root alone, from a pose that reaches them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from plat.bounds import check_robot, is_finite
from plat.deploy.description import RobotDescription
from plat.deploy.kinematics import KeypointKinematics
from plat.errors import KeyframeError
from plat.json_file import short
from plat.keyframes.keyframe import HIGHEST, Keyframe, check_keyframe, standing
from plat.spec.parts import Parts, joint_called

if TYPE_CHECKING:
    from plat.robots.robot import Robot

__all__ = ["hands_of", "only"]

# Steps of the inverse kinematics, its damping (m), and how far an angle may change in a step (rad).
_STEPS, _DAMPING, _LARGEST = 60, 0.03, 0.3
_STUCK = 1e-4  # rad in a step
_NUDGE = 1e-4
# How far a body may be from its place in the end (m). Further than the second, other poses are begun from, at most so
# many: the middle of the joints' ranges, then random ones.
_OFF, _NEAR, _OTHERS = 0.05, 0.005, 8


def only(
    robot: Robot | RobotDescription,
    time: float,
    *,
    left_hand: Sequence[float] | None = None,
    right_hand: Sequence[float] | None = None,
    bodies: Mapping[str, Sequence[float]] | None = None,
    joints: Mapping[str, float] | None = None,
    root: Sequence[float] | None = None,
    height: float | None = None,
    heading: float | None = None,
    base: Keyframe | None = None,
    name: str | None = None,
) -> Keyframe:
    """Return a keyframe that commands what is given, and nothing else.

    The rest of its pose is that of ``base``, with the limbs bent so that the bodies come to their places; the root
    stays. A body is commanded to be where it is in that pose, so its place has to be within reach of it.

    Args:
        robot: whose keyframe it is; a bundle's description knows ``bodies``, but not which of them are hands.
        time: of the arrival (s).
        left_hand: position of the left hand ``[3]`` (m, world): the last body of the arm.
        right_hand: of the right one.
        bodies: positions of keypoint bodies by name ``[3]`` (m, world).
        joints: angles by name (rad).
        root: horizontal position of the root ``[2]`` (m, world).
        height: of the root (m, world).
        heading: orientation of the root: upright, turned by this angle about the vertical (rad).
        base: pose to begin from, near the bodies' places; None for the default pose at the origin.
        name: label in tables and messages.

    Raises:
        KeyframeError: when nothing is given, a name does not exist or is given twice, a position has not three
            numbers, or a body comes no nearer to it than 5 cm.

    >>> from plat.robots import G1
    >>> keyframe = only(G1, 1.0, left_hand=(0.35, 0.2, 0.95), right_hand=(0.35, -0.2, 0.95))
    >>> keyframe.commands.names(G1)["bodies"]
    ['left_wrist_yaw_link', 'right_wrist_yaw_link']
    """
    for field, given in (("bodies", bodies), ("joints", joints)):
        if not isinstance(given, Mapping | None):
            raise KeyframeError(f"{field} is {short(given)}, expected values by name")
    wanted = dict(bodies or {})
    if left_hand is not None or right_hand is not None:
        for side, place, body in zip(("left", "right"), (left_hand, right_hand), hands_of(robot), strict=True):
            if place is None:
                continue
            if not body:
                raise KeyframeError(
                    f"{side}_hand: nothing says which body of {robot.name!r} it is, expected its name in bodies"
                )
            if body in wanted:
                raise KeyframeError(f"{side}_hand: {body!r} is among bodies as well, expected one place for it")
            wanted[body] = place
    angles = {joint_called(name, robot.joint_names): angle for name, angle in (joints or {}).items()}
    if len(angles) < len(joints or {}):
        raise KeyframeError(f"joints: {short(list(joints or {}))} name one joint twice, expected each once")
    root_parts = [
        part
        for part, value in (("horizontal", root), ("height", height), ("orientation", heading))
        if value is not None
    ]
    commands = Parts.only(robot, angles, wanted, root_parts)
    if base is not None:
        check_keyframe("base", base)
    pose = (base or standing(robot)).checked(robot)
    qpos = pose.qpos
    if root is not None:
        qpos[:2] = _numbers("root", root, 2)
    if height is not None:
        qpos[2] = _number("height", height, HIGHEST, "m")
    if heading is not None:
        turn = _number("heading", heading, 2 * np.pi, "rad")
        qpos[3:7] = (np.cos(turn / 2), 0.0, 0.0, np.sin(turn / 2))
    for joint, angle in angles.items():
        qpos[7 + robot.joint_names.index(joint)] = _number(f"joints: {joint!r}", angle)
    places = {body: _numbers(f"bodies: {body!r}", place, 3) for body, place in wanted.items()}
    if places:
        qpos = _reaching(robot, qpos, places, fixed=angles)
    return replace(Keyframe.from_qpos(time, qpos, name), commands=commands).checked(robot)


def hands_of(robot: Robot | RobotDescription) -> tuple[str, str]:
    """Return the bodies that a robot's left and right hand are (:attr:`plat.robots.Robot.hands`).
    Two empty names for a robot that has not two of them, and for a bundle's description.

    >>> from plat.robots import G1
    >>> hands_of(G1)
    ('left_wrist_yaw_link', 'right_wrist_yaw_link')
    """
    if isinstance(robot, RobotDescription):
        return ("", "")
    check_robot(robot)
    return robot.hands


def _number(field: str, value: float, most: float = np.inf, unit: str = "") -> float:
    if not is_finite(value):
        raise KeyframeError(f"{field} is {short(value)}, expected a finite number")
    if abs(value) > most:
        raise KeyframeError(f"{field} is {value:g} {unit}, expected at most {most:.3g}; is it in another unit?")
    return float(value)


def _numbers(field: str, values: Sequence[float], count: int) -> NDArray[np.float64]:
    try:
        numbers = np.array(values, dtype=np.float64)
    except (OverflowError, TypeError, ValueError):
        numbers = np.empty(0)
    if numbers.shape != (count,) or not np.isfinite(numbers).all():
        raise KeyframeError(f"{field} is {short(values)}, expected {count} finite numbers (m, world)")
    return numbers


def _reaching(
    robot: Robot | RobotDescription,
    qpos: NDArray[np.float64],
    places: Mapping[str, NDArray[np.float64]],
    fixed: Mapping[str, float],
) -> NDArray[np.float64]:
    """Return a pose in which bodies are at their places, by damped least squares over the joints that move them.

    It begins from ``qpos``, and where that leads to no such pose from others, the same ones each time.
    """
    if isinstance(robot, RobotDescription):
        description = robot
    else:
        from plat.robots.describe import describe_robot  # mujoco: reading keyframes has no use for it

        description = describe_robot(robot, control_dt=0.02)
    kinematics = KeypointKinematics(description)
    rows = [robot.keypoints.index(body) for body in places]
    targets = np.stack(list(places.values()))
    parents = {body.name: body for body in description.bodies}
    free: set[int] = set()
    for body in places:
        link = parents[body]
        while link.parent >= 0:
            if link.joint >= 0 and robot.joint_names[link.joint] not in fixed:
                free.add(link.joint)
            link = description.bodies[link.parent]
    columns = sorted(free)
    low, high = np.asarray(robot.joint_range, dtype=np.float64)[columns].T
    # joints near the root turn the whole trunk: they give way last
    ease = np.array([1.0 if any(word in robot.joint_names[column] for word in _LIMBS) else 0.3 for column in columns])
    qpos = qpos.copy()

    def points(angles: NDArray[np.float64]) -> NDArray[np.float64]:
        qpos[[7 + column for column in columns]] = angles
        return kinematics(qpos[:3], qpos[3:7], qpos[7:])[rows].ravel()

    def settled(angles: NDArray[np.float64]) -> NDArray[np.float64]:
        for _ in range(_STEPS):
            now = points(angles)
            off = targets.ravel() - now
            if np.abs(off).max() < 1e-4:
                break
            jacobian = np.stack([(points(angles + _NUDGE * unit) - now) / _NUDGE for unit in np.eye(len(columns))], -1)
            eased = jacobian * ease
            step = ease * (eased.T @ np.linalg.solve(eased @ eased.T + _DAMPING**2 * np.eye(len(off)), off))
            before, angles = angles, np.clip(angles + step.clip(-_LARGEST, _LARGEST), low, high)
            if np.abs(angles - before).max() < _STUCK:
                break
        return angles

    def distances(angles: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.linalg.norm(points(angles).reshape(-1, 3) - targets, axis=-1)

    best = qpos[[7 + column for column in columns]]
    if columns:
        best, random = settled(best), np.random.default_rng(0)
        for other in range(_OTHERS):  # joints at their limits can be in the way from one pose, and not from another
            if distances(best).max() <= _NEAR:
                break
            share = random.uniform(size=len(columns)) if other else 0.5
            best = min(best, settled(low + share * (high - low)), key=lambda angles: distances(angles).max())
    missed = distances(best)
    worst = int(missed.argmax())
    if missed[worst] > _OFF:
        body, place = list(places.items())[worst]
        raise KeyframeError(
            f"bodies: {body!r} comes no nearer than {missed[worst]:.2f} m to {place.tolist()} from the pose that it is "
            "drawn from: give a base= within reach of it"
        )
    return qpos


_LIMBS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
