import os
import tempfile
from pathlib import Path

# before torch is imported: tests run side by side, and threads that fight for cores slow all of them down
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("PLAT_CACHE_DIR", tempfile.mkdtemp(prefix="plat-cache-"))
os.environ.setdefault("WANDB_MODE", "offline")

import numpy as np
import pytest
import torch

import plat.headless

# isort: split

import plat.robots.registry
from plat.motions import MotionClip, MotionLibrary, generate_motions
from plat.robots import G1

TESTS = Path(__file__).parent
SLOW = (
    "benchmarks/",
    "cli/",
    "deploy/test_parity.py",
    "export/test_bundle.py",
    "recipes/",
    "runs/test_run.py",
    "studio/test_browser.py",
    "test_regression.py",
)
"""Tests that train, export or start processes; ``make test-fast`` leaves them out, with those marked one by one."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if TESTS in item.path.parents and item.path.relative_to(TESTS).as_posix().startswith(SLOW):
            item.add_marker("slow")


SHARED = Path(__file__).parents[2] / "shared" / "data"


@pytest.fixture(autouse=True)
def _seed() -> None:
    torch.manual_seed(0)


@pytest.fixture(autouse=True)
def _robots(monkeypatch: pytest.MonkeyPatch) -> None:
    """Robots that a test registers are gone after it."""
    monkeypatch.setattr(plat.robots.registry, "_ROBOTS", dict(plat.robots.registry._ROBOTS))


@pytest.fixture(scope="session")
def library() -> MotionLibrary:
    """Half a minute of generated clips, each of another family."""
    return MotionLibrary.from_clips(generate_motions("train", seconds=30))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Real motions and robot figures, where they are."""
    if not SHARED.exists():
        pytest.skip(f"development data is not at {SHARED}")
    return SHARED


def standing_clip(name: str = "standing", frames: int = 61, fps: float = 30.0) -> MotionClip:
    """The default pose, sliding forward at 0.3 m/s and turning at 0.5 rad/s: every velocity is known."""
    qpos = np.tile(G1.default_qpos, (frames, 1))
    time = np.arange(frames) / fps
    qpos[:, 0] = 0.3 * time
    qpos[:, 3], qpos[:, 6] = np.cos(0.25 * time), np.sin(0.25 * time)
    return MotionClip(name, qpos, fps)
