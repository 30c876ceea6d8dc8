import os
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tensordict.nn import TensorDictModuleBase

from plat.keyframes import KeyframeSequence
from plat.robots import G1
from plat.runs import load_policy
from plat.studio.timeline import Timeline

if TYPE_CHECKING:
    from playwright.sync_api import Browser

WEIGHTS = Path(__file__).parents[2] / "plat" / "weights"


@pytest.fixture(scope="session")
def policies() -> dict[str, TensorDictModuleBase]:
    """The committed weights."""
    return {name: load_policy(WEIGHTS / name).deployed() for name in ("plat", "expert")}


BROWSERS = ("chromium", "chromium-browser", "google-chrome")
# as on a machine without a GPU: the scene is drawn by SwiftShader, and all else without WebGL
FLAGS = ("--no-sandbox", "--enable-unsafe-swiftshader")


@pytest.fixture(scope="module")  # not longer: while it is open, asyncio.run() of other tests is refused
def browser() -> "Iterator[Browser]":
    """A headless Chromium, the system's own; skips where there is none."""
    playwright = pytest.importorskip("playwright.sync_api", reason="no playwright: pip install playwright")
    path = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if path is None:
        pytest.skip(f"no browser: none of {', '.join(BROWSERS)} is installed")
    with playwright.sync_playwright() as driver:
        try:
            browser = driver.chromium.launch(executable_path=path, args=FLAGS)
        except playwright.Error as error:
            pytest.skip(f"{path} does not start: {error.message.splitlines()[0]}")
        yield browser
        browser.close()


def node_modules() -> Path:
    """The folder with the static page's libraries: by default the one that ``make test`` makes where there is npm."""
    return Path(os.environ.get("PLAT_NODE_MODULES", Path(sys.prefix) / "node_modules"))


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
