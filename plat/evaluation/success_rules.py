"""Rules of whole-clip success that others publish by: when a robot that follows a clip has failed."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import get_args

from tensordict import TensorDictBase
from torch import Tensor

from plat.envs.transforms.terminations import TerminationLimits, fallen
from plat.errors import RecordsError
from plat.evaluation.names import RuleName
from plat.json_file import short
from plat.robots.robot import Robot
from plat.rotations import quat_angle

__all__ = ["RULES", "RuleName", "SuccessRule", "rule_named"]


@dataclass(frozen=True)
class SuccessRule:
    """Success rule: a clip is a success if the robot never fails by it, from the first frame to the last.

    Attributes:
        name: in files and tables.
        says: the rule in words.
        failed: function of state, reference and robot: mask ``[N]`` of the robots that have failed.
    """

    name: RuleName
    says: str
    failed: Callable[[TensorDictBase, TensorDictBase, Robot], Tensor]


def _off_height_or_turn(state: TensorDictBase, reference: TensorDictBase, robot: Robot) -> Tensor:
    judged = [0, *robot.end_effector_indices]
    height = (state["keypoint_pos_w"][:, judged, 2] - reference["keypoint_pos_w"][:, judged, 2]).abs().amax(-1)
    turn = quat_angle(state["keypoint_quat_w"][:, 0], reference["keypoint_quat_w"][:, 0])
    return (height > 0.25) | (turn > 1.0)


def _fallen(state: TensorDictBase, reference: TensorDictBase, robot: Robot) -> Tensor:
    return fallen(state, reference, robot, TerminationLimits(root_height=0.25, root_tilt=0.8))


RULES: Mapping[str, SuccessRule] = MappingProxyType(
    {
        rule.name: rule
        for rule in (
            SuccessRule(
                "humantracker",
                "height of pelvis, ankles and wrists within 0.25 m, pelvis orientation within 1 rad, at every frame",
                _off_height_or_turn,
            ),
            SuccessRule(
                "supermimic",
                "height of the pelvis within 0.25 m, vertical component of gravity in its frame within 0.8, "
                "at every frame",
                _fallen,
            ),
        )
    }
)
"""The rules by name."""


def rule_named(name: str) -> SuccessRule:
    """Return a rule by its name.

    Raises:
        RecordsError: when there is none of that name.

    >>> rule_named("supermimic").name
    'supermimic'
    """
    if not isinstance(name, str) or name not in RULES:
        raise RecordsError(f"success rule {short(name)}: expected one of {', '.join(get_args(RuleName))}")
    return RULES[name]
