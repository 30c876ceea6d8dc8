"""The robot, its physics, motions, and the tasks made of them."""

from plat.envs.goals import robot_centric_goal
from plat.envs.kinematics import ForwardKinematics
from plat.envs.layout import COMMAND_KEYS, ROBOT_KEYS, entry_shapes, goal_keys, observation_size, privileged_keys
from plat.envs.motions import MotionLibrary
from plat.envs.physics import BatchedPhysics
from plat.envs.robot import G1, FootContacts, Robot
from plat.envs.tasks import TaskConfig, make_keyframe_env, make_tracking_env
from plat.envs.tracking import MotionTrackingEnv, ResetNoise

__all__ = [
    "COMMAND_KEYS",
    "G1",
    "ROBOT_KEYS",
    "BatchedPhysics",
    "FootContacts",
    "ForwardKinematics",
    "MotionLibrary",
    "MotionTrackingEnv",
    "ResetNoise",
    "Robot",
    "TaskConfig",
    "entry_shapes",
    "goal_keys",
    "make_keyframe_env",
    "make_tracking_env",
    "observation_size",
    "privileged_keys",
    "robot_centric_goal",
]
