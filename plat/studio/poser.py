"""Interactive inverse kinematics: one pose, dragged by its hands, feet and pelvis."""

from collections.abc import Mapping
from typing import NamedTuple

import mink
import mujoco
import numpy as np
import torch

from plat.motions.retargeting.geometry import TRACKED, RobotGeometry
from plat.robots.robot import Robot
from plat.rotations import quat_yaw

__all__ = ["HANDLES", "Frame", "Poser"]

HANDLES = {
    "pelvis": "pelvis",
    "left hand": "left_wrist",
    "right hand": "right_wrist",
    "left foot": "left_ankle",
    "right foot": "right_ankle",
}
"""Handles of a pose, each with its role among the bodies that retargeting tracks."""

# Weight of a meter of position and of a radian of orientation. Held handles outweigh the dragged one, and feet
# outweigh the rest: a target out of reach stretches the limb and leaves the stance alone.
_DRAGGED = (3.0, 0.3)
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
        self._bodies = {handle: TRACKED[role] for handle, role in HANDLES.items()}
        self._limit = mink.ConfigurationLimit(self._model, gain=1.0)
        self._ankle_height = RobotGeometry.of(robot).ankle_height
        self._range = robot.joint_range.double().numpy()

    def frames(self, qpos: np.ndarray) -> dict[str, Frame]:
        """Return the body pose of each handle in a robot pose ``[7 + J]``."""
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        bodies = {handle: self._data.body(body) for handle, body in self._bodies.items()}
        return {handle: Frame(body.xpos.copy(), body.xquat.copy()) for handle, body in bodies.items()}

    def dragged(
        self,
        qpos: np.ndarray,
        handle: str,
        target: Frame,
        held: Mapping[str, Frame],
        rest: np.ndarray | None = None,
    ) -> np.ndarray:
        """Return the pose with a handle at a target, or as near to it as joint limits and held handles allow.

        Args:
            qpos: pose to search from ``[7 + J]``.
            handle: one of :data:`HANDLES`.
            target: desired pose of the handle.
            held: handles to hold, with their poses; ``handle`` among them is ignored.
            rest: regularization target of all other joints ``[7 + J]``; by default ``qpos``.
        """
        tasks = [self._task(handle, target, _DRAGGED)]
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
        task = mink.FrameTask(self._bodies[handle], "body", *cost, lm_damping=_ERROR_DAMPING)
        task.set_target(mink.SE3(np.concatenate((frame.quat, frame.pos))))
        return task

    def _solve(self, qpos: np.ndarray, tasks: list[mink.FrameTask], rest: np.ndarray) -> np.ndarray:
        start = np.array(qpos, dtype=np.float64)
        # outside the limits the quadratic program has no solution
        start[7:] = np.clip(start[7:], *self._range.T)
        configuration = mink.Configuration(self._model, start)
        posture = mink.PostureTask(self._model, _REST_COST)
        posture.set_target(rest)
        for _ in range(_ITERATIONS):
            step = mink.solve_ik(configuration, [*tasks, posture], 1.0, "daqp", damping=_DAMPING, limits=[self._limit])
            configuration.integrate_inplace(step, 1.0)
            if np.abs(step).max() < _SETTLED:
                break
        result = configuration.q.copy()
        result[7:] = np.clip(result[7:], *self._range.T)
        return result
