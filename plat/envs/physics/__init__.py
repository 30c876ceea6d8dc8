"""Physics behind the environments: a protocol, and MuJoCo's thread pool that implements it."""

from plat.envs.physics.mujoco_batch import BatchedPhysics, available_cpus
from plat.envs.physics.protocol import Kinematics, Physics, PhysicsFactory

__all__ = ["BatchedPhysics", "Kinematics", "Physics", "PhysicsFactory", "available_cpus"]
