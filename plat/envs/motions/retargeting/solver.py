"""Inverse kinematics of a whole motion, frame after frame, with the library mink."""

from dataclasses import dataclass

import mink
import mujoco
import numpy as np

from plat.envs.motions.retargeting.geometry import TRACKED
from plat.envs.motions.retargeting.targets import Targets
from plat.envs.robot import Robot

__all__ = ["SolverOptions", "solve"]

# Weight of a metre of position error and of a radian of orientation error. Feet count most, so that they stay where
# they are planned; the pelvis gives way.
_POSITION_COST = {"pelvis": 4.0, "torso": 0.0, "knee": 2.0, "ankle": 2.0, "elbow": 2.0, "wrist": 2.0}
# Added for a foot on the ground, less the higher it is, down to nothing at the second figure (m).
_GROUND_COST = 20.0
_GROUNDED = 0.15
_ROTATION_COST = {"pelvis": 1.0, "torso": 1.0, "ankle": 2.0}
# Weight of a radian from the default pose: settles what no target asks for, such as the turn of a stretched arm.
_POSTURE_COST = 0.02
_WRIST_COST = 0.2
_DAMPING = 1e-3


@dataclass(frozen=True)
class SolverOptions:
    """How inverse kinematics is done."""

    iterations: int = 4
    """steps of inverse kinematics a frame"""
    first_frame_iterations: int = 60
    """steps of it for the first frame, which starts from the default pose"""
    max_joint_speed: float = 15.0
    """fastest that a joint may turn (rad/s)"""


class _Positions(mink.Task):
    """Brings the origins of bodies to points of the world."""

    def __init__(self, bodies: list[int], costs: list[float]):
        super().__init__(cost=np.repeat(costs, 3))
        self.bodies = bodies
        self.target = np.zeros((len(bodies), 3))

    def compute_error(self, configuration: mink.Configuration) -> np.ndarray:
        return (configuration.data.xpos[self.bodies] - self.target).ravel()

    def compute_jacobian(self, configuration: mink.Configuration) -> np.ndarray:
        model, data = configuration.model, configuration.data
        jacobian = np.empty((3 * len(self.bodies), model.nv))
        for row, body in enumerate(self.bodies):
            mujoco.mj_jacBody(model, data, jacobian[3 * row : 3 * row + 3], None, body)
        return jacobian


def solve(targets: Targets, robot: Robot, fps: float, options: SolverOptions) -> tuple[np.ndarray, np.ndarray]:
    """Poses of the robot that come near the targets, within joint and speed limits.

    Each frame starts from the one before. Joint limits and the distance that a joint may have moved since the last
    frame are the bounds of mink's quadratic programs, so they hold whatever the targets are.

    Returns:
        ``qpos`` ``[T, 7 + J]`` and the positions of the tracked bodies ``[T, R, 3]`` in the order of
        ``targets.positions``.
    """
    model = robot.model()
    configuration = mink.Configuration(model, robot.default_qpos)
    roles = list(targets.positions)
    kinds = [role.split("_")[-1] for role in roles]
    positions = _Positions([model.body(TRACKED[role]).id for role in roles], [_POSITION_COST[kind] for kind in kinds])
    rotations = {
        role: mink.FrameTask(TRACKED[role], "body", 0.0, _ROTATION_COST[role.split("_")[-1]])
        for role in targets.rotations
    }
    posture_cost = np.full(model.nv, _POSTURE_COST)
    posture_cost[[6 + index for index, name in enumerate(robot.joint_names) if "wrist" in name]] = _WRIST_COST
    posture = mink.PostureTask(model, posture_cost)
    posture.set_target(robot.default_qpos)
    limit = mink.ConfigurationLimit(model, gain=1.0)
    lowest, highest = limit.lower[7:].copy(), limit.upper[7:].copy()

    ankles = {role: roles.index(role) for role in targets.contact}
    poses = np.stack([targets.positions[role] for role in roles], 1)
    quats = {role: _quaternions(rotation) for role, rotation in targets.rotations.items()}
    qpos = np.empty((len(poses), model.nq))
    reached = np.empty_like(poses)
    configuration.update(np.concatenate((poses[0, roles.index("pelvis")], quats["pelvis"][0], robot.default_qpos[7:])))
    tasks = [positions, *rotations.values(), posture]
    for frame, pose in enumerate(poses):
        positions.target = pose
        for role, index in ankles.items():
            near = max(0.0, 1 - targets.clearance[role][frame] / _GROUNDED)
            positions.cost[3 * index : 3 * index + 3] = _POSITION_COST["ankle"] + near * _GROUND_COST
        for role, task in rotations.items():
            task.set_target(mink.SE3(np.concatenate((quats[role][frame], pose[0]))))
        if frame > 0:
            reach = options.max_joint_speed / fps
            limit.lower[7:] = np.maximum(lowest, configuration.q[7:] - reach)
            limit.upper[7:] = np.minimum(highest, configuration.q[7:] + reach)
        for _ in range(options.iterations if frame > 0 else options.first_frame_iterations):
            velocity = mink.solve_ik(configuration, tasks, 1.0, "daqp", damping=_DAMPING, limits=[limit])
            configuration.integrate_inplace(velocity, 1.0)
        qpos[frame] = configuration.q
        reached[frame] = configuration.data.xpos[positions.bodies]
    return qpos, reached


def _quaternions(rotations: np.ndarray) -> np.ndarray:
    """``[T, 4]`` (wxyz) of ``[T, 3, 3]``."""
    quats = np.empty((len(rotations), 4))
    for quat, rotation in zip(quats, rotations, strict=True):
        mujoco.mju_mat2Quat(quat, rotation.ravel())
    return quats
