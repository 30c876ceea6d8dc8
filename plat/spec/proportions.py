"""Heights in proportion to a robot."""

__all__ = ["in_proportion"]

_STANDS = 0.76  # m: height of the root that the thresholds of plat are written for


def in_proportion(height: float, root_height: float) -> float:
    """Return a height (m) that is to a robot what another is to one whose root stands at 0.76 m.

    Args:
        height: threshold for a root that stands at 0.76 m, the G1's (m).
        root_height: height of the robot's root in its default pose (m).

    >>> in_proportion(0.4, 0.76), in_proportion(0.4, 0.38)
    (0.4, 0.2)
    """
    return height * (root_height / _STANDS)
