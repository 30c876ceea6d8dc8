"""What families of chains need of a robot and of motions; apart from the families, for it brings torch with it."""

from collections.abc import Sized

from plat.keyframes.chain_families import ChainFamily
from plat.keyframes.partial import hands_of
from plat.motions.generation.whole_body import has_six_joint_legs
from plat.robots.robot import Robot

__all__ = ["lacking"]


def lacking(family: ChainFamily, robot: Robot, resting: Sized | None) -> str:
    """Return what a family needs and neither the robot nor the resting poses have; empty when it can be drawn.

    >>> from plat.keyframes.chain_families import FAMILY_TABLE
    >>> from plat.robots import G1
    >>> lacking(FAMILY_TABLE["hold"], G1, None)
    'resting poses: give motions that have some'
    """
    if family.resting and (resting is None or len(resting) == 0):
        return "resting poses: give motions that have some"
    if family.needs_hands and not all(hands_of(robot)):
        return f"hands, of which robot {robot.name!r} has not two"
    if family.lowered is not None and not has_six_joint_legs(robot):
        return f"legs of six joints named as those of the G1, which robot {robot.name!r} has not"
    return ""
