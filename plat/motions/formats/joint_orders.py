"""Orders in which programs list joints, and which of them makes poses that people take."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from plat.errors import MotionError
from plat.motions.checks.sides import EXCHANGED, apart
from plat.robots.robot import Robot, without_side
from plat.robots.symmetry import joints_at_zero, other_side

__all__ = [
    "JointOrderError",
    "SidesError",
    "breadth_first",
    "in_robot_order",
    "likely_order",
    "likely_order_of_some",
    "sides_are_exchanged",
    "usual_orders",
    "with_sides_exchanged",
]

# Median and mean absolute deviation (rad) of joints in retargeted motions of people, left side. Measured on 270 clips
# (Bandai-Namco, CMU, HDM05, SIE, ASE, g1-moves); wrists, which they leave at rest, are given more.
_USUAL = {
    "hip_pitch": (-0.24, 0.32),
    "hip_roll": (0.12, 0.16),
    "hip_yaw": (0.10, 0.16),
    "knee": (0.62, 0.33),
    "ankle_pitch": (-0.30, 0.19),
    "ankle_roll": (-0.03, 0.09),
    "waist_yaw": (0.01, 0.11),
    "waist_roll": (0.04, 0.10),
    "waist_pitch": (0.06, 0.16),
    "shoulder_pitch": (-0.04, 0.48),
    "shoulder_roll": (0.38, 0.37),
    "shoulder_yaw": (-0.13, 0.39),
    "elbow": (0.43, 0.53),
    "wrist_roll": (0.0, 0.10),
    "wrist_pitch": (0.0, 0.10),
    "wrist_yaw": (0.0, 0.10),
}
# Axes of these joints with all joints at 0, and the cosine of the angle that they are off at most. What bends the other
# way, such as a knee with negative angles, has other poses.
_PITCH, _AXES = (0.0, 1.0, 0.0), {"roll": (1.0, 0.0, 0.0), "yaw": (0.0, 0.0, 1.0)}
_AS_MEANT = 0.7
_MOST = 6.0
# What a radian beyond the joints' limits costs (summed over joints, mean over frames).
_BEYOND = 20.0
# An order is believed that is this much more likely than the robot's own, and below the second figure it is chance. Of
# 365 clips in the robot's order none is more likely in another one. Of 7,300 readings of them in ten others, either
# side first, 37 lie between the two and none is mistaken. Hips and waists whose axes are listed otherwise look alike.
_SURE, _CHANCE = 3.0, 0.1
_FRAMES = 2_000
# The roll of the left hip over that of the right one (rad, mean): below the first no clip of 365 is, and between the
# two it does not say whether legs are exchanged as arms are.
_LEGS_EXCHANGED, _LEGS_UNDECIDED = -0.25, 0.05
# In so few frames someone may have crossed legs.
_FEW_FRAMES = 15
_LEGS, _WAIST, _WRIST = ("hip", "knee", "ankle"), "waist", "wrist"


class JointOrderError(MotionError):
    """Columns without names whose order its poses leave open."""


class SidesError(JointOrderError):
    """Columns without names of which some have left and right exchanged."""


def in_robot_order(joints: np.ndarray, listed: Sequence[str], robot: Robot) -> np.ndarray:
    """Return columns ``[T, J]`` that are the listed joints, all of a robot's, in the robot's order."""
    return joints[:, [listed.index(joint) for joint in robot.joint_names]]


def breadth_first(robot: Robot) -> list[str]:
    """Return joint names by distance from the root, ties in the robot's own order, as Isaac Lab numbers them."""
    return sorted(robot.joint_names, key=robot.depth)


def usual_orders(robot: Robot) -> Mapping[str, list[str]]:
    """Return the joint names of a robot in other orders than its own, by what they are called.

    >>> from plat.robots import G1
    >>> usual_orders(G1)["in alphabetical order"][:2]
    ['left_ankle_pitch', 'left_ankle_roll']
    """
    names = list(robot.joint_names)
    legs = [name for name in names if any(part in name for part in _LEGS)]
    waist = [name for name in names if _WAIST in name]
    arms = [name for name in names if name not in legs and name not in waist]

    def of_side(listed: list[str], side: str) -> list[str]:
        return [name for name in listed if name.startswith(side)]

    def in_turn(listed: list[str]) -> list[str]:
        pairs = zip(of_side(listed, "left"), of_side(listed, "right"), strict=False)
        return [name for pair in pairs for name in pair]

    orders = {
        "breadth first": breadth_first(robot),
        "in alphabetical order": sorted(names),
        "with the waist first": [*waist, *legs, *arms],
        "with the waist last": [*legs, *arms, *waist],
        "with the arms first": [*arms, *waist, *legs],
        "with arms, then legs, then waist": [*arms, *legs, *waist],
        "with waist, then arms, then legs": [*waist, *arms, *legs],
        "with the wrists last": [name for name in names if _WRIST not in name]
        + [name for name in names if _WRIST in name],
        "with left and right in turn": [*in_turn(legs), *waist, *in_turn(arms)],
        "with one side behind the other": [
            *of_side(legs, "left"),
            *of_side(arms, "left"),
            *waist,
            *of_side(legs, "right"),
            *of_side(arms, "right"),
        ],
    }
    different: dict[str, list[str]] = {}
    for label, order in orders.items():
        # without a waist or wrists some are the same
        if order not in (names, *different.values()) and sorted(order) == sorted(names):
            different[label] = order
    return different


