"""Settings of the last line of defense."""

from dataclasses import dataclass
from typing import Annotated

from plat.bounds import Bounded, Fraction, NonNegative, Positive, Range

__all__ = ["SafetySettings"]


@dataclass(frozen=True)
class SafetySettings(Bounded):
    """Settings of the safe runner. Defaults let every shipped policy pass and were tried in simulation only."""

    range_margin: NonNegative = 0.0
    """distance that targets keep from the ends of the joints' ranges (rad)"""
    torque: Annotated[float, Range(0, 1, above=True)] = 1.0
    """share of each motor's largest torque that a target may ask for"""
    rate: Positive = 30.0
    """largest speed of a target (rad/s)"""
    tilt: Annotated[float, Range(0, 3.2, above=True)] = 1.0
    """angle between the root's z axis and the vertical that is a fall (rad)"""
    height: NonNegative | None = None
    """height of the root below which it is a fall (m); None: 0.3 m of a standing height of 0.76"""
    temperature: Positive = 90.0
    """temperature of a motor at which it stops (°C)"""
    late: Positive = 0.045
    """age of a state from which on the targets are held (s)"""
    missing: Positive = 0.2
    """age of a state from which on the motors only damp (s)"""
    frozen: Annotated[int, Range(2)] = 5
    """states in a row, equal to the last digit, that are no measurement"""
    settle: Positive = 1.0
    """seconds that the robot must be still before anything moves, where its state is estimated"""
    acceleration: Positive = 200.0
    """largest specific force that an accelerometer reads (m/s²)"""
    range_excess: NonNegative = 0.3
    """how far outside its range a joint's angle may be measured (rad)"""
    joint_speed: Positive = 60.0
    """largest joint velocity that is a measurement (rad/s)"""
    root_speed: Positive = 15.0
    """largest velocity of the root that is a measurement (m/s)"""
    turn_speed: Positive = 40.0
    """largest angular velocity of the root that is a measurement (rad/s)"""
    ramp: Positive = 3.0
    """seconds from the pose it stands in to the start pose"""
    hold: NonNegative = 1.0
    """seconds to hold the last keyframe"""
    stand: Positive = 1.0
    """seconds from there to the default pose"""
    damping: Annotated[float, Range(0, 10, above=True)] = 1.0
    """factor on the motors' damping gains in damping mode"""
    doubt: Fraction = 0.5
    """share of bad states within the last second that ends in damping mode"""
