"""Physics by its name on the command line."""

from plat.envs.physics.mujoco_batch import BatchedPhysics
from plat.envs.physics.mujoco_warp import WarpPhysics
from plat.envs.physics.protocol import PhysicsFactory
from plat.envs.settings import PhysicsName, check_physics

__all__ = ["get_physics"]


def get_physics(name: PhysicsName) -> PhysicsFactory:
    """Return the factory of a physics: ``mujoco`` on the CPU, or ``warp``, MuJoCo Warp on a GPU.

    Raises:
        ConfigError: when the package that it needs is not installed.

    >>> get_physics("mujoco").__name__
    'BatchedPhysics'
    """
    check_physics(name)
    return BatchedPhysics if name == "mujoco" else WarpPhysics
