"""Conversion of a robot to a description for programs without MuJoCo and torch."""

import mujoco
import numpy as np

from plat.bounds import Positive, check_robot, check_value
from plat.deploy import Body, Foot, RobotDescription
from plat.robots.kinematics import ForwardKinematics
from plat.robots.robot import Robot
from plat.robots.sole_points import SOLE_GEOMS, touching_points

__all__ = ["describe_robot"]


def describe_robot(robot: Robot, control_dt: float) -> RobotDescription:
    """Return the description of a robot that :mod:`plat.deploy` needs.

    Args:
        robot: the robot.
        control_dt: seconds from one action to the next.

    >>> from plat.robots import G1
    >>> description = describe_robot(G1, control_dt=0.02)
    >>> description.joint_names[:2], description.bodies[0].name, len(description.bodies)
    (('left_hip_pitch', 'left_hip_roll'), 'pelvis', 30)
    """
    check_robot(robot)
    check_value("robot: control_dt", control_dt, Positive)
    model = robot.model()
    root = 1  # indices of MuJoCo's bodies
    index = {root: 0}
    bodies = [Body(robot.keypoints[0], -1, -1, axis=(0.0, 0.0, 0.0), pos=(0.0, 0.0, 0.0), quat=(1.0, 0.0, 0.0, 0.0))]
    for link, parent, joint in ForwardKinematics(robot).chain:
        index[link] = len(bodies)
        axis = model.jnt_axis[1 + joint] if joint >= 0 else np.zeros(3)
        numbers = {"axis": axis, "pos": model.body_pos[link], "quat": model.body_quat[link]}
        tuples = {name: tuple(values.tolist()) for name, values in numbers.items()}
        bodies.append(Body(model.body(link).name, index[parent], joint, **tuples))
    return RobotDescription(
        name=robot.name,
        joint_names=robot.joint_names,
        root_height=robot.root_height,
        # the float32 values that policies and environments compute with
        default_joint_pos=robot.default_joint_pos.double().numpy(),
        joint_range=model.jnt_range[1:].copy(),
        stiffness=model.actuator_gainprm[:, 0].copy(),
        damping=-model.actuator_biasprm[:, 2],
        effort_limit=model.actuator_forcerange[:, 1].copy(),
        action_scale=robot.action_scale.double().numpy(),
        control_dt=control_dt,
        keypoints=robot.keypoints,
        bodies=tuple(bodies),
        feet=_feet(robot, model),
        mass=float(model.body_mass.sum()),
    )


def _feet(robot: Robot, model: mujoco.MjModel) -> tuple[Foot, ...]:
    """Return the feet with the points that they stand on; none where a sole is of geoms that have no such points."""
    if not np.isin(model.geom_type[robot.sole_geoms(model)], SOLE_GEOMS).all():
        return ()
    return tuple(
        Foot(body, tuple((x, y, z) for x, y, z in points.tolist()))
        for body, points in zip(robot.feet, touching_points(robot, model), strict=True)
    )
