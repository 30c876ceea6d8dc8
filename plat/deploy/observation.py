"""Observation of a policy: robot state, next keyframe and time to it, as one vector."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plat.bounds import Count, check_value, is_finite, shown
from plat.deploy.description import RobotDescription, check_description
from plat.deploy.goals import GOAL_ENTRIES, GoalArrays
from plat.deploy.kinematics import KeypointKinematics
from plat.deploy.state import Array, Pose, RobotState, state_widths
from plat.errors import StateError
from plat.json_file import short
from plat.rotations_np import UNIT_TOLERANCE, quat_to_matrix
from plat.spec.observation import STUDENT_GROUPS, as_observed, observed, optional_groups, student_keys, table
from plat.spec.parts import WHOLE_ONLY, Parts
from plat.spec.timing import SOON, Timing
from plat.words import counted

__all__ = ["ObservationBuilder", "ObservationTerm", "observation_terms"]


# numbers beyond this become infinite in float32, or in the squares that networks take
_LARGEST = 1e15


@dataclass(frozen=True)
class ObservationTerm:
    """Slice of an observation: features of one quantity, with their unit and frame.

    Args:
        name: of the term.
        start: its first feature.
        stop: one past its last feature.
        unit: of its values.
        frame: that its values are in, or what they are relative to.
    """

    name: str
    start: int
    stop: int
    unit: str
    frame: str


def observation_terms(num_joints: int, num_keypoints: int, also: Sequence[str] = ()) -> tuple[ObservationTerm, ...]:
    """Return the terms of a policy's observation in order: the robot's state, the goal, the normalized horizon.

    Args:
        num_joints: J.
        num_keypoints: K.
        also: groups that follow, some of :data:`plat.spec.observation.OPTIONAL_GROUPS`.

    Raises:
        ObservationError: for another group.

    >>> terms = observation_terms(num_joints=29, num_keypoints=14)
    >>> terms[0]
    ObservationTerm(name='robot.joint_pos', start=0, stop=29, unit='rad', frame='relative to the default pose')
    >>> terms[-1].name, terms[-1].stop
    ('command.horizon', 177)
    """
    terms, start = [], 0
    for group in (*STUDENT_GROUPS, *optional_groups(student_keys(also))):
        for entry in table().entries(group):
            stop = start + entry.width(num_joints, num_keypoints)
            terms.append(ObservationTerm(f"{group}.{entry.name}", start, stop, entry.unit, entry.frame))
            start = stop
    return tuple(terms)


class ObservationBuilder:
    """Observation builder for a policy that chases timed keyframes.

    Keypoints of a keyframe are computed once, and again only when its values change.

    Args:
        robot: the robot.
        max_steps: ``Delta_max``, the longest command in control steps.
        also: groups that the policy observes beside robot, goal and command.
        window: control steps of the arrival window.

    Raises:
        RobotError: for what is no description of a robot.
        ConfigError: for what is no number of steps.
        ObservationError: for a group that is not optional.

    >>> from types import SimpleNamespace
    >>> from plat.robots import G1
    >>> from plat.robots import describe_robot
    >>> robot = describe_robot(G1, control_dt=0.02)
    >>> state = RobotState(
    ...     joint_pos=robot.default_joint_pos, joint_vel=np.zeros(29), root_pos_w=np.array([0, 0, 0.76]),
    ...     root_quat_w=np.array([1.0, 0, 0, 0]), root_lin_vel_b=np.zeros(3), root_ang_vel_b=np.zeros(3))
    >>> keyframe = SimpleNamespace(
    ...     root_pos=np.array([0.5, 0, 0.76]), root_quat=state.root_quat_w, joint_pos=state.joint_pos)
    >>> observation = ObservationBuilder(robot, max_steps=50)(state, keyframe, 25, np.zeros(29))
    >>> observation.shape, float(observation[-1])
    ((177,), 0.5)
    """

    def __init__(
        self,
        robot: RobotDescription,
        max_steps: int,
        also: Sequence[str] = (),
        window: int = Timing.window,
    ):
        check_description(robot)
        check_value("max_steps", max_steps, Count)
        joints, keypoints = len(robot.joint_names), len(robot.keypoints)
        self._kinematics = KeypointKinematics(robot)
        self._default_joint_pos = robot.default_joint_pos
        self._max_steps = max_steps
        self._window = window
        self._soon = robot.control_dt / SOON
        self._joints = joints
        self._whole = np.ones(joints + keypoints + 3)
        self.also = optional_groups(student_keys(also))
        """Groups that are observed beside robot, goal and command."""
        self._state_widths = state_widths(joints)
        self._pose_widths = {"root_pos": 3, "root_quat": 4, "joint_pos": joints}
        self._target = np.full(3 + 4 + joints, np.nan)
        self._target_keypoints_w = np.empty((keypoints, 3))
        self._target_to_world = np.empty((3, 3))
        self.terms = observation_terms(joints, keypoints, self.also)
        """What lies where in an observation."""
        self.size = self.terms[-1].stop
        """Number of features F."""
        self._values = np.empty(self.size)
        self._slices = [self._values[term.start : term.stop] for term in self.terms]

    def __call__(self, state: RobotState, keyframe: Pose, steps_left: float, last_action: Array) -> NDArray[np.float32]:
        """Return the observation ``[F]``.

        Args:
            state: of the robot.
            keyframe: pose commanded for the step at which none is left.
            steps_left: control steps until then.
            last_action: action of the previous step ``[J]``; zeros at the first one.

        Raises:
            StateError: naming the field of state or keyframe that has another size, is not finite, or is no unit
                quaternion; for a partial keyframe, when the policy does not see what is commanded.
        """
        state = RobotState(**_arrays("robot state", state, self._state_widths))
        self._set_target(_arrays("keyframe", keyframe, self._pose_widths))
        if not is_finite(steps_left):
            raise StateError(f"steps_left is {shown(steps_left)}, expected a finite number")
        last_action = _array("last_action", last_action, self._joints)
        root_to_world = _unit_rotation("robot state: root_quat_w", state.root_quat_w)
        # a row vector times the matrix is the inverse rotation: from the world into the root frame
        keypoint_pos_b = (self._target_keypoints_w - state.root_pos_w) @ root_to_world
        parts = self._mask(keyframe)
        to_target = self._target[:3] - np.asarray(state.root_pos_w, dtype=np.float64)
        view = GoalArrays(
            state, self._target[7:], self._target_to_world, root_to_world, keypoint_pos_b, to_target, parts
        )
        robot = {
            "joint_pos": state.joint_pos - self._default_joint_pos,
            "joint_vel": state.joint_vel,
            "root_ang_vel_b": state.root_ang_vel_b,
            "root_lin_vel_b": state.root_lin_vel_b,
            "gravity_b": -root_to_world[2],
            "last_action": last_action,
        }
        steps_left = float(steps_left)  # a number may come as an array without axes
        command = {"horizon": steps_left / self._max_steps}
        groups: list[dict[str, Any]] = [
            as_observed("robot", robot),
            observed("goal", GOAL_ENTRIES, view),
            as_observed("command", command),
        ]
        if "parts" in self.also:
            flags = self._whole if parts is None else parts
            joints, bodies, root = np.split(flags, (self._joints, len(flags) - 3))
            groups.append(as_observed("parts", {"joints": joints, "bodies": bodies, "root": root}))
        if "clock" in self.also:
            clock = {"soon": min(steps_left * self._soon, 1.0), "in_window": float(steps_left <= self._window)}
            groups.append(as_observed("clock", clock))
        values = (value for group in groups for value in group.values())
        for part, value in zip(self._slices, values, strict=True):
            part[:] = value
        largest = np.abs(self._values).max()
        if not largest <= _LARGEST:  # not >, which NaN would pass
            _check_finite("robot state: ", {name: getattr(state, name) for name in self._state_widths})
            _check_finite("", {"last_action": last_action})
            raise StateError(f"observation: holds {largest:.3g}, expected numbers that a robot measures")
        return self._values.astype(np.float32)

    def _mask(self, keyframe: Pose) -> NDArray[np.float64] | None:
        """Return the mask of a partial keyframe; None for a whole one."""
        commands = getattr(keyframe, "commands", None)
        if commands is None:
            return None
        if not isinstance(commands, Parts):
            raise StateError(f"keyframe: commands is {short(commands)}, expected plat.spec.parts.Parts or None")
        mask = commands.mask()
        if len(mask) != len(self._whole):
            raise StateError(f"keyframe: commands has {counted(len(mask), 'flag')}, expected {len(self._whole)}")
        if mask.all():
            return None
        if "parts" not in self.also:
            raise StateError(f"keyframe: commands a part of the pose, but {WHOLE_ONLY}")
        return mask

    def _set_target(self, pose: dict[str, NDArray[Any]]) -> None:
        target = np.concatenate(list(pose.values()))
        if np.array_equal(target, self._target):
            return
        _check_finite("keyframe: ", pose)
        self._target_to_world = _unit_rotation("keyframe: root_quat", pose["root_quat"])
        self._target_keypoints_w = self._kinematics(target[:3], target[3:7], target[7:])
        self._target = target


def _arrays(what: str, source: RobotState | Pose, widths: dict[str, int]) -> dict[str, NDArray[Any]]:
    return {name: _array(f"{what}: {name}", getattr(source, name, None), width) for name, width in widths.items()}


def _array(what: str, value: Any, width: int) -> NDArray[Any]:
    try:
        values = np.asarray(value)
    except (RuntimeError, TypeError, ValueError):  # rows of several lengths, a tensor elsewhere
        values = np.asarray(None)
    if values.shape != (width,):
        raise StateError(f"{what} has shape {values.shape}, expected ({width},)")
    if values.dtype.kind not in "fiub":
        raise StateError(f"{what} holds {shown(values.tolist()[0])}, expected numbers")
    return values


def _check_finite(what: str, fields: dict[str, NDArray[Any]]) -> None:
    for name, values in fields.items():
        wrong = np.flatnonzero(~np.isfinite(values))
        if len(wrong):
            raise StateError(f"{what}{name}[{wrong[0]}] is {values[wrong[0]]}, expected a finite number")


def _unit_rotation(what: str, quat: Array) -> NDArray[np.float64]:
    length = math.hypot(*quat)
    if abs(length - 1.0) > UNIT_TOLERANCE:
        raise StateError(f"{what} has length {length:.6g}, expected a unit quaternion wxyz")
    return quat_to_matrix(quat)
