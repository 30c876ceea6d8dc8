from pathlib import Path

import numpy as np
import pytest
from tensordict.nn import TensorDictModuleBase

from plat.keyframes import KeyframeSequence
from plat.robots import G1
from plat.runs import load_policy
from plat.studio.timeline import Timeline

WEIGHTS = Path(__file__).parents[2] / "plat" / "weights"


@pytest.fixture(scope="session")
def policies() -> dict[str, TensorDictModuleBase]:
    """The committed weights."""
    return {name: load_policy(WEIGHTS / name).deployed() for name in ("plat", "expert")}


def squat() -> np.ndarray:
    """Knees bent, left arm raised, weight where it was."""
    qpos = G1.default_qpos.copy()
    for name, angle in {"hip_pitch": -0.6, "knee": 1.2, "ankle_pitch": -0.6}.items():
        for side in ("left", "right"):
            qpos[7 + G1.joint_names.index(f"{side}_{name}")] = angle
    qpos[7 + G1.joint_names.index("left_shoulder_pitch")] = -1.0
    qpos[2] = 0.68
    return qpos


@pytest.fixture
def sequence() -> KeyframeSequence:
    """Down and up again in a second."""
    timeline = Timeline.empty(G1).inserted(squat(), 0.5, "squat").inserted(G1.default_qpos, 0.5)
    return timeline.sequence()
