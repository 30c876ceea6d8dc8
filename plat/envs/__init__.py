"""The simulated robot and the tasks made of it."""

import warnings
from typing import TYPE_CHECKING

import plat.motions
import plat.robots
from plat.lazy import lazy

if TYPE_CHECKING:
    from plat.envs.configs import DistillationTaskConfig, KeyframeTaskConfig, SimulationConfig, TrackingTaskConfig
    from plat.envs.goals import robot_centric_goal
    from plat.envs.physics import BatchedPhysics
    from plat.envs.settings import ResetNoise
    from plat.envs.state import GeneralizedState, joint_target
    from plat.envs.tasks import make_keyframe_env, make_tracking_env
    from plat.envs.tracking import MotionTrackingEnv
    from plat.spec.observation import (
        COMMAND_KEYS,
        ROBOT_KEYS,
        entry_shapes,
        goal_keys,
        observation_size,
        privileged_keys,
    )

__all__ = [
    "COMMAND_KEYS",
    "ROBOT_KEYS",
    "BatchedPhysics",
    "DistillationTaskConfig",
    "GeneralizedState",
    "KeyframeTaskConfig",
    "MotionTrackingEnv",
    "ResetNoise",
    "SimulationConfig",
    "TrackingTaskConfig",
    "entry_shapes",
    "goal_keys",
    "joint_target",
    "make_keyframe_env",
    "make_tracking_env",
    "observation_size",
    "privileged_keys",
    "robot_centric_goal",
]

_MOVED = dict.fromkeys(plat.robots.__all__, plat.robots) | {"MotionLibrary": plat.motions}


def _moved(name: str) -> object:
    if name == "TaskConfig":
        raise AttributeError(
            "plat.envs.TaskConfig is split into TrackingTaskConfig, DistillationTaskConfig and KeyframeTaskConfig"
        )
    if name not in _MOVED:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    new = _MOVED[name]
    message = f"plat.envs.{name} is now {new.__name__}.{name}; the old name is removed in version 0.3"
    warnings.warn(message, FutureWarning, stacklevel=3)
    return getattr(new, name)


lazy(__name__, _moved)
