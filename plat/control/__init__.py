"""One robot chases timed keyframes in plain MuJoCo, a control step at a time.

The same loop plays a file of keyframes (``plat play``), runs live in the studio, and compares an exported policy with
its original. This interface is stable::

    simulator = Simulator(robot.model())
    chase = Chase(PolicyController(policy, robot), sequence, simulator)
    scorer = KeyframeScorer(robot)
    for step in chase:
        scorer.add(step)
    scores = scorer.scores()
"""

from typing import TYPE_CHECKING

from plat.lazy import lazy

if TYPE_CHECKING:
    from plat.control.authored import FAMILIES, Authored, author, resting_poses
    from plat.control.chase import Chase, ChaseStep, Controller
    from plat.control.chase_playback import record
    from plat.control.feasibility import Concern, Feasibility, FeasibilityLimits
    from plat.control.lead_around import keyframe_around, lead_around
    from plat.control.policy import PolicyController
    from plat.control.pose_errors import PoseComparison, PoseErrors
    from plat.control.scores import (
        FELL,
        LATE_OR_OFF,
        REACHED,
        HoldScore,
        KeyframeScore,
        KeyframeScorer,
        Outcome,
        StepErrors,
        distance_text,
        error_text,
        mean_errors,
        tally,
    )
    from plat.control.sensors import SensorNoise, SensorReading, SimulatedSensors
    from plat.control.simulator import Simulator
    from plat.control.viewer import Viewer
    from plat.envs.settings import HOLD, ReachLimits
else:
    lazy(__name__)

__all__ = [
    "FAMILIES",
    "FELL",
    "HOLD",
    "LATE_OR_OFF",
    "REACHED",
    "Authored",
    "Chase",
    "ChaseStep",
    "Concern",
    "Controller",
    "Feasibility",
    "FeasibilityLimits",
    "HoldScore",
    "KeyframeScore",
    "KeyframeScorer",
    "Outcome",
    "PolicyController",
    "PoseComparison",
    "PoseErrors",
    "ReachLimits",
    "SensorNoise",
    "SensorReading",
    "SimulatedSensors",
    "Simulator",
    "StepErrors",
    "Viewer",
    "author",
    "distance_text",
    "error_text",
    "keyframe_around",
    "lead_around",
    "mean_errors",
    "record",
    "resting_poses",
    "tally",
]
