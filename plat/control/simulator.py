"""Simulation of one position-controlled robot in MuJoCo."""

from collections.abc import Callable
from typing import Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from plat.bounds import Positive, check_value
from plat.deploy import Pose, RobotState
from plat.deploy.state import finite_vector, root_of
from plat.errors import ActionError, RobotError, StateError
from plat.robots.robot import Robot
from plat.spec.timing import Timing

__all__ = ["PHYSICS_STEPS", "Simulator"]

PHYSICS_STEPS = 4
"""Physics steps of a control step in training and evaluation, whatever the time step of a robot's description."""

# So deep in the floor (m) a robot is thrown up by meters. Poses of motions are some centimeters in it.
_SUNK = 0.3
# MuJoCo's warnings of a state or a control that is not finite, or huge: it resets the robot, or moves no motor.
_BAD = [int(getattr(mujoco.mjtWarning, f"mjWARN_BAD{what}")) for what in ("QPOS", "QVEL", "QACC", "CTRL")]


class Simulator:
    """Simulator of one robot in plain MuJoCo, advanced by one control step at a time.

    Args:
        model: as :meth:`plat.robots.Robot.model` makes it: a free joint, J hinges, and a position actuator for each.
            Set what shall differ (time step, friction, gains) in it beforehand.
        control_dt: seconds of a control step.

    Attributes:
        model: MuJoCo's model.
        data: MuJoCo's data; may be looked at and changed between steps.

    Raises:
        RobotError: when a control step is not a whole number of the model's time steps.

    >>> from plat.robots import G1
    >>> from plat.keyframes import standing
    >>> simulator = Simulator(G1.model())
    >>> simulator.reset(standing(G1))
    >>> simulator.step(G1.default_joint_pos.numpy())
    >>> simulator.state().joint_pos.shape, round(simulator.data.time, 3)
    ((29,), 0.02)
    """

    @classmethod
    def of(cls, robot: Robot, control_dt: float) -> Self:
        """Return the simulated robot with the physics steps of training, whatever its description says.

        Args:
            robot: the robot.
            control_dt: seconds of a control step.

        >>> from plat.robots import G1
        >>> Simulator.of(G1, 0.02).substeps
        4
        """
        return cls(robot.model(timestep=control_dt / PHYSICS_STEPS), control_dt)

    def __init__(self, model: mujoco.MjModel, control_dt: float = Timing.control_dt):
        check_value("simulator: model", model, mujoco.MjModel)
        check_value("simulator: control_dt", control_dt, Positive)
        self.model = model
        self.control_dt = control_dt
        """Seconds of a control step."""
        self.data = mujoco.MjData(model)
        self.substeps = round(control_dt / model.opt.timestep)
        """Physics steps of a control step."""
        if self.substeps < 1 or abs(self.substeps * model.opt.timestep - control_dt) > 1e-9:
            raise RobotError(
                f"physics time step of {model.opt.timestep:g} s, expected a whole fraction of the control step of "
                f"{control_dt:g} s"
            )

    def reset(self, pose: Pose) -> None:
        """Reset the robot to a pose, at rest.

        Raises:
            StateError: for a pose of another number of joints, that is not finite or whose quaternion is none, or
                under the floor.
        """
        joint_pos = finite_vector("pose: joint_pos", getattr(pose, "joint_pos", None), self.model.nq - 7)
        root_pos, root_quat = root_of("pose", pose)
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:] = np.concatenate((root_pos, root_quat, joint_pos))
        mujoco.mj_forward(self.model, self.data)
        contact = self.data.contact
        of_world = (self.model.geom_bodyid[contact.geom] == 0).any(-1)
        if (depth := -contact.dist[of_world].min(initial=0.0)) > _SUNK:
            raise StateError(f"pose: the robot is {100 * depth:.0f} cm inside the floor, expected a start on it")

    def state(self) -> RobotState:
        """Return the measured state, without noise."""
        qpos, qvel = self.data.qpos, self.data.qvel
        root_lin_vel_b = np.empty(3)
        world_to_root = np.empty(4)
        mujoco.mju_negQuat(world_to_root, qpos[3:7])
        mujoco.mju_rotVecQuat(root_lin_vel_b, qvel[:3], world_to_root)
        return RobotState(
            joint_pos=qpos[7:].copy(),
            joint_vel=qvel[6:].copy(),
            root_pos_w=qpos[:3].copy(),
            root_quat_w=qpos[3:7].copy(),
            root_lin_vel_b=root_lin_vel_b,
            # the angular velocity of a free joint is in the body's own frame
            root_ang_vel_b=qvel[3:6].copy(),
        )

    def step(self, joint_target: NDArray[np.floating], after_each: Callable[[], None] | None = None) -> None:
        """Hold joint position targets ``[J]`` (rad) for a control step.

        Args:
            joint_target: joint position targets.
            after_each: called after every physics step, for sensors that are faster than the policy.

        Raises:
            ActionError: for targets of another number, or one that is not finite, naming the joint; when the
                simulation diverges. MuJoCo would go on with the robot upright in its start.
        """
        if np.shape(joint_target) != self.data.ctrl.shape:
            raise ActionError(f"joint_target has shape {np.shape(joint_target)}, expected {self.data.ctrl.shape}")
        joint_target = np.asarray(joint_target)  # of a tensor, NumPy's checks are tensors as well, and invert otherwise
        wrong = np.flatnonzero(~np.isfinite(joint_target))
        if wrong.size:
            name = self.model.actuator(wrong[0]).name
            raise ActionError(f"the target of joint {name!r} is {joint_target[wrong[0]]}, expected a finite angle")
        time, warned = self.data.time, self.data.warning.number
        warned[_BAD] = 0  # else one of an earlier step could not be told from one of this
        self.data.ctrl[:] = joint_target
        if after_each is None:
            mujoco.mj_step(self.model, self.data, self.substeps)
        else:
            for _ in range(self.substeps):
                mujoco.mj_step(self.model, self.data)
                after_each()
        if warned[_BAD].any():
            raise ActionError(f"the simulation diverged {time:.2f} s after its start: targets or pushes are too large")

    def push(self, velocity_w: NDArray[np.floating]) -> None:
        """Add ``velocity_w`` ``[3]`` (m/s, world) to the velocity of the whole robot at once: a shove.

        Raises:
            StateError: for another number of values: one alone would push along all axes.
        """
        if np.shape(velocity_w) != (3,):
            raise StateError(f"push: velocity_w has shape {np.shape(velocity_w)}, expected (3,)")
        self.data.qvel[:3] += np.asarray(velocity_w)