def likely_order(angles: np.ndarray, robot: Robot) -> tuple[list[str], list[str]] | None:
    """Return the joints that columns ``[T, J]`` (rad) are, by the poses that they make, and notes.

    Left and right are not told apart. None for a robot whose usual poses are not known, as of one with other joints or
    axes than the G1's, and for no poses.

    Raises:
        JointOrderError: where another order than the robot's makes the likelier poses, and not by far.
    """
    own = list(robot.joint_names)
    if not _poses_are_known(robot) or not len(angles) or not np.isfinite(angles).all():
        return None
    some = angles[:: max(1, len(angles) // _FRAMES)]
    cost = _costs(some, robot)
    costs = {label: cost(order) for label, order in usual_orders(robot).items()}
    best = min(costs, key=lambda label: costs[label])
    gain = cost(own) - costs[best]
    if gain <= _CHANCE:
        return own, []
    if gain <= _SURE:
        raise JointOrderError(
            f"nothing states the order of its joints, and its poses are as likely with those of robot {robot.name!r} "
            f"as with them {best}; name them, in a header or 'joint_names'"
        )
    return usual_orders(robot)[best], [f"joints numbered {best}: only so are its poses likely"]


def likely_order_of_some(angles: np.ndarray, robot: Robot, kinds: Sequence[Sequence[str]]) -> tuple[list[str], str]:
    """Return all joints of a robot in the order in which columns ``[T, n]`` (rad) have some, and what it is called.

    The name of the robot's own order is empty. Of 365 clips with each of the two kinds of 23 joints none is taken for
    one in another order, and one is doubtful. Of 6,935 readings of them in other orders 97 % are recognized.

    Args:
        angles: of joints that are not all of the robot's.
        robot: whose joints they are.
        kinds: the joints that they may be, each n names.

    Raises:
        JointOrderError: where another order than the robot's makes the likelier poses, and not by far.
    """
    own = list(robot.joint_names)
    if not _poses_are_known(robot) or not len(angles) or not np.isfinite(angles).all():
        return own, ""
    cost = _costs(angles[:: max(1, len(angles) // _FRAMES)], robot)
    orders = {"": own, **usual_orders(robot)}
    costs = {
        label: min(cost([name for name in order if name in kind]) for kind in kinds) for label, order in orders.items()
    }
    best = min(costs, key=lambda label: costs[label])
    gain = costs[""] - costs[best]
    if gain <= _CHANCE:
        return own, ""
    if gain <= _SURE:
        raise JointOrderError(
            f"nothing states the order of its {angles.shape[1]} joints, and its poses are as likely with those of "
            f"robot {robot.name!r} as with them {best}; name them, in a header or 'joint_names'"
        )
    return orders[best], best


def with_sides_exchanged(names: Sequence[str]) -> list[str]:
    """Return names of joints with left for right.

    >>> with_sides_exchanged(["left_knee", "waist_yaw"])
    ['right_knee', 'waist_yaw']
    """
    return [other_side(name) for name in names]


def sides_are_exchanged(radians: np.ndarray, robot: Robot) -> bool:
    """Return whether arms and legs show that left and right are exchanged.

    Args:
        radians: angles ``[T, J]`` in the robot's order.
        robot: whose joints they are.

    Raises:
        SidesError: where those of the arms or of the legs alone are.
    """
    arms, legs = (apart(radians, robot, part) for part in ("shoulder_roll", "hip_roll"))
    if arms is None or legs is None:
        return False
    if arms > EXCHANGED and legs > _LEGS_EXCHANGED:
        return False
    if arms > EXCHANGED or legs > _LEGS_UNDECIDED:
        if len(radians) < _FEW_FRAMES:
            return False
        some, others = ("legs", "arms") if arms > EXCHANGED else ("arms", "legs")
        raise SidesError(
            f"its {some} have left and right exchanged and its {others} do not, if its joints stand in the robot's "
            "order; name them in a header"
        )
    return True


def _poses_are_known(robot: Robot) -> bool:
    """Return whether a robot has the joints of :data:`_USUAL`, and they turn its limbs as they do the G1's."""
    if not all(without_side(name) in _USUAL for name in robot.joint_names):
        return False
    meant = np.array([_AXES.get(name.rsplit("_", 1)[-1], _PITCH) for name in robot.joint_names])
    axis, _ = joints_at_zero(robot)
    return bool(((axis * meant).sum(-1) > _AS_MEANT).all())


def _costs(angles: np.ndarray, robot: Robot) -> Callable[[list[str]], float]:
    """Return what gives minus the log-likelihood of poses if columns are these joints, or those of the other sides."""
    joints = np.array([_USUAL[without_side(name)] for name in robot.joint_names])
    outward = np.array([name.startswith("right") and name.endswith(("roll", "yaw")) for name in robot.joint_names])
    low, high = robot.joint_range.double().numpy().T
    # [column, joint]: what it costs that a column is a joint
    table = np.empty((angles.shape[1], len(robot.joint_names)))
    for joint, (middle, spread) in enumerate(joints):
        middle = -middle if outward[joint] else middle
        table[:, joint] = np.minimum(np.abs(angles - middle) / spread, _MOST).mean(0) + np.log(spread)
        table[:, joint] += _BEYOND * np.maximum(low[joint] - angles, angles - high[joint]).clip(0).mean(0)
    index = {name: number for number, name in enumerate(robot.joint_names)}

    def cost(order: list[str]) -> float:
        exchanged = with_sides_exchanged(order)
        columns = np.arange(len(order))
        return min(
            float(table[columns, [index[name] for name in names]].sum())
            for names in (order, exchanged)
            if all(name in index for name in names)
        )

    return cost
