"""Scene of a bundle: the robot on a floor, for MuJoCo without plat."""

from plat.robots import Robot

__all__ = ["scene_xml"]


def scene_xml(robot: Robot, timestep: float | None = None) -> str | None:
    """Return the MJCF of a robot on a floor, motors and contact sensors included; None when it needs other files.

    Args:
        robot: the robot.
        timestep: physics step (s); None for the asset's.

    >>> import mujoco
    >>> from plat.robots import G1
    >>> mujoco.MjModel.from_xml_string(scene_xml(G1)).nu
    29
    """
    spec = robot.spec()
    if any(mesh.file for mesh in spec.meshes) or any(field.file for field in spec.hfields):
        return None
    if any(texture.file for texture in spec.textures):
        return None
    if timestep is not None:
        spec.option.timestep = timestep
    spec.compile()  # names and defaults are resolved by it
    return spec.to_xml()
