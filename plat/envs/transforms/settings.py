"""Settings of the transforms, apart from them so that a command line can show them without torch."""

from dataclasses import dataclass
from typing import Annotated, TypeAlias

from plat.bounds import Ascending, Bounded, Fraction, NonNegative, Positive, Range, Within

__all__ = [
    "ROBOT_RANGES",
    "NoiseLevels",
    "RandomizationRanges",
    "TerminationLimits",
    "TrackingLimits",
    "TrackingTerm",
    "robot_ranges",
]

Limit: TypeAlias = Annotated[float, Range(0, above=True, infinite=True)]
"""Threshold; infinity switches it off."""
Widths: TypeAlias = tuple[NonNegative, NonNegative, NonNegative]
"""Half widths along three axes."""


@dataclass(frozen=True)
class NoiseLevels(Bounded):
    """Half widths of the uniform noise on measured entries."""

    joint_pos: NonNegative = 0.01
    """joint angles (rad)"""
    joint_vel: NonNegative = 0.5
    """joint velocities (rad/s)"""
    root_ang_vel_b: NonNegative = 0.2
    """angular velocity of the root (rad/s)"""
    root_lin_vel_b: NonNegative = 0.1
    """linear velocity of the root (m/s), which a real robot can only estimate"""
    gravity_b: NonNegative = 0.05
    """components of the direction of gravity"""

    def scaled(self, strength: float) -> "NoiseLevels":
        """Return these levels times a factor."""
        return NoiseLevels(**{name: strength * width for name, width in vars(self).items()})


@dataclass(frozen=True)
class RandomizationRanges(Bounded):
    """Ranges of domain randomization, sampled uniformly: in training at each reset, in evaluation for each motion.

    A half width or fraction of 0 leaves a quantity as the robot has it. Two equal ends are one value for all robots.
    """

    foot_friction: Within | None = (0.3, 1.2)
    """sliding friction of the soles; none leaves that of the robot"""
    torso_com: Widths = (0.025, 0.05, 0.05)
    """half widths of the shift of the anchor body's center of mass (m)"""
    encoder_bias: NonNegative = 0.01
    """half width of the constant error of each joint encoder (rad)"""
    motor_gain: Annotated[float, Range(0, 0.99)] = 0.1
    """half width of the relative error of each joint's stiffness and damping"""
    control_delay: Fraction = 0.5
    """fraction of the robots whose targets arrive late"""
    longer_delay: Fraction = 0.0
    """fraction of these whose targets arrive two control steps late, not one"""
    torso_mass: NonNegative = 0.0
    """half width of the change of the anchor body's mass (kg), half of that mass at most"""
    gyro_bias: NonNegative = 0.0
    """half width of the constant error of the measured angular velocity (rad/s), each axis"""
    velocity_bias: NonNegative = 0.0
    """half width of the slow error of the estimated linear velocity (m/s), each axis"""
    position_drift: NonNegative = 0.0
    """half width of the drift of the estimated position along the floor (m/m), each axis"""
    heading_drift: NonNegative = 0.0
    """half width of the drift of the estimated heading (rad/s)"""
    height_error: NonNegative = 0.0
    """half width of the constant error of the estimated height (m)"""
    push_interval: Annotated[tuple[Positive, Positive], Ascending()] = (1.0, 3.0)
    """seconds between pushes"""
    push_lin_vel: Widths = (0.5, 0.5, 0.2)
    """half widths of the change of root velocity by a push (m/s, world)"""
    push_ang_vel: Widths = (0.52, 0.52, 0.78)
    """half widths of the change of root angular velocity by a push (rad/s, root frame)"""

    def scaled(self, strength: float) -> "RandomizationRanges":
        """Return ranges narrowed by a factor from 0 to 1 (these).

        At 0 that is the nominal robot, but for a friction of 1 where one is drawn: the G1's own soles have 0.8.
        """
        friction = self.foot_friction
        if friction is not None:
            low, high = friction
            friction = (1 - strength + strength * low, 1 - strength + strength * high)
        return RandomizationRanges(
            foot_friction=friction,
            torso_com=_scaled(self.torso_com, strength),
            encoder_bias=strength * self.encoder_bias,
            motor_gain=strength * self.motor_gain,
            control_delay=strength * self.control_delay,
            longer_delay=self.longer_delay,
            torso_mass=strength * self.torso_mass,
            gyro_bias=strength * self.gyro_bias,
            velocity_bias=strength * self.velocity_bias,
            position_drift=strength * self.position_drift,
            heading_drift=strength * self.heading_drift,
            height_error=strength * self.height_error,
            push_interval=self.push_interval,
            push_lin_vel=_scaled(self.push_lin_vel, strength),
            push_ang_vel=_scaled(self.push_ang_vel, strength),
        )


ROBOT_RANGES = RandomizationRanges(
    motor_gain=0.2,
    control_delay=0.67,
    longer_delay=0.5,
    torso_mass=2.0,
    gyro_bias=0.05,
    velocity_bias=0.1,
    position_drift=0.04,
    heading_drift=0.003,
    height_error=0.01,
)
"""Full set, for a policy that is to run on a robot: delays of 0 to 2 control steps, motors within 20 %, a load, and the
errors of :class:`plat.deploy.StateEstimator`, somewhat larger than ``benchmarks/odometry.py`` measures them."""


def robot_ranges(strength: float) -> RandomizationRanges | None:
    """Return :data:`ROBOT_RANGES` narrowed to a strength; None at 0, where nothing is drawn.

    They narrow to a friction of 1, and not to the G1's own of 0.8, which it has where nothing is drawn.

    >>> robot_ranges(0.0) is None, robot_ranges(0.5).torso_mass
    (True, 1.0)
    """
    return ROBOT_RANGES.scaled(strength) if strength else None


def _scaled(widths: tuple[float, float, float], factor: float) -> tuple[float, float, float]:
    first, second, third = widths
    return factor * first, factor * second, factor * third


@dataclass(frozen=True)
class TrackingLimits(Bounded):
    """Termination thresholds of dense tracking."""

    anchor_height: Limit = 0.25
    """error of the anchor's height (m)"""
    anchor_tilt: Limit = 0.8
    """error of the vertical component of gravity in the anchor's frame"""
    end_effector_height: Limit = 0.25
    """error of the height of an end effector (m)"""


@dataclass(frozen=True)
class TerminationLimits(Bounded):
    """Termination thresholds of a timed keyframe command."""

    anchor_height: Limit = 0.25
    """error of the anchor's height (m), in an arrival window"""
    anchor_rot_squared: Limit = 1.0
    """squared error of the anchor's orientation (rad^2), in an arrival window"""
    end_effector_height: Limit = 0.25
    """error of the height of an end effector (m), in an arrival window"""
    root_height: Limit = 0.25
    """error of the root's height that counts as a fall (m)"""
    root_tilt: Limit = 0.8
    """error of the vertical component of gravity in the root's frame that counts as a fall"""


@dataclass(frozen=True)
class TrackingTerm(Bounded):
    """Tracking term of a reward: ``weight * exp(-squared_error / scale**2)``."""

    weight: NonNegative
    """factor; 0 leaves the term out"""
    scale: Positive
    """error at which the term has fallen to 1/e, in the unit of the error"""
