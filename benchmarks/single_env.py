"""Timed keyframe task for one robot in NumPy and MuJoCo alone, as it would be written without plat."""

from typing import Any

import gymnasium
import mujoco
import numpy as np

from plat.envs import KeyframeTaskConfig, observation_size
from plat.envs.transforms import HORIZONS, Horizon, TrackingTerm
from plat.motions import MotionLibrary
from plat.spec.observation import student_keys
from plat.spec.timing import Timing

__all__ = ["SingleG1"]

_ACTION_BOUND = 20.0


class SingleG1(gymnasium.Env):
    """One G1 with the observation, rewards and terminations of ``plat/G1TimedKeyframe-v0``.

    It has no entries for a critic or an expert and no statistics, and starts are uniform instead of failure-weighted.
    A test holds observation, reward and terminations equal to plat's.

    Args:
        library: motions.
        config: rewards, terminations, noise on the starting state; observation noise and domain randomization are
            not taken from it.
        horizon: lengths of the commands.
    """

    def __init__(
        self, library: MotionLibrary, config: KeyframeTaskConfig | None = None, horizon: Horizon = HORIZONS["mixed"]
    ):
        self._timing = Timing(control_dt=library.dt)
        self._config = config = config or KeyframeTaskConfig()
        self._horizon = horizon
        self._robot = robot = library.robot
        self._dt = library.dt
        self._motion = {name: np.ascontiguousarray(value) for name, value in library.frames.cpu().numpy().items()}
        self._last_frame = library.last_frame.numpy()
        self._starts = np.flatnonzero(self._last_frame - np.arange(len(library)) >= horizon.shortest)
        self._model = robot.model(config.feet, foot_counts=True)
        self._model.opt.timestep = library.dt / config.decimation
        self._data = mujoco.MjData(self._model)
        self._bodies = [self._model.body(name).id for name in robot.keypoints]
        self._default, self._scale = robot.default_joint_pos.numpy(), robot.action_scale.numpy()
        self._range = robot.joint_range.numpy()
        middle, half = self._range.mean(-1), 0.5 * (self._range[:, 1] - self._range[:, 0])
        soft = config.regularization.soft_limit
        self._soft_low, self._soft_high = middle - soft * half, middle + soft * half
        self._last_action = np.zeros(robot.num_joints)
        self.frame = self.target_frame = 0
        """Rows of the library where the robot is to be now, and where its command ends."""
        self._keys = student_keys()
        size = observation_size(self._keys, robot)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float32)
        bound = np.full(robot.num_joints, _ACTION_BOUND, np.float32)
        self.action_space = gymnasium.spaces.Box(-bound, bound)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start anywhere in any motion."""
        super().reset(seed=seed)
        frame = int(self.np_random.choice(self._starts))
        self.place(frame, self._draw_target(frame), *self._start_state(frame))
        return self.observe(), {}

    def place(self, frame: int, target_frame: int, qpos: np.ndarray, qvel: np.ndarray) -> None:
        """Begin an episode in a given state with a given command."""
        mujoco.mj_resetData(self._model, self._data)
        self._data.qpos, self._data.qvel = qpos, qvel
        mujoco.mj_step1(self._model, self._data)
        self.frame, self.target_frame = frame, target_frame
        self._last_action = np.zeros_like(self._last_action)

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Hold the joint targets for one control step."""
        action = np.clip(action, -_ACTION_BOUND, _ACTION_BOUND)
        self._data.ctrl = self._default + self._scale * action
        for _ in range(self._config.decimation):
            # this order leaves body poses and velocities current with the new state at no extra cost
            mujoco.mj_step2(self._model, self._data)
            mujoco.mj_step1(self._model, self._data)
        self.frame += 1
        in_window = self.target_frame - self.frame < self._timing.window
        reward, terminated = self._judge(action, in_window)
        self._last_action = action
        truncated = bool(self.frame >= self._last_frame[self.frame])
        if self.target_frame == self.frame:
            self.target_frame = self._draw_target(self.frame)
        return self.observe(), reward, terminated, truncated, {}

    def observe(self) -> np.ndarray:
        """Return the policy's observation ``[177]``."""
        data, motion, target = self._data, self._motion, self.target_frame
        root_to_world = data.xmat[1].reshape(3, 3)
        keypoint_pos_b = (motion["keypoint_pos"][target] - data.qpos[:3]) @ root_to_world
        rotation_b = root_to_world.T @ _matrix(motion["keypoint_quat"][target, 0])
        entries = {
            ("robot", "joint_pos"): data.qpos[7:] - self._default,
            ("robot", "joint_vel"): data.qvel[6:],
            ("robot", "root_ang_vel_b"): data.qvel[3:6],
            ("robot", "root_lin_vel_b"): data.qvel[:3] @ root_to_world,
            ("robot", "gravity_b"): -root_to_world[2],
            ("robot", "last_action"): self._last_action,
            ("goal", "joint_pos"): motion["joint_pos"][target],
            ("goal", "root_pos_b"): keypoint_pos_b[0],
            ("goal", "root_rot6d_b"): rotation_b[:, :2].T.ravel(),
            ("goal", "keypoint_pos_b"): keypoint_pos_b.ravel(),
            ("command", "horizon"): [max(target - self.frame, 1) / self._timing.max_steps],
        }
        return np.concatenate([entries[key] for key in self._keys], dtype=np.float32)

    def _draw_target(self, frame: int) -> int:
        steps = int(self.np_random.integers(self._horizon.shortest, self._horizon.longest, endpoint=True))
        return min(frame + steps, int(self._last_frame[frame]))

    def _start_state(self, frame: int) -> tuple[np.ndarray, np.ndarray]:
        motion, noise = self._motion, self._config.reset_noise

        def uniform(*half_widths: float) -> np.ndarray:
            return self.np_random.uniform(-1, 1, len(half_widths)) * half_widths

        pos = motion["keypoint_pos"][frame, 0] + uniform(noise.root_pos_xy, noise.root_pos_xy, noise.root_pos_z)
        turn, quat = np.empty(4), np.empty(4)
        rotvec = uniform(noise.roll_pitch, noise.roll_pitch, noise.yaw)
        mujoco.mju_axisAngle2Quat(turn, rotvec / np.linalg.norm(rotvec), np.linalg.norm(rotvec))
        mujoco.mju_mulQuat(quat, turn, motion["keypoint_quat"][frame, 0])
        lin_vel = motion["keypoint_lin_vel"][frame, 0] + uniform(
            noise.root_lin_vel_xy, noise.root_lin_vel_xy, noise.root_lin_vel_z
        )
        ang_vel = motion["keypoint_ang_vel"][frame, 0] + uniform(
            noise.root_ang_vel_rp, noise.root_ang_vel_rp, noise.root_ang_vel_yaw
        )
        joint_pos = motion["joint_pos"][frame] + uniform(*[noise.joint_pos] * self._robot.num_joints)
        qpos = np.concatenate((pos, quat, joint_pos.clip(*self._range.T)))
        return qpos, np.concatenate((lin_vel, ang_vel @ _matrix(quat), motion["joint_vel"][frame]))

    def _judge(self, action: np.ndarray, in_window: bool) -> tuple[float, bool]:
        """Return the reward of the step, and whether the command has failed."""
        data, config, robot = self._data, self._config, self._robot
        reference = {name: values[self.frame] for name, values in self._motion.items()}
        pos, quat = data.xpos[self._bodies], data.xquat[self._bodies]
        ref_pos, ref_quat = reference["keypoint_pos"], reference["keypoint_quat"]
        # MuJoCo's cvel is (angular, linear) about the center of mass of the whole tree
        ang_vel = data.cvel[self._bodies, :3]
        lin_vel = data.cvel[self._bodies, 3:] + _cross(ang_vel, pos - data.subtree_com[1])
        anchor = robot.anchor_index
        turn = _multiply(quat[anchor], _conjugate(ref_quat[anchor]))
        heading = 0.5 * np.arctan2(
            2 * (turn[0] * turn[3] + turn[1] * turn[2]), 1 - 2 * (turn[2] * turn[2] + turn[3] * turn[3])
        )
        yaw = np.array([np.cos(heading), 0.0, 0.0, np.sin(heading)])
        origin = np.array([*pos[anchor, :2], ref_pos[anchor, 2]])
        aligned_pos = origin + (ref_pos - ref_pos[anchor]) @ _matrix(yaw).T
        aligned_quat = _multiply(yaw, ref_quat)
        anchor_turn = _angle(quat[anchor], ref_quat[anchor]) ** 2

        joint_pos = data.qpos[7:]
        joint_error = np.square(joint_pos - reference["joint_pos"]).mean()
        dense = config.dense
        reward = config.dense_weight * (
            _kernel(dense.anchor_pos, np.square(pos[anchor] - ref_pos[anchor]).sum())
            + _kernel(dense.anchor_rot, anchor_turn)
            + _kernel(dense.keypoint_pos, _squared_distance(pos, aligned_pos))
            + _kernel(dense.keypoint_rot, np.square(_angle(quat, aligned_quat)).mean())
            + _kernel(dense.keypoint_lin_vel, _squared_distance(lin_vel, reference["keypoint_lin_vel"]))
            + _kernel(dense.keypoint_ang_vel, _squared_distance(ang_vel, reference["keypoint_ang_vel"]))
            + _kernel(dense.joint_pos, joint_error)
        )
        if in_window:
            sparse = config.sparse
            reward += config.sparse_weight * (
                _kernel(sparse.joint_pos, joint_error)
                + _kernel(sparse.keypoint_pos, _squared_distance(pos, ref_pos))
                + _kernel(sparse.anchor_rot, anchor_turn)
            )
        excess = np.maximum(self._soft_low - joint_pos, 0) + np.maximum(joint_pos - self._soft_high, 0)
        found = data.sensordata
        weights = config.regularization
        penalty = (
            weights.action_rate * np.square(action - self._last_action).sum()
            + weights.joint_limit * excess.sum()
            + weights.stray_contact * (found[8] - found[10] - found[11] + found[9])
        )
        reward += config.regularization_weight * (penalty if weights.floor is None else max(penalty, weights.floor))

        limits, ends = config.limits, robot.end_effector_indices
        height = np.abs(pos[:, 2] - ref_pos[:, 2])
        if in_window:
            failed = (
                height[anchor] > limits.anchor_height
                or anchor_turn > limits.anchor_rot_squared
                or height[ends].max() > limits.end_effector_height
            )
        else:
            tilt = abs(_matrix(quat[0])[2, 2] - _matrix(ref_quat[0])[2, 2])
            failed = height[0] > limits.root_height or tilt > limits.root_tilt
        if config.max_displacement is not None:
            failed = failed or np.square(pos[0, :2] - ref_pos[0, :2]).sum() > config.max_displacement**2
        return float(self._dt * reward), bool(failed)


def _kernel(term: TrackingTerm, squared_error: float | np.ndarray) -> float:
    return term.weight * float(np.exp(-squared_error / term.scale**2))


def _squared_distance(actual: np.ndarray, wanted: np.ndarray) -> float:
    return np.square(actual - wanted).sum(-1).mean()


def _conjugate(quat: np.ndarray) -> np.ndarray:
    return quat * (1.0, -1.0, -1.0, -1.0)


def _multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    aw, ax, ay, az = a.T
    bw, bx, by, bz = b.T
    return np.array(
        (
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        )
    ).T


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    ax, ay, az = a.T
    bx, by, bz = b.T
    return np.array((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)).T


def _angle(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    # the vector part of a quotient of unit quaternions has the length sin(angle / 2)
    relative = _multiply(_conjugate(a), b)
    return 2 * np.arctan2(np.sqrt(np.square(relative[..., 1:]).sum(-1)), np.abs(relative[..., 0]))


def _matrix(quat: np.ndarray) -> np.ndarray:
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, np.asarray(quat, np.float64))
    return matrix.reshape(3, 3)
