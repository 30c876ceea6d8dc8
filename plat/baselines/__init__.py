"""Released dense trackers as policies of plat's environments, each with its own motor gains and observation."""

from typing import TYPE_CHECKING

from plat.lazy import lazy

if TYPE_CHECKING:
    from plat.baselines.catalog import CATALOG, Baseline, identify
    from plat.baselines.follow import follow
    from plat.baselines.onnx import OnnxPolicy
    from plat.baselines.protomotions import ProtoMotions
    from plat.baselines.released import ReleasedTrackers
    from plat.baselines.sonic import Sonic, Sonic11, sonic_robot
    from plat.baselines.tracker import Tracker, tuned_robot
    from plat.baselines.tracker_reference import TrackerReference
    from plat.baselines.twist2 import Twist2, twist2_robot
    from plat.baselines.wbc import Wbc
    from plat.baselines.yahmp import Yahmp
else:
    lazy(__name__)

__all__ = [
    "CATALOG",
    "Baseline",
    "OnnxPolicy",
    "ProtoMotions",
    "ReleasedTrackers",
    "Sonic",
    "Sonic11",
    "Tracker",
    "TrackerReference",
    "Twist2",
    "Wbc",
    "Yahmp",
    "follow",
    "identify",
    "sonic_robot",
    "tuned_robot",
    "twist2_robot",
]
