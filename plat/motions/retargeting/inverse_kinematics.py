"""Inverse kinematics of a whole motion, frame after frame, with the library mink."""

import daqp  # noqa: F401  (the solver that mink looks for)
import mink
import mujoco
import numpy as np

from plat.motions.checks.steps import SPREAD_SECONDS, JointStep, joint_steps, smooth_steps
from plat.motions.clip import MotionClip
from plat.motions.retargeting.geometry import TRACKED
from plat.motions.retargeting.options import SolverOptions
from plat.motions.retargeting.targets import Targets
from plat.robots.robot import Robot, without_side

__all__ = ["solve"]

# Weight of a meter of position error and of a radian of orientation error. Feet count most, so that they stay where
# they are planned; the pelvis gives way.
_POSITION_COST = {"pelvis": 4.0, "knee": 2.0, "ankle": 2.0, "elbow": 2.0, "wrist": 2.0}
# Added for a foot on the ground; for its position less the higher it is, down to nothing at the third figure (m).
_GROUND_COST = 20.0
_GROUND_ROTATION_COST = 2.0
_GROUNDED = 0.15
_ROTATION_COST = {"pelvis": 1.0, "torso": 1.0, "ankle": 0.3}
# Weight of a radian from the default pose: settles what no target asks for, such as the turn of a stretched arm.
_POSTURE_COST = 0.02
_WRIST_COST = 0.2
# Weight of a radian from the frame before: calms arms near their singular poses.
_STILL_COST = 0.05
_DAMPING = 1e-3
# A step of a joint that is isolated and faster than this (rad/s) is spread over time; then the joint is kept near its
# new path at this weight of a radian, while the others give way.
_STEP_SPEED = 8.0
_PATH_COST = 1.0
_SETTLING_ROUNDS = 6
_TAPER_SECONDS = 0.06
_SETTLING_ITERATIONS = 2
# Narrower than the robot's own limits (rad): beyond them lie poses in which a leg or an arm is turned inside out to
# reach the same points. A human's hip turns no further; knee and elbow do not bend backward.
_HUMAN_RANGE = {
    "hip_roll": (-1.5, 1.5),
    "hip_yaw": (-1.2, 1.2),
    "knee": (0.0, 3.0),
    "waist_yaw": (-1.2, 1.2),
    "shoulder_pitch": (-3.2, 1.3),
    "shoulder_roll": (-1.7, 1.7),
    "elbow": (-1.1, 1.6),
}


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


