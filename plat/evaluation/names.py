"""Names of choices in an evaluation, apart from what they stand for so that a command line needs no torch."""

from typing import Literal, TypeAlias

__all__ = ["DisturbanceName", "Interface", "RuleName"]

DisturbanceName: TypeAlias = Literal["push", "friction", "payload", "latency", "motors", "noise"]
"""What a robustness curve goes over, see :data:`plat.evaluation.disturbance.STRENGTHS`."""

Interface: TypeAlias = Literal["next-frame", "line", "cascade"]
"""How a dense tracker is told of a sparse keyframe: as its next reference frame, at rest; by a straight line to it; or
by an interpolated motion that goes on from the robot's velocity (a cascade of planner and tracker)."""

RuleName: TypeAlias = Literal["humantracker", "supermimic"]
"""Rule of whole-clip success, see :data:`plat.evaluation.success_rules.RULES`."""
