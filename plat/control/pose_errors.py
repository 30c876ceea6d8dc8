"""Errors of one robot against a pose. The twin of :class:`plat.envs.transforms.KeyframeMetrics`, which is batched."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict

from plat.bounds import check_robot, check_value
from plat.deploy import RobotState
from plat.envs.reach import LowestRoot, distances, down
from plat.envs.settings import ReachLimits
from plat.envs.transforms.terminations import fallen, off_pose
from plat.envs.transforms.tracking_errors import commanded_joints_and_bodies
from plat.keyframes import Keyframe, standing
from plat.keyframes.roots import with_commanded_root
from plat.robots.robot import Robot
from plat.rotations import quat_angle
from plat.spec.parts import Parts

__all__ = ["PoseComparison", "PoseErrors"]


@dataclass(frozen=True)
class PoseErrors:
    """Distance of a robot from a pose; NaN where a partial keyframe commands nothing of the kind."""

    joint: float
    """mean absolute error of the commanded joint angles (rad): MPJPE"""
    keypoint: float
    """mean Euclidean error of the commanded keypoints in the world (m): MPKPE"""
    root: float
    """distance of the root in what is commanded of its position (m)"""
    bodies: float
    """largest distance of a body whose position is commanded (m)"""
    height: float
    """largest error of the height of anchor, ankles and wrists, or of the commanded bodies (m)"""
    turn: float
    """angle between the anchor's orientations; of a partial keyframe the root's (rad)"""
    near: bool
    """whether everything that is commanded is near enough: see :class:`plat.control.ReachLimits`"""
    off_pose: bool
    """whether anchor, ankles or wrists are too far off to count as arrived"""
    fallen: bool
    """whether the root is at the wrong height or tilt, by the limits of TKS@3"""
    down: bool
    """whether the robot lies: see :func:`plat.envs.reach.down`"""


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
        check_robot(robot)
        check_value("PoseComparison: limits", limits, ReachLimits | None)
        self._robot = robot
        self._limits = limits or ReachLimits()
        self._model = robot.model()
        self._data = mujoco.MjData(self._model)
        self._keypoints = [self._model.body(name).id for name in robot.keypoints]
        self._watched = [robot.anchor_index, *robot.end_effector_indices]
        self._standing = standing(robot)

    def __call__(
        self,
        state: RobotState,
        pose: Keyframe,
        commands: Parts | None = None,
        root: Keyframe | None = None,
        ends: Sequence[Keyframe] = (),
    ) -> PoseErrors:
        """Errors of a state against a pose, or against the parts of it that are commanded.

        Args:
            state: of the robot.
            pose: that it should have.
            commands: parts of it that are commanded; None for all.
            root: where its root should be, :meth:`plat.keyframes.KeyframeSequence.on_the_way`. None for where the pose
                has it, and upright where that is not commanded.
            ends: poses that the way leads from and to: a root that is as low or tilted as one of them has not fallen.
        """
        actual = self._keypoints_of(state.qpos)
        wanted = self._keypoints_of(pose.qpos)
        # how a root is drawn that is not commanded is no measure of a fall
        root = root or with_commanded_root(self._standing, replace(pose, commands=commands))
        allowed = (root, *ends)
        places, turns = ([getattr(each, name) for each in allowed] for name in ("root_pos", "root_quat"))
        lowest = LowestRoot.of(torch.tensor(np.stack(places))[None], torch.tensor(np.stack(turns))[None])
        wanted["keypoint_pos_w"][0, 0] = torch.from_numpy(root.root_pos)
        wanted["keypoint_quat_w"][0, 0] = torch.from_numpy(root.root_quat)
        commands = commands or Parts.all(self._robot)
        parts = None if commands.whole else torch.tensor(commands.values(), dtype=torch.float64)[None]
        for poses, joint_pos in ((actual, state.joint_pos), (wanted, pose.joint_pos)):
            poses["joint_pos"] = torch.from_numpy(np.asarray(joint_pos, dtype=np.float64))[None]
        away = distances(actual, wanted, parts)
        heights = (actual["keypoint_pos_w"] - wanted["keypoint_pos_w"])[0, :, 2].abs()
        points = torch.linalg.vector_norm(actual["keypoint_pos_w"] - wanted["keypoint_pos_w"], dim=-1)[0]
        if parts is None:
            anchors = (poses["keypoint_quat_w"][:, self._robot.anchor_index] for poses in (actual, wanted))
            turn, watched, counted = quat_angle(*anchors), self._watched, torch.ones_like(points)
        else:
            turn = away.turn
            watched = [row for row, flag in enumerate(commands.bodies) if flag or (row == 0 and commands.root[1])]
            counted = commanded_joints_and_bodies(parts, len(state.joint_pos))[1][0]
        return PoseErrors(
            joint=float(away.joints) if any(commands.joints) else math.nan,
            keypoint=float((points * counted).sum() / counted.sum()) if counted.any() else math.nan,
            root=float(away.root) if any(commands.root[:2]) else math.nan,
            bodies=float(away.bodies) if any(commands.bodies) else math.nan,
            height=float(heights[watched].max()) if watched else 0.0,
            turn=float(turn) if commands.root[2] else math.nan,
            near=bool(away.near(self._limits)),
            off_pose=bool(off_pose(actual, wanted, self._robot, self._limits.window, parts)),
            fallen=bool(fallen(actual, wanted, self._robot, self._limits.window, parts)),
            down=bool(down(actual, lowest, self._robot, self._limits)),
        )

    def _keypoints_of(self, qpos: NDArray[np.floating]) -> TensorDict:
        """Poses of the keypoints ``[1, K, ...]`` in the world."""
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        poses = {"keypoint_pos_w": self._data.xpos, "keypoint_quat_w": self._data.xquat}
        return TensorDict({key: torch.from_numpy(rows[self._keypoints])[None] for key, rows in poses.items()}, [1])
