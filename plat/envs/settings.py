"""Settings of the simulation."""

from dataclasses import dataclass

from plat.bounds import Bounded, NonNegative

__all__ = ["ResetNoise"]


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
