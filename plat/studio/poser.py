"""Interactive inverse kinematics: one pose, dragged by its hands, feet, elbows, knees, pelvis, chest and head."""

from collections.abc import Mapping
from typing import NamedTuple

import daqp  # noqa: F401  (the solver that mink looks for)
import mink
import mujoco
import numpy as np
import torch

from plat.motions.retargeting.geometry import TRACKED, RobotGeometry
from plat.robots.robot import Robot
from plat.rotations import quat_yaw
from plat.rotations_np import quat_multiply

__all__ = ["BALLS", "HANDLES", "WHOLE", "Frame", "Poser"]

WHOLE = "whole robot"
"""Handle that moves and turns the robot as it is: its place on the floor."""

HANDLES = {
    "head": ("geom", "head_collision"),
    "chest": ("geom", "chest_collision"),
    "pelvis": ("body", TRACKED["pelvis"]),
    **{
        f"{side} {name}": ("body", TRACKED[f"{side}_{role}"])
        for name, role in (("hand", "wrist"), ("elbow", "elbow"), ("knee", "knee"), ("foot", "ankle"))
        for side in ("left", "right")
    },
}
"""Handles of a pose, each with kind and name of its frame in the model."""

BALLS = {
    "head": (0.0, 0.0, 0.16),
    "chest": (0.15, 0.0, 0.0),
    "pelvis": (0.14, 0.0, 0.0),
    "hand": (0.12, 0.0, 0.0),
    "elbow": (-0.075, 0.0, 0.0),
    "knee": (0.085, 0.0, 0.0),
    "foot": (0.17, 0.0, 0.0),
    "robot": (0.32, 0.0, 0.02),
}
"""Where the ball of a handle is, in its frame (m): outside the body, to be seen and clicked on."""

_LIMBS = {
    "hand": ("shoulder", "elbow", "wrist"),
    "elbow": ("shoulder",),
    "knee": ("hip",),
    "foot": ("hip", "knee", "ankle"),
    "chest": ("waist",),
    "head": ("waist",),
}

# Weight of a meter of position and of a radian of orientation. Held handles outweigh the dragged one, and feet
# outweigh the rest: a target out of reach stretches the limb and leaves the stance alone.
_DRAGGED = (3.0, 0.3)
_DRAGGED_POINT = (3.0, 0.0)
_HELD = (15.0, 5.0)
_HELD_FOOT = (30.0, 10.0)
# Weight of a radian from the initial pose: determines joints that no handle constrains, such as an elbow.
_REST_COST = 0.03
# Levenberg-Marquardt: steps get shorter with the error, so that targets out of reach do not make limbs swing.
_DAMPING, _ERROR_DAMPING = 1e-4, 0.1
_ITERATIONS = 30
_SETTLED = 1e-4  # rad and m: no joint moves further in an iteration


class Frame(NamedTuple):
    """Pose of a body."""

    pos: np.ndarray
    """``[3]`` (m, world)"""
    quat: np.ndarray
    """``[4]``, ``wxyz``, body to world"""


