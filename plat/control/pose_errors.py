"""Errors of one robot against a pose. The twin of :class:`plat.envs.transforms.KeyframeMetrics`, which is batched."""

from dataclasses import dataclass

import mujoco
import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict

from plat.deploy import RobotState
from plat.envs.transforms.terminations import TerminationLimits, fallen, off_pose
from plat.keyframes import Keyframe
from plat.robots.robot import Robot

__all__ = ["PoseComparison", "PoseErrors"]


@dataclass(frozen=True)
class PoseErrors:
    """Distance of a robot from a pose."""

    joint: float
    """mean absolute error of the joint angles (rad): MPJPE"""
    keypoint: float
    """mean Euclidean error of the keypoints in the world (m): MPKPE"""
    off_pose: bool
    """whether anchor, ankles or wrists are too far off to count as arrived"""
    fallen: bool
    """whether the root is at the wrong height or tilt"""


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
    >>> PoseComparison(G1)(simulator.state(), pose)
    PoseErrors(joint=0.0, keypoint=0.0, off_pose=False, fallen=False)
    """

    def __init__(self, robot: Robot, limits: TerminationLimits | None = None):
        self._robot = robot
        self._limits = limits or TerminationLimits()
        self._model = robot.model()
        self._data = mujoco.MjData(self._model)
        self._keypoints = [self._model.body(name).id for name in robot.keypoints]

    def __call__(self, state: RobotState, pose: Keyframe) -> PoseErrors:
        """Errors of a state against a pose."""
        actual = self._keypoints_of(state.qpos)
        wanted = self._keypoints_of(pose.qpos)
        distance = torch.linalg.vector_norm(actual["keypoint_pos_w"] - wanted["keypoint_pos_w"], dim=-1)
        return PoseErrors(
            joint=float(np.abs(state.joint_pos - pose.joint_pos).mean()),
            keypoint=float(distance.mean()),
            off_pose=bool(off_pose(actual, wanted, self._robot, self._limits)),
            fallen=bool(fallen(actual, wanted, self._limits)),
        )

    def _keypoints_of(self, qpos: NDArray[np.floating]) -> TensorDict:
        """Poses of the keypoints ``[1, K, ...]`` in the world."""
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        poses = {"keypoint_pos_w": self._data.xpos, "keypoint_quat_w": self._data.xquat}
        return TensorDict({key: torch.from_numpy(rows[self._keypoints])[None] for key, rows in poses.items()}, [1])
