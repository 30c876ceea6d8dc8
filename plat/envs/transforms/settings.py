"""Settings of the transforms, apart from them so that a command line can show them without torch."""

from dataclasses import dataclass

__all__ = ["NoiseLevels", "RandomizationRanges", "TerminationLimits", "TrackingLimits", "TrackingTerm"]


@dataclass(frozen=True)
class NoiseLevels:
    """Half widths of the uniform noise on measured entries."""

    joint_pos: float = 0.01
    """joint angles (rad)"""
    joint_vel: float = 0.5
    """joint velocities (rad/s)"""
    root_ang_vel_b: float = 0.2
    """angular velocity of the root (rad/s)"""
    root_lin_vel_b: float = 0.1
    """linear velocity of the root (m/s), which a real robot can only estimate"""
    gravity_b: float = 0.05
    """components of the direction of gravity"""


@dataclass(frozen=True)
class RandomizationRanges:
    """Ranges of domain randomization, sampled uniformly at each reset. A range of width 0 switches its term off."""

    foot_friction: tuple[float, float] = (0.3, 1.2)
    """sliding friction of the soles"""
    torso_com: tuple[float, float, float] = (0.025, 0.05, 0.05)
    """half widths of the shift of the anchor body's center of mass (m)"""
    encoder_bias: float = 0.01
    """half width of the constant error of each joint encoder (rad)"""
    motor_gain: float = 0.1
    """half width of the relative error of each joint's stiffness and damping"""
    control_delay: float = 0.5
    """fraction of the robots whose targets arrive one control step late"""
    push_interval: tuple[float, float] = (1.0, 3.0)
    """seconds between pushes"""
    push_lin_vel: tuple[float, float, float] = (0.5, 0.5, 0.2)
    """half widths of the change of root velocity by a push (m/s, world)"""
    push_ang_vel: tuple[float, float, float] = (0.52, 0.52, 0.78)
    """half widths of the change of root angular velocity by a push (rad/s, root frame)"""


@dataclass(frozen=True)
class TrackingLimits:
    """Termination thresholds of dense tracking."""

    anchor_height: float = 0.25
    """error of the anchor's height (m)"""
    anchor_tilt: float = 0.8
    """error of the vertical component of gravity in the anchor's frame"""
    end_effector_height: float = 0.25
    """error of the height of an end effector (m)"""


@dataclass(frozen=True)
class TerminationLimits:
    """Termination thresholds of a timed keyframe command."""

    anchor_height: float = 0.25
    """error of the anchor's height (m), in an arrival window"""
    anchor_rot_squared: float = 1.0
    """squared error of the anchor's orientation (rad^2), in an arrival window"""
    end_effector_height: float = 0.25
    """error of the height of an end effector (m), in an arrival window"""
    root_height: float = 0.25
    """error of the root's height that counts as a fall (m)"""
    root_tilt: float = 0.8
    """error of the vertical component of gravity in the root's frame that counts as a fall"""


@dataclass(frozen=True)
class TrackingTerm:
    """Tracking term of a reward: ``weight * exp(-squared_error / scale**2)``."""

    weight: float
    """factor; 0 leaves the term out"""
    scale: float
    """error at which the term has fallen to 1/e, in the unit of the error"""
