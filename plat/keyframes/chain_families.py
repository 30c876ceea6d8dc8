"""Families of authored chains: what is drawn of their poses, how far apart they are, and what is commanded."""

import math
from dataclasses import dataclass
from typing import Literal

from plat.spec.proportions import in_proportion

__all__ = ["AHEAD", "CHAIN_LENGTH", "FAMILY_TABLE", "INSIDE", "MIDDLE", "RESTING", "TRIES", "ChainFamily"]

CHAIN_LENGTH = 5
"""Keyframes of a chain."""

MIDDLE = (0.2, 0.8)
"""Shares of a joint's range between which :attr:`ChainFamily.arms` are drawn."""

AHEAD = 0.1
"""How far before the root :attr:`ChainFamily.hands_ahead` are at least (m)."""

INSIDE = 0.02
"""How deep links may be in each other in a pose with :attr:`ChainFamily.hands_ahead` (m): less than this."""

TRIES = 64
"""Poses that are drawn at a time for one with the hands ahead."""


RESTING = (0.6, 0.1, 0.55)
"""What counts as at rest in a motion, in training and in evaluation: no joint faster than this (rad/s), nor the root
(m/s), and the root higher (m), of a robot whose root stands at 0.76 m."""


@dataclass(frozen=True)
class ChainFamily:
    """Family of chains of keyframes that begin in the standing pose.

    A pose is the standing one, or one of a motion that rests, changed by all that is given.

    Args:
        name: of the family.
        resting: begin from poses of motions.
        same: one pose all along.
        apart: largest horizontal distance (m) from the origin along an axis, and turn (rad).
        way: shortest and longest horizontal distance from the keyframe before (m).
        turn: largest turn from the keyframe before (rad).
        out_of_reach: the way is too long for the time. In training, half of these chains command each keyframe three
            times.
        lowered: least and most that the pelvis is lowered, with the feet in place (m), of a robot whose root stands at
            0.76 m; of others in proportion.
        lean: largest lean of the trunk in a lowered pose (rad).
        arms: draw all joints but those of the legs. Nothing looks at links that are in each other then, or at balance.
        hands_ahead: draw them until both hands are ahead of the body and above its root, and no two links are
            :data:`INSIDE` or more in each other, of the pairs that the robot's description lets collide.
        commands: what is commanded of each pose: all of it; positions of the hands; of hands and trunk, which carries
            the head; or the root's horizontal position and orientation.
        length: number of keyframes.
        interval: shortest and longest time between keyframes (s); infinite for the longest command of the policy.
        hold: seconds in the last keyframe when a policy is scored.
        bodies: largest distance of a commanded body for a keyframe to be reached (m); None for that of
            :class:`plat.control.ReachLimits`.
        trained: whether it is drawn in training.
        scored: whether it is drawn in evaluation.
    """

    name: str
    resting: bool = False
    same: bool = False
    apart: tuple[float, float] | None = None
    way: tuple[float, float] | None = None
    turn: float = 0.0
    out_of_reach: bool = False
    lowered: tuple[float, float] | None = None
    lean: float = 0.0
    arms: bool = False
    hands_ahead: bool = False
    commands: Literal["whole", "hands", "hands_and_head", "waypoint"] = "whole"
    length: int = CHAIN_LENGTH
    interval: tuple[float, float] = (0.5, 1.0)
    hold: float = 3.0
    bodies: float | None = None
    trained: bool = True
    scored: bool = True

    def lowered_of(self, root_height: float) -> tuple[float, float] | None:
        """Return :attr:`lowered` for a robot whose root stands at ``root_height`` (m).

        >>> FAMILY_TABLE["crouch"].lowered_of(0.38)
        (0.025, 0.15)
        """
        if self.lowered is None:
            return None
        least, most = self.lowered
        return in_proportion(least, root_height), in_proportion(most, root_height)

    @property
    def needs_hands(self) -> bool:
        """Return whether a robot has to have hands for it."""
        return self.commands in ("hands", "hands_and_head")


_STEP, _FAR = (0.25, 0.5), (1.5, 2.5)

FAMILY_TABLE: dict[str, ChainFamily] = {
    family.name: family
    for family in (
        ChainFamily("hold", resting=True, same=True, hold=10.0),
        ChainFamily("arms", arms=True),
        ChainFamily("poses", resting=True, apart=(0.1, 0.2)),
        ChainFamily("steps", way=_STEP, turn=0.4),
        ChainFamily("crouch", lowered=(0.05, 0.3), lean=0.5),
        ChainFamily("reach", arms=True, hands_ahead=True, commands="hands", bodies=0.05),
        ChainFamily(
            "three_point",
            lowered=(0.0, 0.15),
            lean=0.3,
            arms=True,
            hands_ahead=True,
            commands="hands_and_head",
            bodies=0.1,
        ),
        ChainFamily("waypoint", way=_STEP, turn=0.4, commands="waypoint", trained=False),
        ChainFamily("far", way=_FAR, turn=2.0, out_of_reach=True),
        ChainFamily("far3s", way=_FAR, turn=2.0, interval=(3.0, 3.0), trained=False),
        ChainFamily("distant", way=(0.8, 2.5), turn=2.0, length=2, interval=(1.5, math.inf), scored=False),
    )
}
"""The families by name. This table is the one place that says what they are.

Two samplers read it. :func:`plat.control.author` draws for scores: one pose after another in double precision, crouches
with the center of mass where it is in the standing pose. :func:`plat.tasks.draw_chains` draws for training: thousands
of poses at once, for any legs. Both look at collisions where the hands are ahead, and nowhere else. They stay two, each
with a stream of random numbers of its own: the chains of a seed are what published scores and trained weights refer to.
"""
