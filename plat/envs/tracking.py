"""Base environment: simulated robots on a motion, joint-level control and reset onto the reference. It has no task."""

from typing import Any, Self

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Binary, Composite, Unbounded
from torchrl.envs import EnvBase

from plat.bounds import Count, Natural, Robots, check_value
from plat.entries import check_entries
from plat.envs.broken import BrokenRobots
from plat.envs.drift import drifted, estimated_root
from plat.envs.physics import BatchedPhysics, PhysicsFactory
from plat.envs.randomized_physics import arriving
from plat.envs.settings import ResetNoise
from plat.errors import MotionError, RobotError, StateError
from plat.gpu import check_device, check_stays
from plat.motions.bins import ClipBins
from plat.motions.library import MotionLibrary
from plat.robots.robot import FootContacts
from plat.rotations import quat_from_rotvec, quat_multiply, quat_rotate_inverse
from plat.spec.observation import as_observed, entry_shapes
from plat.words import counted

__all__ = ["MotionTrackingEnv", "ResetNoise"]

# Sensors of a robot, and how many numbers each reads: contacts found, and for a foot the force on it (N).
_SENSORS = {
    "left_foot_contact": 4,
    "right_foot_contact": 4,
    "ground_contact": 1,
    "self_contact": 1,
    "left_foot_count": 1,
    "right_foot_count": 1,
}
_DONE_KEYS = ("done", "terminated", "truncated")
# What the next steps depend on beside the physics.
_KEPT = (
    "_frame",
    "_last_action",
    "_earlier_action",
    "encoder_bias",
    "gyro_bias",
    "velocity_bias",
    "delay",
    "drift",
    "drift_rate",
)


