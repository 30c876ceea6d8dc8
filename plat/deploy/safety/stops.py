"""Stops: states from which a policy cannot recover, and motors that are too hot."""

import numpy as np

from plat.deploy.description import RobotDescription
from plat.deploy.safety.settings import SafetySettings
from plat.deploy.state import Array, RobotState
from plat.rotations_np import quat_to_matrix
from plat.spec.proportions import in_proportion

__all__ = ["stop_reason"]


def stop_reason(
    robot: RobotDescription,
    state: RobotState,
    settings: SafetySettings = SafetySettings(),
    temperatures: Array | None = None,
) -> tuple[str, str] | None:
    """Return the name of the stop and its reason; None when the robot may go on.

    Args:
        robot: names of its joints, and the height at which it stands.
        state: plausible.
        settings: tilt, height and temperature.
        temperatures: of the motors ``[J]`` (°C); those that are not finite are not known.

    >>> from plat.robots import G1, describe_robot
    >>> still, place, quat = np.zeros(3), np.array([0.0, 0.0, 0.2]), np.array([1.0, 0.0, 0.0, 0.0])
    >>> low = RobotState(np.zeros(29), np.zeros(29), place, quat, still, still)
    >>> stop_reason(describe_robot(G1, 0.02), low)
    ('height', 'root 0.20 m above the floor, at least 0.3')
    """
    up = float(np.clip(quat_to_matrix(state.root_quat_w)[2, 2], -1.0, 1.0))
    tilt = float(np.arccos(up))
    if tilt > settings.tilt:
        return "tilt", f"{tilt:.2f} rad from the vertical, at most {settings.tilt:g}"
    height = float(state.root_pos_w[2])
    least = in_proportion(0.3, robot.root_height) if settings.height is None else settings.height
    if height < least:
        return "height", f"root {height:.2f} m above the floor, at least {least:.3g}"
    if temperatures is not None:
        measured = np.asarray(temperatures, dtype=np.float64)
        hot = np.flatnonzero(measured > settings.temperature)
        if hot.size:
            name = robot.joint_names[hot[0]] if hot[0] < len(robot.joint_names) else f"motor {hot[0]}"
            return "temperature", f"{name} at {measured[hot[0]]:.0f} °C, at most {settings.temperature:g}"
    return None
