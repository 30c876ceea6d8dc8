"""Settings of the simulation, and of what counts as reached in it."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

from plat.bounds import Bounded, NonNegative, Positive
from plat.envs.transforms.settings import TerminationLimits
from plat.errors import ConfigError
from plat.extras import require
from plat.spec.proportions import in_proportion

__all__ = ["HOLD", "PhysicsName", "ReachLimits", "ResetNoise", "check_physics"]

PhysicsName: TypeAlias = Literal["mujoco", "warp"]
"""MuJoCo on the CPU, or MuJoCo Warp on a GPU."""
HOLD = 3.0
"""Seconds of the hold after the last arrival where a person is told the outcome. A robot that arrives out of balance
takes one to two seconds to lie down.
"""


def check_physics(name: PhysicsName) -> None:
    """Raise an error for a physics whose package is not installed.

    Raises:
        ConfigError: saying what to install.

    >>> check_physics("mujoco")
    """
    if name == "warp":
        require("warp", "--physics warp needs", "warp", "mujoco_warp", error=ConfigError)


@dataclass(frozen=True)
class ResetNoise(Bounded):
    """Reset noise: half widths of the uniform noise on the reference state at an episode's start."""

    root_pos_xy: NonNegative = 0.2
    """horizontal position of the root (m)"""
    root_pos_z: NonNegative = 0.01
    """height of the root (m)"""
    roll_pitch: NonNegative = 0.1
    """roll and pitch of the root (rad)"""
    yaw: NonNegative = 0.2
    """heading (rad)"""
    root_lin_vel_xy: NonNegative = 0.5
    """horizontal velocity of the root (m/s)"""
    root_lin_vel_z: NonNegative = 0.2
    """vertical velocity of the root (m/s)"""
    root_ang_vel_rp: NonNegative = 0.52
    """roll and pitch rate (rad/s)"""
    root_ang_vel_yaw: NonNegative = 0.78
    """yaw rate (rad/s)"""
    joint_pos: NonNegative = 0.1
    """joint angles (rad)"""


@dataclass(frozen=True)
class ReachLimits(Bounded):
    """When a keyframe is reached, when a robot has fallen, and when it steps in a hold."""

    root: Positive = 0.2
    """distance of the root at arrival (m)"""
    joints: Positive = 0.2
    """mean absolute joint error at arrival (rad)"""
    bodies: Positive = 0.2
    """largest distance of a commanded body at arrival (m), of a partial keyframe"""
    turn: Positive = 0.2
    """angle of the root at arrival (rad), of a partial keyframe"""
    fallen_height: Positive | None = None
    """a lower pelvis has fallen (m), unless commanded; None: 0.4 m of a standing height of 0.76"""
    fallen_tilt: Positive = 0.7
    """so much more tilt than commanded is a fall, in gravity's component along the root's z"""
    settling: NonNegative = 1.0
    """seconds of a hold before the feet are watched"""
    foot_travel: Positive = 0.03
    """a foot that moves further from its place in a hold has stepped (m)"""
    window: TerminationLimits = TerminationLimits()
    """thresholds of TKS@3, for every step of the arrival window"""

    def fallen_below(self, root_height: float) -> float:
        """Return the height (m) below which the root of a robot that stands at ``root_height`` (m) has fallen.

        >>> ReachLimits().fallen_below(0.76), ReachLimits().fallen_below(0.38)
        (0.4, 0.2)
        >>> ReachLimits(fallen_height=0.3).fallen_below(0.38)
        0.3
        """
        return in_proportion(0.4, root_height) if self.fallen_height is None else self.fallen_height