class Poser:
    """Interactive inverse kinematics: a pose follows a dragged handle within joint limits, with others held.

    Args:
        robot: has the bodies that retargeting tracks.

    >>> from plat.robots import G1
    >>> poser = Poser(G1)
    >>> pose = G1.default_qpos
    >>> frames = poser.frames(pose)
    >>> hand = frames["left hand"]
    >>> held = {handle: frames[handle] for handle in ("left foot", "right foot")}
    >>> raised = poser.dragged(pose, "left hand", Frame(hand.pos + [0.1, 0, 0.2], hand.quat), held)
    >>> (poser.frames(raised)["left hand"].pos - hand.pos).round(1)
    array([0.1, 0. , 0.2])
    """

    def __init__(self, robot: Robot):
        self._model = robot.shared_model
        self._data = mujoco.MjData(self._model)
        self._joint_names = robot.joint_names
        self._limit = mink.ConfigurationLimit(self._model, gain=1.0)
        self._ankle_height = RobotGeometry.of(robot, "the studio").ankle_height
        self._range = robot.joint_range.double().numpy()

    def frames(self, qpos: np.ndarray) -> dict[str, Frame]:
        """Return the body pose of each handle in a robot pose ``[7 + J]``."""
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        return {**{handle: self._frame(*frame) for handle, frame in HANDLES.items()}, WHOLE: _spot(qpos)}

    def _frame(self, kind: str, name: str) -> Frame:
        if kind == "body":
            body = self._data.body(name)
            return Frame(body.xpos.copy(), body.xquat.copy())
        geom, quat = self._data.geom(name), np.empty(4)
        mujoco.mju_mat2Quat(quat, geom.xmat)
        return Frame(geom.xpos.copy(), quat)

    def joint_frame(self, qpos: np.ndarray, joint: int) -> Frame:
        """Return the place of a joint in a pose ``[7 + J]``, and an orientation whose z axis is the joint's."""
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        axis, quat = self._data.xaxis[joint + 1], np.empty(4)
        mujoco.mju_quatZ2Vec(quat, axis)
        return Frame(self._data.xanchor[joint + 1].copy(), quat)

    def limb(self, handle: str) -> list[int]:
        """Return the joints between the trunk and a handle; none for the pelvis."""
        side, _, part = handle.rpartition(" ")
        starts = tuple(f"{side}_{name}".lstrip("_") for name in _LIMBS.get(part, ()))
        return [joint for joint, name in enumerate(self._joint_names) if starts and name.startswith(starts)]

    def dragged(
        self,
        qpos: np.ndarray,
        handle: str,
        target: Frame,
        held: Mapping[str, Frame],
        rest: np.ndarray | None = None,
        limb_only: bool = False,
    ) -> np.ndarray:
        """Return the pose with a handle at a target, or as near to it as joint limits and held handles allow.

        Args:
            qpos: pose to search from ``[7 + J]``.
            handle: one of :data:`HANDLES`, or :data:`WHOLE`, which moves no joint.
            target: desired pose of the handle.
            held: handles to hold, with their poses; ``handle`` among them is ignored.
            rest: regularization target of all other joints ``[7 + J]``; by default ``qpos``.
            limb_only: whether only the joints of :meth:`limb` move; of the pelvis, only the root.
        """
        if handle == WHOLE:
            return _carried(qpos if rest is None else rest, target)
        tasks = [self._task(handle, target, _DRAGGED_POINT if handle.endswith(("elbow", "knee")) else _DRAGGED)]
        if limb_only:
            limb = self.limb(handle)
            free = [6 + joint for joint in limb] or list(range(6))
            return self._solve(qpos, tasks, qpos if rest is None else rest, free)
        for other, frame in held.items():
            if other != handle:
                tasks.append(self._task(other, frame, _HELD_FOOT if other.endswith("foot") else _HELD))
        return self._solve(qpos, tasks, qpos if rest is None else rest)

    def flat(self, qpos: np.ndarray) -> np.ndarray:
        """Return the pose ``[7 + J]`` with both feet flat on the floor below their positions.

        The pelvis stays where it is unless the feet cannot reach the floor from there.
        """
        frames = self.frames(qpos)
        tasks = [self._task("pelvis", frames["pelvis"], _HELD)]
        for foot in ("left foot", "right foot"):
            pos, quat = frames[foot]
            level = quat_yaw(torch.from_numpy(quat)).numpy()
            tasks.append(self._task(foot, Frame(np.array([*pos[:2], self._ankle_height]), level), _HELD_FOOT))
        return self._solve(qpos, tasks, qpos)

    def _task(self, handle: str, frame: Frame, cost: tuple[float, float]) -> mink.FrameTask:
        kind, name = HANDLES[handle]
        task = mink.FrameTask(name, kind, *cost, lm_damping=_ERROR_DAMPING)
        task.set_target(mink.SE3(np.concatenate((frame.quat, frame.pos))))
        return task

    def _solve(
        self, qpos: np.ndarray, tasks: list[mink.FrameTask], rest: np.ndarray, free: list[int] | None = None
    ) -> np.ndarray:
        """Return the solution; ``free`` are the degrees of freedom that may move, by default all."""
        start = np.array(qpos, dtype=np.float64)
        # outside the limits the quadratic program has no solution
        start[7:] = np.clip(start[7:], *self._range.T)
        configuration = mink.Configuration(self._model, start)
        posture = mink.PostureTask(self._model, _REST_COST)
        posture.set_target(rest)
        frozen = [] if free is None else [dof for dof in range(self._model.nv) if dof not in free]
        fixed = [mink.DofFreezingTask(self._model, frozen)] if frozen else None
        for _ in range(_ITERATIONS):
            step = mink.solve_ik(
                configuration,
                [*tasks, posture],
                1.0,
                "daqp",
                damping=_DAMPING,
                limits=[self._limit],
                constraints=fixed,
            )
            configuration.integrate_inplace(step, 1.0)
            if np.abs(step).max() < _SETTLED:
                break
        result = configuration.q.copy()
        result[7:] = np.clip(result[7:], *self._range.T)
        return result


def _spot(qpos: np.ndarray) -> Frame:
    """Return the point on the floor below the root, with the root's heading."""
    return Frame(np.array([*qpos[:2], 0.0]), quat_yaw(torch.from_numpy(np.array(qpos[3:7], dtype=np.float64))).numpy())


def _carried(qpos: np.ndarray, target: Frame) -> np.ndarray:
    """Return a pose ``[7 + J]`` as it is, at another place and heading."""
    here, there = _spot(qpos), _spot(np.concatenate((target.pos, target.quat)))
    turn = quat_multiply(there.quat, here.quat * [1.0, -1.0, -1.0, -1.0])
    moved = np.array(qpos, dtype=np.float64)
    moved[:3] += target.pos - here.pos
    moved[3:7] = quat_multiply(turn, moved[3:7])
    return moved
