"""Tasks as functions of the robot's state, the same for simulated and for imagined robots."""

from typing import TYPE_CHECKING

from plat.lazy import lazy

if TYPE_CHECKING:
    from plat.tasks.chains import KeyframeChains, draw_chains
    from plat.tasks.dense_tracking import DenseTracking
    from plat.tasks.distances import smooth_angle, smooth_length
    from plat.tasks.pose_table import PoseTable
    from plat.tasks.settings import CHAIN_FAMILIES, AuthoredCosts, TimedKeyframesConfig, TrackingCosts
    from plat.tasks.simulated import SimulatedTask
    from plat.tasks.task import Task, robot_entries
    from plat.tasks.timed_keyframes import TimedKeyframes
else:
    lazy(__name__)

__all__ = [
    "CHAIN_FAMILIES",
    "AuthoredCosts",
    "DenseTracking",
    "KeyframeChains",
    "PoseTable",
    "SimulatedTask",
    "Task",
    "TimedKeyframes",
    "TimedKeyframesConfig",
    "TrackingCosts",
    "draw_chains",
    "robot_entries",
    "smooth_angle",
    "smooth_length",
]