class MotionTrackingEnv(EnvBase):
    """Base environment of N robots, each at a frame of a motion library, driven by joint position targets.

    A step holds the targets ``q_default + action_scale * action`` for one control step and moves every robot one
    frame on, to the clip's last at most. Episodes start on the reference (reference state initialization) and are
    truncated there. Reward is 0: transforms (:mod:`plat.envs.transforms`) make a task of it. A robot whose action is
    absurd or not finite, or whose simulation diverges, is terminated.

    Entries of the output, batch size ``[N]``, ``w`` for the world frame and ``b`` for the root frame:

    ====================================  ==========  ==========================================================
    ``("robot", "joint_pos")``            ``[J]``     measured angles minus the default pose (rad)
    ``("robot", "joint_vel")``            ``[J]``     rad/s
    ``("robot", "root_ang_vel_b")``       ``[3]``     rad/s
    ``("robot", "root_lin_vel_b")``       ``[3]``     m/s
    ``("robot", "gravity_b")``            ``[3]``     unit vector
    ``("robot", "last_action")``          ``[J]``     action of the step before (0 after a reset)
    ``("state", "root_pos_w")``           ``[3]``     m
    ``("state", "root_quat_w")``          ``[4]``     ``wxyz``
    ``("state", "joint_pos")``            ``[J]``     true angles (rad)
    ``("state", "joint_vel")``            ``[J]``     rad/s
    ``("state", "joint_torque")``         ``[J]``     N m (0 after a reset)
    ``("state", "keypoint_pos_w")``       ``[K, 3]``  m
    ``("state", "keypoint_quat_w")``      ``[K, 4]``  ``wxyz``
    ``("state", "keypoint_lin_vel_w")``   ``[K, 3]``  m/s
    ``("state", "keypoint_ang_vel_w")``   ``[K, 3]``  rad/s
    ``("state", "foot_force")``           ``[2]``     ground reaction on the left and right foot (N; 0 after a reset)
    ``("state", "stray_contacts")``       ``[1]``     contacts of the floor with other than feet, and self-contacts
    ``("estimate", "root_pos_w")``        ``[3]``     where the robot takes itself to be (m)
    ``("estimate", "root_quat_w")``       ``[4]``     ``wxyz``
    ``("motion", "frame")``               ``[]``      row of the library that the robot is to be at now
    ====================================  ==========  ==========================================================

    ``env.reset(start=frames)`` starts from these frames ``[N]``; a partial reset uses those of the robots that it
    resets. Without them, it reads ``("motion", "start")`` where a transform such as
    :class:`plat.envs.transforms.FailureWeightedStarts` writes it, or samples. TorchRL's transforms pass a reset's
    arguments on, but no custom entries: around this environment a caller's ``("motion", "start")`` is ignored.

    Args:
        library: motions; its ``dt`` is the control step.
        num_envs: number of robots N.
        decimation: physics steps per control step.
        feet: contact geometry of the soles, see :meth:`plat.robots.Robot.spec`.
        reset_noise: noise on the starting state; None starts exactly on the reference.
        min_frames_left: episodes start at frames with at least this many frames of the clip to come.
        num_threads: threads of the physics pool; None takes all CPUs.
        device: device of the tensors.
        physics: factory of the physics, which becomes the attribute of that name.

    Raises:
        RobotError: when the robot lacks one of the sensors that :class:`plat.robots.Robot` names.
        MotionError: when no frame of the library has ``min_frames_left`` frames to come.

    >>> from plat.motions import MotionLibrary, generate_motions
    >>> env = MotionTrackingEnv(MotionLibrary.from_clips(generate_motions("train", seconds=8)), num_envs=2)
    >>> env.rollout(3)["next", "robot", "joint_pos"].shape
    torch.Size([2, 3, 29])
    """

    def __init__(
        self,
        library: MotionLibrary,
        num_envs: int,
        *,
        decimation: int = 4,
        feet: FootContacts = "spheres",
        reset_noise: ResetNoise | None = None,
        min_frames_left: int = 1,
        num_threads: int | None = None,
        device: torch.device | str = "cpu",
        physics: PhysicsFactory = BatchedPhysics,
    ):
        check_value("environment: library", library, MotionLibrary)
        check_value("environment: num_envs", num_envs, Robots)
        check_value("environment: decimation", decimation, Count)
        check_value("environment: min_frames_left", min_frames_left, Natural)
        check_value("environment: num_threads", num_threads, Count | None)
        check_value("environment: reset_noise", reset_noise, ResetNoise | None)
        super().__init__(device=check_device(device), batch_size=torch.Size([num_envs]))
        self.library = library.to(device)
        self.robot = robot = library.robot
        model = robot.model(feet, timestep=library.dt / decimation, foot_counts=True)
        self.physics = physics(model, num_envs, num_threads, device)
        self.decimation = decimation
        self.reset_noise = reset_noise
        self.min_frames_left = min_frames_left
        self._starts = ClipBins(self.library, min_frames_left)
        if self._starts.num_frames == 0:
            longest = library.clip_names[int(library.clip_length.argmax())]
            raise MotionError(
                f"motion {longest!r} is the longest with {int(library.clip_length.max()) - 1} control steps, "
                f"expected at least {min_frames_left}"
            )
        self._down = torch.tensor([0.0, 0.0, -1.0], device=self.device)
        self._default_joint_pos = robot.default_joint_pos.to(self.device)
        self._action_scale = robot.action_scale.to(self.device)
        self.encoder_bias = torch.zeros(num_envs, robot.num_joints, device=self.device)
        """Offset ``[N, J]`` (rad) of the measured joint angles, seen by observation and motor alike."""
        self.gyro_bias = torch.zeros(num_envs, 3, device=self.device)
        """Offset ``[N, 3]`` (rad/s) of the measured angular velocity."""
        self.velocity_bias = torch.zeros(num_envs, 3, device=self.device)
        """Offset ``[N, 3]`` (m/s, root frame) of the measured linear velocity."""
        self.delay = torch.zeros(num_envs, dtype=torch.int64, device=self.device)
        """Control steps ``[N]`` by which targets reach the motors late, 0 to 2."""
        self.drift = torch.zeros(num_envs, 4, device=self.device)
        """Offset ``[N, 4]`` (m, m, m, rad) of the estimated position and heading of the root."""
        self.drift_rate = torch.zeros(num_envs, 3, device=self.device)
        """What it grows by ``[N, 3]`` (m/m, m/m, rad/s), see :func:`plat.envs.drift.drifted`."""
        self._frame = torch.zeros(num_envs, dtype=torch.int64, device=self.device)
        self._last_action = torch.zeros(num_envs, robot.num_joints, device=self.device)
        self._earlier_action = self._last_action
        self.broken = BrokenRobots()
        """Finds robots to terminate because their action is absurd or their simulation diverged."""
        self.seedings = 0
        """How often a seed was set: transforms that learn from episodes begin anew with each."""
        self._make_specs()
        self._check_sensors()

    @property
    def num_envs(self) -> int:
        """Return the number of robots N."""
        return self.batch_size[0]

    @property
    def qpos(self) -> Tensor:
        """Return current root positions and quaternions and joint angles of the robots ``[N, 7 + J]``."""
        return self.physics.state()[0]

    def _check_sensors(self) -> None:
        readings = self.physics.sensors()
        for name, size in _SENSORS.items():
            found = readings[name].shape[-1] if name in readings else None
            if found != size:
                data = 'reduce="netforce" data="found force"' if size == 4 else 'data="found"'
                was = "is missing" if found is None else f"reads {counted(found, 'number')}"
                raise RobotError(
                    f"robot {self.robot.name!r}: sensor {name!r} {was}, expected a contact sensor with {data}"
                )

    def _make_specs(self) -> None:
        count, joints, keypoints = self.num_envs, self.robot.num_joints, len(self.robot.keypoints)

        def group(**shapes: tuple[int, ...]) -> Composite:
            leaves = {key: Unbounded((count, *shape), device=self.device) for key, shape in shapes.items()}
            return Composite(leaves, shape=(count,), device=self.device)

        self.observation_spec = Composite(
            robot=group(**entry_shapes("robot", self.robot)),
            state=group(
                root_pos_w=(3,),
                root_quat_w=(4,),
                joint_pos=(joints,),
                joint_vel=(joints,),
                joint_torque=(joints,),
                keypoint_pos_w=(keypoints, 3),
                keypoint_quat_w=(keypoints, 4),
                keypoint_lin_vel_w=(keypoints, 3),
                keypoint_ang_vel_w=(keypoints, 3),
                foot_force=(2,),
                stray_contacts=(1,),
            ),
            estimate=group(root_pos_w=(3,), root_quat_w=(4,)),
            motion=Composite(
                frame=Unbounded((count,), dtype=torch.int64, device=self.device), shape=(count,), device=self.device
            ),
            shape=(count,),
            device=self.device,
        )
        self.action_spec = Unbounded((count, joints), device=self.device)
        self.reward_spec = Unbounded((count, 1), device=self.device)
        self.full_done_spec = Composite(
            {key: Binary(1, (count, 1), dtype=torch.bool, device=self.device) for key in _DONE_KEYS},
            shape=(count,),
            device=self.device,
        )

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        check_entries(tensordict, {"action": (self.num_envs, self.robot.num_joints)}, "environment step")
        action = self.broken.sound(tensordict["action"])
        applied = arriving(self.delay, action, self._last_action, self._earlier_action)
        target = self._default_joint_pos + self._action_scale * applied - self.encoder_bias
        self.physics.step(target, self.decimation)
        if self.drift_rate.any():
            qpos, qvel = self.physics.state()
            self.drift = drifted(self.drift, self.drift_rate, qpos[:, 3:7], qvel[:, :3], self.library.dt)
        self._earlier_action, self._last_action = self._last_action, action
        last = self.library.last_of(self._frame)  # who goes on after that stays there: what follows is another clip
        self._frame = (self._frame + 1).minimum(last)
        truncated = (self._frame >= last)[:, None]
        out = self._observe()
        out["reward"] = torch.zeros(self.num_envs, 1, device=self.device)
        out["terminated"] = self.broken.found(self.physics.diverged())[:, None]
        out["truncated"] = truncated
        out["done"] = out["terminated"] | truncated
        return out

    def _reset(
        self, tensordict: TensorDictBase | None = None, *, start: Tensor | None = None, **_: object
    ) -> TensorDictBase:
        mask = None if tensordict is None else tensordict.get("_reset", None)
        if mask is None:
            ids = torch.arange(self.num_envs, device=self.device)
        else:
            ids = mask.view(self.num_envs).nonzero()[:, 0]
        if start is None and tensordict is not None:
            start = tensordict.get(("motion", "start"), None)
        if start is None:
            self._frame = self._frame.index_copy(0, ids, self._starts.draw_frames(len(ids)))
        else:
            start = torch.as_tensor(start, device=self.device)
            if start.shape != self.batch_size or start.is_floating_point() or start.dtype == torch.bool:
                found = f"{str(start.dtype).removeprefix('torch.')} of shape {tuple(start.shape)}"
                raise MotionError(f"environment reset: start is {found}, expected a whole number for each robot")
            start = start[ids]
            if ((start < 0) | (start >= len(self.library))).any():
                raise MotionError(
                    f"environment reset: motion.start is {int(start.min())} to {int(start.max())}, expected frames of "
                    f"the motions, 0 to {len(self.library) - 1}"
                )
            self._frame = self._frame.index_copy(0, ids, start)
        self._last_action = self._last_action.index_fill(0, ids, 0.0)
        self._earlier_action = self._earlier_action.index_fill(0, ids, 0.0)
        qpos, qvel = self._start_state(self._frame[ids])
        self.physics.set_state(ids, qpos, qvel)
        observed = self._observe(ids)
        out = observed.new_zeros(self.batch_size)  # the other robots' rows are never looked at
        out[ids] = observed
        for key in _DONE_KEYS:
            out[key] = torch.zeros(self.num_envs, 1, dtype=torch.bool, device=self.device)
        return out

    def _start_state(self, frame: Tensor) -> tuple[Tensor, Tensor]:
        """Return the MuJoCo state (float64) on the reference at frames ``[n]``, with noise."""
        reference = self.library.states(frame)
        root_pos, root_quat = reference["keypoint_pos"][:, 0], reference["keypoint_quat"][:, 0]
        root_lin_vel, root_ang_vel = reference["keypoint_lin_vel"][:, 0], reference["keypoint_ang_vel"][:, 0]
        joint_pos, joint_vel = reference["joint_pos"], reference["joint_vel"]
        if (noise := self.reset_noise) is not None:

            def uniform(*half_widths: float) -> Tensor:
                draw = 2 * torch.rand(len(frame), len(half_widths), device=self.device) - 1
                return draw * torch.tensor(half_widths, device=self.device)

            root_pos = root_pos + uniform(noise.root_pos_xy, noise.root_pos_xy, noise.root_pos_z)
            turn = quat_from_rotvec(uniform(noise.roll_pitch, noise.roll_pitch, noise.yaw))
            root_quat = quat_multiply(turn, root_quat)
            root_lin_vel = root_lin_vel + uniform(noise.root_lin_vel_xy, noise.root_lin_vel_xy, noise.root_lin_vel_z)
            root_ang_vel = root_ang_vel + uniform(noise.root_ang_vel_rp, noise.root_ang_vel_rp, noise.root_ang_vel_yaw)
            limits = self.robot.joint_range.to(self.device)
            joint_pos = joint_pos + uniform(*[noise.joint_pos] * self.robot.num_joints)
            joint_pos = joint_pos.clamp(limits[:, 0], limits[:, 1])
        # a free joint's angular velocity is in the body's frame
        root_ang_vel_b = quat_rotate_inverse(root_quat, root_ang_vel)
        qpos = torch.cat((root_pos, root_quat, joint_pos), -1).double()
        return qpos, torch.cat((root_lin_vel, root_ang_vel_b, joint_vel), -1).double()

    def _observe(self, ids: Tensor | None = None) -> TensorDict:
        """Return the entries of robots ``ids`` ``[n]``; of all when None."""
        biases = (self.encoder_bias, self.gyro_bias, self.velocity_bias)
        encoder_bias, gyro_bias, velocity_bias, drift, last_action, frame = (
            values if ids is None else values[ids] for values in (*biases, self.drift, self._last_action, self._frame)
        )
        qpos, qvel = self.physics.state(ids)
        kinematics = self.physics.kinematics(self.robot.keypoints, ids)
        contacts = self.physics.sensors(ids)
        root_pos, root_quat, joint_pos = qpos[:, :3], qpos[:, 3:7], qpos[:, 7:]
        joint_vel = qvel[:, 6:]
        down = self._down.expand(len(qpos), 3)
        root_lin_vel_b, gravity_b = quat_rotate_inverse(root_quat[:, None], torch.stack((qvel[:, :3], down), 1)).unbind(
            1
        )
        left, right = contacts["left_foot_contact"], contacts["right_foot_contact"]
        foot_force = torch.linalg.vector_norm(torch.stack((left, right), 1)[..., 1:], dim=-1)
        # contacts of the feet with the ground are wanted
        wanted = contacts["left_foot_count"] + contacts["right_foot_count"]
        stray = contacts["ground_contact"] - wanted + contacts["self_contact"]
        count = (len(qpos),)
        robot = {
            "joint_pos": joint_pos - self._default_joint_pos + encoder_bias,
            "joint_vel": joint_vel,
            "root_ang_vel_b": qvel[:, 3:6] + gyro_bias,
            "root_lin_vel_b": root_lin_vel_b + velocity_bias,
            "gravity_b": gravity_b,
            "last_action": last_action,
        }
        estimated_pos, estimated_quat = estimated_root(drift, root_pos, root_quat)
        state = {
            "root_pos_w": root_pos,
            "root_quat_w": root_quat,
            "joint_pos": joint_pos,
            "joint_vel": joint_vel,
            "joint_torque": kinematics.joint_torque,
            "keypoint_pos_w": kinematics.body_pos_w,
            "keypoint_quat_w": kinematics.body_quat_w,
            "keypoint_lin_vel_w": kinematics.body_lin_vel_w,
            "keypoint_ang_vel_w": kinematics.body_ang_vel_w,
            "foot_force": foot_force,
            "stray_contacts": stray,
        }
        return TensorDict(
            {
                "robot": TensorDict(as_observed("robot", robot), count, device=self.device),
                "state": TensorDict(state, count, device=self.device),
                "estimate": TensorDict(
                    {"root_pos_w": estimated_pos, "root_quat_w": estimated_quat}, count, device=self.device
                ),
                "motion": TensorDict({"frame": frame}, count, device=self.device),
            },
            count,
            device=self.device,
        )

    def to(self, device: torch.device | str) -> Self:
        """Return the environment; its simulations stay on the device that they were made for.

        Raises:
            ConfigError: for another device.
        """
        check_stays(device, self.device, "environment")
        return self

    def get_extra_state(self) -> dict[str, Any]:
        """Return, for :meth:`state_dict`, what the next steps of all robots depend on."""
        return {
            "physics": self.physics.state_dict(),
            **{name.strip("_"): getattr(self, name).clone() for name in _KEPT},
            "broken": self.broken.state_dict(),
        }

    def set_extra_state(self, state: dict[str, Any]) -> None:
        """Restore what :meth:`get_extra_state` returned.

        Raises:
            StateError: for a state of another number of robots, or by another version of plat.
        """
        absent = [name for name in _KEPT if name.strip("_") not in state]
        if absent:
            raise StateError(f"robots: a state without {', '.join(absent)}, by another version of plat")
        self.physics.load_state_dict(state["physics"])
        for name in _KEPT:
            setattr(self, name, state[name.strip("_")].to(self.device).clone())
        self.broken.load_state_dict(state["broken"])

    def _set_seed(self, seed: int | None) -> None:
        if seed is not None:
            torch.manual_seed(seed)
            self.seedings += 1
