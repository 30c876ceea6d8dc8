"""Physics behind the environments: a protocol, MuJoCo's thread pool that implements it, and MuJoCo Warp."""

from plat.envs.physics.mujoco_batch import BatchedPhysics, available_cpus
from plat.envs.physics.mujoco_warp import WarpPhysics
from plat.envs.physics.protocol import Kinematics, Physics, PhysicsFactory
from plat.envs.physics.select import get_physics

__all__ = ["BatchedPhysics", "Kinematics", "Physics", "PhysicsFactory", "WarpPhysics", "available_cpus", "get_physics"]
