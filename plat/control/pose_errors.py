"""Errors of one robot against a pose. The twin of :class:`plat.envs.transforms.KeyframeMetrics`, which is batched."""

from dataclasses import dataclass

import mujoco
import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict

from plat.control.reach import down
from plat.control.settings import ReachLimits
from plat.deploy import RobotState
from plat.envs.transforms.terminations import fallen, off_pose
from plat.keyframes import Keyframe
from plat.robots.robot import Robot
from plat.rotations import quat_angle

__all__ = ["PoseComparison", "PoseErrors"]


@dataclass(frozen=True)
class PoseErrors:
    """Distance of a robot from a pose."""

    joint: float
    """mean absolute error of the joint angles (rad): MPJPE"""
    keypoint: float
    """mean Euclidean error of the keypoints in the world (m): MPKPE"""
    root: float
    """distance of the root (m)"""
    height: float
    """largest error of the height of anchor, ankles and wrists (m)"""
    turn: float
    """angle between the anchor's orientations (rad)"""
    off_pose: bool
    """whether anchor, ankles or wrists are too far off to count as arrived"""
    fallen: bool
    """whether the root is at the wrong height or tilt, by the limits of TKS@3"""
    down: bool
    """whether the robot lies: see :func:`plat.control.reach.down`"""


class PoseComparison:
    """Pose errors of a robot, by the definitions of :func:`plat.evaluation.evaluate`.

    Args:
        robot: the robot.
        limits: what counts as too far, and as fallen.

    >>> from plat.robots import G1
    >>> from plat.keyframes import standing
    >>> from plat.control import Simulator
    >>> simulator, pose = Simulator(G1.model()), standing(G1)
    >>> simulator.reset(pose)
    >>> errors = PoseComparison(G1)(simulator.state(), pose)
    >>> errors.joint, errors.keypoint, errors.root, errors.off_pose, errors.fallen, errors.down
    (0.0, 0.0, 0.0, False, False, False)
    """

    def __init__(self, robot: Robot, limits: ReachLimits | None = None):
        self._robot = robot
        self._limits = limits or ReachLimits()
        self._model = robot.model()
        self._data = mujoco.MjData(self._model)
        self._keypoints = [self._model.body(name).id for name in robot.keypoints]
        self._watched = [robot.anchor_index, *robot.end_effector_indices]

    def __call__(self, state: RobotState, pose: Keyframe) -> PoseErrors:
        """Errors of a state against a pose."""
        actual = self._keypoints_of(state.qpos)
        wanted = self._keypoints_of(pose.qpos)
        apart = actual["keypoint_pos_w"] - wanted["keypoint_pos_w"]
        anchors = (poses["keypoint_quat_w"][:, self._robot.anchor_index] for poses in (actual, wanted))
        return PoseErrors(
            joint=float(np.abs(state.joint_pos - pose.joint_pos).mean()),
            keypoint=float(torch.linalg.vector_norm(apart, dim=-1).mean()),
            root=float(apart[0, 0].norm()),
            height=float(apart[0, self._watched, 2].abs().max()),
            turn=float(quat_angle(*anchors)),
            off_pose=bool(off_pose(actual, wanted, self._robot, self._limits.window)),
            fallen=bool(fallen(actual, wanted, self._limits.window)),
            down=bool(down(actual, wanted, self._limits)),
        )

    def _keypoints_of(self, qpos: NDArray[np.floating]) -> TensorDict:
        """Poses of the keypoints ``[1, K, ...]`` in the world."""
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        poses = {"keypoint_pos_w": self._data.xpos, "keypoint_quat_w": self._data.xquat}
        return TensorDict({key: torch.from_numpy(rows[self._keypoints])[None] for key, rows in poses.items()}, [1])
