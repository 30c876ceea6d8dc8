"""Public functions with each argument in turn replaced by a value of another kind.

A value that makes no sense is refused by a PlatError of one line, before something deep inside trips over it; one that
a function can do with may be taken. What is wrong Python, such as an argument that a function does not have, is not
looked at.
"""

import functools
import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import plat
from plat.control import (
    Chase,
    Feasibility,
    PolicyController,
    PoseComparison,
    Simulator,
    author,
    keyframe_around,
    lead_around,
    resting_poses,
)
from plat.envs.transforms import CommandSchedule, Horizon
from plat.errors import PlatError
from plat.evaluation import (
    command_bins,
    command_difficulty,
    compare,
    evaluate,
    evaluate_clips,
    families_of,
    make_evaluation_env,
    play,
    read_manifest,
    report,
    report_clips,
    success_curve,
)
from plat.keyframes import (
    Keyframe,
    KeyframeQueue,
    KeyframeSequence,
    hands_of,
    interpolate,
    keyframe_from_json,
    keyframe_to_json,
    long_intervals,
    long_intervals_of_file,
    only,
    split_long_intervals,
    standing,
)
from plat.modules import PlainPolicy
from plat.motions import MotionLibrary
from plat.robots import G1
from plat.spec.timing import Timing
from tests.conftest import standing_clip

VALUES: Mapping[str, object] = {
    "None": None,
    "an object": object(),
    "a text": "wide",
    "-1": -1,
    "nan": math.nan,
    "a list": [object()],
}


def functions(folder: Path) -> Iterator[tuple[Callable[..., object], dict[str, Any]]]:
    """Yield public functions, each with arguments that are right for it."""
    clip = standing_clip(frames=121)
    library = MotionLibrary.from_clips([clip])
    policy = PlainPolicy(G1).deployed()
    pose = standing(G1)
    sequence = KeyframeSequence(G1, pose, (pose.at(0.5), pose.at(1.0)))
    sequence.save(folder / "keyframes.json")
    (folder / "manifest.csv").write_text("clip,family\na,walk\n")
    timing, horizon = Timing(), Horizon(1, 5)
    schedule = CommandSchedule(library, horizon, 0)
    records = evaluate(policy, library, horizon, num_threads=1)
    clips = evaluate_clips(policy, library, "supermimic", num_threads=1)
    simulator = Simulator(G1.model())
    controller = PolicyController(policy, G1)
    yield plat.load, {"name": "plat-g1", "device": "cpu"}
    # control
    yield author, {"family": "arms", "robot": G1, "count": 1, "seed": 0, "resting": None, "timing": timing}
    yield resting_poses, {"library": library}
    yield keyframe_around, {"before": pose, "after": pose.at(1.0), "robot": G1, "timing": timing}
    yield lead_around, {"sequence": sequence}
    yield Feasibility, {"robot": G1, "limits": None}
    yield Feasibility(G1), {"before": pose, "after": pose.at(1.0)}
    yield Feasibility(G1).sequence, {"keyframes": sequence}
    yield Chase, {"controller": controller, "sequence": sequence, "simulator": simulator, "hold": 0.1}
    yield PolicyController, {"policy": policy, "robot": G1}
    yield PoseComparison, {"robot": G1, "limits": None}
    yield Simulator, {"model": G1.model(), "control_dt": 0.02}
    # evaluation
    yield (
        evaluate,
        {
            "policy": policy,
            "library": library,
            "horizon": horizon,
            "setting": None,
            "clips": [0],
            "seed": 0,
            "num_envs": 1,
            "num_threads": 1,
            "timing": None,
            "partial": None,
            "randomization": None,
            "disturbance": None,
        },
    )
    yield evaluate_clips, {"policy": policy, "library": library, "rule": "supermimic", "num_threads": 1}
    yield report, {"records": records}
    yield report_clips, {"records": clips}
    yield compare, {"ours": records, "theirs": records}
    yield success_curve, {"records": records}
    yield play, {"policy": policy, "library": library, "clip": 0, "horizon": horizon}
    yield make_evaluation_env, {"library": library, "schedule": schedule, "num_envs": 1, "view": None, "setting": None}
    yield command_difficulty, {"library": library, "schedule": schedule}
    yield command_bins, {"library": library, "horizon": "long", "timing": timing, "seed": 0}
    yield families_of, {"clips": ["a"], "families": {"a": "walk"}, "files": [Path("a.npz")]}
    yield read_manifest, {"paths": [folder / "manifest.csv"], "column": "family"}
    # keyframes
    yield standing, {"robot": G1}
    yield hands_of, {"robot": G1}
    yield interpolate, {"before": pose, "after": pose.at(1.0), "time": 0.5}
    yield keyframe_to_json, {"keyframe": pose, "robot": G1}
    yield keyframe_from_json, {"entry": keyframe_to_json(pose, G1), "robot": G1}
    yield long_intervals, {"start": pose, "keyframes": (pose.at(0.5),), "timing": timing}
    yield long_intervals_of_file, {"path": folder / "keyframes.json", "robot": G1, "timing": timing}
    yield split_long_intervals, {"start": pose, "keyframes": (pose.at(0.5),), "timing": timing}
    yield (
        only,
        {
            "robot": G1,
            "time": 1.0,
            "left_hand": None,
            "bodies": {"left_wrist_yaw_link": (0.35, 0.2, 0.95)},
            "joints": None,
            "root": None,
            "height": 0.7,
            "heading": None,
            "base": None,
            "name": None,
        },
    )
    yield Keyframe.from_motion, {"motion": clip, "time": 0.5, "robot": G1}
    yield pose.checked, {"robot": G1}
    yield KeyframeSequence, {"robot": G1, "start": pose, "keyframes": (pose.at(0.5),), "timing": timing}
    yield KeyframeSequence.load, {"path": folder / "keyframes.json", "robot": G1, "timing": timing}
    yield KeyframeSequence.from_motion, {"motion": clip, "times": [0.5], "robot": G1}
    yield sequence.sample, {"time": 0.5}
    yield sequence.command, {"time": 0.5}
    yield KeyframeQueue, {"robot": G1}


def misplaced(folder: Path) -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield a call for each argument of each function and each value, and what it is called."""
    for function, right in functions(folder):
        name = getattr(function, "__qualname__", type(function).__name__)
        function(**right)
        for argument in right:
            for told, value in VALUES.items():
                yield f"{name}({argument}={told})", functools.partial(function, **{**right, argument: value})


def trips(call: Callable[[], object]) -> str:
    """Return how a call trips; empty where it is taken, or refused in one line."""
    try:
        call()
    except PlatError as error:
        return "more than one line" if "\n" in str(error) else ""
    except Exception as error:
        return f"{type(error).__name__}: {str(error).partition(chr(10))[0][:150]}"
    return ""
