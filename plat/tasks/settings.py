"""Settings of the tasks, apart from them so that a command line can show them without torch."""

from dataclasses import dataclass
from typing import Annotated

from plat.bounds import Bounded, Count, Fraction, NonNegative, NotEmpty
from plat.errors import ConfigError
from plat.keyframes.chain_families import FAMILY_TABLE

__all__ = ["CHAIN_FAMILIES", "AuthoredCosts", "TimedKeyframesConfig", "TrackingCosts"]


@dataclass(frozen=True)
class TrackingCosts(Bounded):
    """Weights of the distances from a reference."""

    root_pos: NonNegative = 2.0
    """of the root's position (m)"""
    root_rot: NonNegative = 1.0
    """of its orientation (rad)"""
    joint_pos: NonNegative = 3.0
    """of the joint angles, mean over joints (rad)"""
    root_lin_vel: NonNegative = 0.2
    """of the root's velocity (m/s)"""
    root_ang_vel: NonNegative = 0.05
    """of its angular velocity, mean over axes (rad/s)"""
    joint_vel: NonNegative = 0.03
    """of the joint velocities, mean over joints (rad/s)"""
    bodies: NonNegative = 2.0
    """of the bodies that a partial keyframe commands, mean over them (m)"""
    end_effectors: NonNegative = 0.0
    """of the end effectors, mean over them (m); of a whole keyframe in its arrival window"""
    miss: NonNegative = 0.0
    """of errors beyond 0.6 of the thresholds of TKS, in thresholds, in an arrival window"""

    def check_dense(self, what: str) -> None:
        """Raise an error for another weight than the default that costs nothing along a dense reference.

        Args:
            what: holds these weights; begins the message.

        Raises:
            ConfigError: for ``bodies``, which partial keyframes command.
        """
        if self.bodies != TrackingCosts.bodies:
            why = "it is of partial keyframes, and a dense reference has none"
            raise ConfigError(f"{what}.bodies is {self.bodies:g}, expected {TrackingCosts.bodies:g}: {why}")


@dataclass(frozen=True)
class AuthoredCosts(Bounded):
    """Weights where there is no reference but the keyframe."""

    underway: NonNegative = 0.15
    """pull to the line between keyframes before the arrival window, as a share of the pull in it"""
    height: NonNegative = 1.0
    """of the root's height above or below that line (m)"""
    root_lin_vel: NonNegative = 0.02
    """of the root's speed (m/s)"""
    root_ang_vel: NonNegative = 0.01
    """of its angular velocity, mean over axes (rad/s)"""
    joint_vel: NonNegative = 0.01
    """of the joint velocities, mean over joints (rad/s)"""
    not_commanded: NonNegative = 0.05
    """pull to the line of what a partial keyframe leaves open, as a share of that in the window"""
    around: NonNegative = 1.0
    """both pulls where the line leads around the robot's own arms, as a share of the window's"""
    lean: NonNegative = 3.0
    """of leaning more than 0.3 further than the line (difference of unit vectors along gravity)"""
    still: NonNegative = 0.1
    """of the joint velocities while a pose is held, mean over joints (rad/s)"""
    balance: NonNegative = 4.0
    """of being out of balance while a pose is held (m)"""
    arrival: NonNegative = 0.0
    """of the root's speed in the arrival window of what is within reach (m/s)"""


CHAIN_FAMILIES = tuple(name for name, family in FAMILY_TABLE.items() if family.trained)
"""Names of the families of authored chains that are drawn in training, see :func:`draw_chains`."""


@dataclass(frozen=True)
class TimedKeyframesConfig(Bounded):
    """Where keyframes come from and what missing them costs."""

    authored: Fraction = 0.5
    """share of the episodes with authored keyframes; the others follow motions"""
    families: Annotated[tuple[str, ...], NotEmpty()] = CHAIN_FAMILIES
    """families of authored keyframes"""
    chains: Count = 1200
    """number of authored chains that are drawn"""
    from_standing: Fraction = 0.6
    """fraction of the authored episodes that start standing; the others start within a motion"""
    shortest: Count = 1
    """control steps of the shortest command along a motion"""
    distant: Fraction = 0.25
    """share of the commands of any length; the others take a second at most"""
    partial: Fraction = 0.0
    """share of the partial keyframes; needs a policy that sees "parts" (--policy.also)"""
    partial_tracking: Fraction = 0.5
    """factor on the cost along a motion while the keyframe commands a part of it"""
    tracking: TrackingCosts = TrackingCosts()
    """weights along a motion, and of a keyframe in its arrival window"""
    underway: AuthoredCosts = AuthoredCosts()
    """weights where there is no reference but the keyframe"""
    uniform_starts: Fraction = 0.3
    """share of the episodes that start anywhere; the others start where failures are"""
    stride: Count = 15
    """a posterior sees every n-th frame on the way to a keyframe, and the last"""
