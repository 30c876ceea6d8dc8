"""Timed keyframes: commands for a robot, in memory and in JSON files.

Needs numpy only. This interface is stable: :class:`Keyframe`, :class:`KeyframeSequence` (``load``, ``save``,
``from_motion``, ``sample``, ``command``), :class:`Command`, :func:`interpolate`, :func:`standing`,
:func:`only`, :class:`Parts` and :func:`split_long_intervals`. The file format is described in ``docs/keyframes.md``.
"""

from plat.keyframes.files import keyframe_from_json, keyframe_to_json
from plat.keyframes.keyframe import Keyframe, RobotJoints, interpolate, standing
from plat.keyframes.partial import hands_of, only
from plat.keyframes.queue import KeyframeQueue
from plat.keyframes.sequence import Command, KeyframeSequence, split_long_intervals
from plat.keyframes.splits import LongInterval, long_intervals, long_intervals_of_file
from plat.spec.parts import Parts

__all__ = [
    "Command",
    "Keyframe",
    "KeyframeQueue",
    "KeyframeSequence",
    "LongInterval",
    "Parts",
    "RobotJoints",
    "hands_of",
    "interpolate",
    "keyframe_from_json",
    "keyframe_to_json",
    "long_intervals",
    "long_intervals_of_file",
    "only",
    "split_long_intervals",
    "standing",
]
