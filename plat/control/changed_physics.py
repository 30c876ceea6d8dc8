"""Simulations whose physics differs from that of training: time step, contacts, friction, delay and gains."""

from collections import deque
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from plat.control.chase import Controller
from plat.control.simulator import PHYSICS_STEPS
from plat.deploy import Pose, RobotDescription, RobotState
from plat.robots import FootContacts, Robot

__all__ = ["Delayed", "PhysicsSetting", "make_model", "physics_settings"]

_FINE = 0.001  # s: how long a fine physics step is


@dataclass(frozen=True)
class PhysicsSetting:
    """Physics that differs from the simulation that policies are trained in."""

    name: str
    timestep: float | None = None
    """seconds of a physics step; None for that of training, a quarter of the control step"""
    feet: FootContacts = "spheres"
    """contact geometry of the soles"""
    friction: float | None = None
    """sliding friction of the soles; None for the model's own"""
    delay: int = 0
    """control steps that joint targets arrive late"""
    gain: float = 1.0
    """factor on stiffness and damping of every motor"""


def physics_settings(control_dt: float) -> tuple[PhysicsSetting, ...]:
    """Return the physics that `plat sim-to-sim` runs a policy at.

    Args:
        control_dt: seconds of the policy's control step. Fine physics steps are the whole fraction of it that is
            nearest to 1 ms.

    >>> [physics.name for physics in physics_settings(0.02)][:2], physics_settings(0.01)[5].name
    (['as in training', '1 ms physics steps'], '10 ms control delay')
    """
    fine = control_dt / max(1, round(control_dt / _FINE))
    step, delay = f"{1000 * fine:.3g} ms", f"{1000 * control_dt:.3g} ms"
    return (
        PhysicsSetting("as in training"),
        PhysicsSetting(f"{step} physics steps", timestep=fine),
        PhysicsSetting("capsule feet", feet="capsules"),
        PhysicsSetting("friction 0.3", friction=0.3),
        PhysicsSetting("friction 1.2", friction=1.2),
        PhysicsSetting(f"{delay} control delay", delay=1),
        PhysicsSetting("gains -10 %", gain=0.9),
        PhysicsSetting("gains +10 %", gain=1.1),
        PhysicsSetting(f"all: {step}, capsules, 0.3, delay, -10 %", fine, "capsules", 0.3, 1, 0.9),
    )


def make_model(robot: Robot, description: RobotDescription, physics: PhysicsSetting) -> mujoco.MjModel:
    """Return a model of the robot with the motors of a bundle, at some physics."""
    model = robot.model(physics.feet)
    model.opt.timestep = description.control_dt / PHYSICS_STEPS if physics.timestep is None else physics.timestep
    model.actuator_gainprm[:, 0] = physics.gain * description.stiffness
    model.actuator_biasprm[:, 1] = -physics.gain * description.stiffness
    model.actuator_biasprm[:, 2] = -physics.gain * description.damping
    model.actuator_forcerange[:] = description.effort_limit[:, None] * (-1, 1)
    if physics.friction is not None:
        model.geom_friction[robot.sole_geoms(model), 0] = physics.friction
    return model


class Delayed:
    """Controller whose targets arrive ``delay`` control steps late; before the first, the default pose."""

    def __init__(self, controller: Controller, robot: RobotDescription, delay: int):
        self._controller = controller
        self._first = robot.default_joint_pos
        self._delay = delay
        self.timing = controller.timing
        self.sees_parts = getattr(controller, "sees_parts", True)
        self.reset()

    def reset(self, joint_target: NDArray[np.floating] | None = None) -> None:
        """Start a new chase, see :class:`plat.control.Controller`."""
        self._controller.reset(joint_target)
        first = self._first if joint_target is None else joint_target
        self._coming = deque([first] * self._delay)

    def __call__(self, state: RobotState, keyframe: Pose, steps_left: int) -> NDArray[np.floating]:
        """See :class:`plat.control.Controller`."""
        self._coming.append(self._controller(state, keyframe, steps_left))
        return self._coming.popleft()