def solve(targets: Targets, robot: Robot, fps: float, options: SolverOptions) -> np.ndarray:
    """Return poses of the robot that come near the targets, within joint and speed limits.

    Each frame starts from the one before. Joint limits and the largest move per frame are bounds of mink's quadratic
    programs, so they hold whatever the targets.

    Returns:
        ``qpos`` ``[T, 7 + J]``.
    """
    model = robot.model()
    configuration = mink.Configuration(model, robot.default_qpos)
    roles = list(targets.positions)
    positions = _Positions([model.body(TRACKED[role]).id for role in roles], [_cost(_POSITION_COST, r) for r in roles])
    rotations = {
        role: mink.FrameTask(TRACKED[role], "body", 0.0, _cost(_ROTATION_COST, role)) for role in targets.rotations
    }
    is_wrist = np.array([False] * 6 + ["wrist" in name for name in robot.joint_names])
    posture = mink.PostureTask(model, np.where(is_wrist, _WRIST_COST, _POSTURE_COST))
    posture.set_target(robot.default_qpos)
    still = mink.PostureTask(model, _STILL_COST)
    tasks = [positions, *rotations.values(), posture, still]
    limit = mink.ConfigurationLimit(model, gain=1.0)
    human = np.array([_range(name) for name in robot.joint_names])
    lowest, highest = np.maximum(limit.lower[7:], human[:, 0]), np.minimum(limit.upper[7:], human[:, 1])
    limit.lower[7:], limit.upper[7:] = lowest, highest

    places = np.stack([targets.positions[role] for role in roles], 1)
    quats = {role: _quaternions(rotation) for role, rotation in targets.rotations.items()}
    qpos = np.empty((len(places), model.nq))
    led = {7 + robot.joint_names.index(name): angles for name, angles in targets.posture.items()}
    start = np.concatenate((places[0, roles.index("pelvis")], quats["pelvis"][0], robot.default_qpos[7:]))
    for column, angles in led.items():
        start[column] = angles[0]
    start[7:] = np.clip(start[7:], lowest, highest)
    configuration.update(start)

    def aim(frame: int) -> None:
        """Set the targets of a frame, all but that of ``still``."""
        positions.target = places[frame]
        posture.set_target(
            [led[column][frame] if column in led else angle for column, angle in enumerate(robot.default_qpos)]
        )
        for role, contact in targets.contact.items():
            near = max(0.0, 1 - targets.clearance[role][frame] / _GROUNDED)
            row = 3 * roles.index(role)
            positions.cost[row : row + 3] = _POSITION_COST["ankle"] + near * _GROUND_COST
            rotations[role].set_orientation_cost(_ROTATION_COST["ankle"] + contact[frame] * _GROUND_ROTATION_COST)
        for role, task in rotations.items():
            task.set_target(mink.SE3(np.concatenate((quats[role][frame], np.zeros(3)))))

    def approach(iterations: int) -> None:
        for _ in range(iterations):
            velocity = mink.solve_ik(configuration, tasks, 1.0, "daqp", damping=_DAMPING, limits=[limit])
            configuration.integrate_inplace(velocity, 1.0)

    for frame in range(len(places)):
        aim(frame)
        still.set_target(configuration.q)
        if frame > 0:
            # mink's own speed limit would bound each iteration, not the frame
            reach = options.max_joint_speed / fps
            limit.lower[7:] = np.maximum(lowest, configuration.q[7:] - reach)
            limit.upper[7:] = np.minimum(highest, configuration.q[7:] + reach)
        approach(options.iterations if frame > 0 else options.first_frame_iterations)
        qpos[frame] = configuration.q

    # Each frame knows only the one before, so a joint that has to be elsewhere gets there in one step. Such steps are
    # spread over time, and the frames around them solved again near the path that this gives.
    reach = options.max_joint_speed / fps
    for number in range(_SETTLING_ROUNDS):
        steps = joint_steps(MotionClip("", qpos, fps), _STEP_SPEED, robot)
        if not steps:
            break
        smooth = smooth_steps(MotionClip("", qpos, fps), _STEP_SPEED, robot).clip.qpos
        near_path = np.full(model.nv, _STILL_COST)
        near_path[[6 + robot.joint_names.index(step.joint) for step in steps]] = _PATH_COST
        still.set_cost(near_path)
        before = qpos.copy()
        for window in _windows(steps, len(qpos), fps):
            solved = smooth[window].copy()
            for row, frame in enumerate(range(window.start, window.stop)):
                aim(frame)
                still.set_target(smooth[frame])
                last = qpos[frame - 1, 7:] if row == 0 and frame > 0 else solved[row - 1, 7:] if row else smooth[0, 7:]
                limit.lower[7:], limit.upper[7:] = np.maximum(lowest, last - reach), np.minimum(highest, last + reach)
                configuration.update(smooth[frame])
                approach(_SETTLING_ITERATIONS)
                solved[row] = configuration.q
            # solving may bring a step back: in the end the smooth path is taken as it is
            solutions = [_tapered(solved, smooth[window], fps)] if number < _SETTLING_ROUNDS // 2 else []
            for candidate in (*solutions, smooth[window]):
                qpos[window] = candidate
                if _fastest(qpos, window) <= max(reach, _fastest(before, window)) * (1 + 1e-9):
                    break
                qpos[window] = before[window]
        if np.array_equal(before, qpos):
            break
    return qpos


def _windows(steps: list[JointStep], count: int, fps: float) -> list[slice]:
    """Return the stretches of frames over which steps are spread; those that meet are one."""
    frames = np.arange(count)
    near = np.zeros(count + 1, bool)
    for step in steps:
        near[:-1] |= np.abs(frames - step.frame - 0.5) <= SPREAD_SECONDS * fps + 1
    edges = np.flatnonzero(np.diff(near.astype(int), prepend=0))
    return [slice(int(first), int(last)) for first, last in edges.reshape(-1, 2)]


def _tapered(solved: np.ndarray, path: np.ndarray, fps: float) -> np.ndarray:
    """Return solved poses ``[T, 7 + J]`` that go over into a path at both ends."""
    frames = np.arange(len(path))
    inside = np.minimum(frames, frames[::-1]) / (_TAPER_SECONDS * fps)
    share = inside.clip(0, 1)[:, None]
    mixed = path + share * (solved - path)
    mixed[:, 3:7] /= np.linalg.norm(mixed[:, 3:7], axis=1, keepdims=True)
    return mixed


def _fastest(qpos: np.ndarray, window: slice) -> float:
    """Return the largest change of a joint between two frames (rad), in a stretch and at its ends."""
    return float(np.abs(np.diff(qpos[max(0, window.start - 1) : window.stop + 1, 7:], axis=0)).max())


def _cost(costs: dict[str, float], role: str) -> float:
    """Of a role whatever its side."""
    return costs[without_side(role)]


def _range(joint: str) -> tuple[float, float]:
    return _HUMAN_RANGE.get(without_side(joint), (-np.inf, np.inf))


def _quaternions(rotations: np.ndarray) -> np.ndarray:
    """``[T, 4]`` (wxyz) of ``[T, 3, 3]``."""
    quats = np.empty((len(rotations), 4))
    for quat, rotation in zip(quats, rotations, strict=True):
        mujoco.mju_mat2Quat(quat, rotation.ravel())
    return quats
