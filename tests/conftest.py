import atexit
import ctypes
import gc
import os
import signal
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from importlib import import_module
from multiprocessing import util
from pathlib import Path
from types import SimpleNamespace

# before torch is imported: tests run side by side, and threads that fight for cores slow all of them down
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("WANDB_MODE", "offline")

import numpy as np
import pytest
import torch

import plat.headless

# isort: split

import plat.robots.registry
from plat.motions import MotionClip, MotionLibrary, generate_motions
from plat.robots import G1
from plat.scratch import Scratch

if "PLAT_CACHE_DIR" not in os.environ:  # processes that tests start inherit it
    cached = Scratch("plat-cache-")
    os.environ["PLAT_CACHE_DIR"] = str(cached.path)
    atexit.register(cached.remove)

# where pytest is loaded, tyro checks its cache at random: one command line in hundreds fails
with suppress(ImportError):
    tyro_cache = import_module("tyro._unsafe_cache")
    if hasattr(tyro_cache, "sys"):
        tyro_cache.sys = SimpleNamespace(modules={})

SLOW = (
    "benchmarks/",
    "cli/",
    "deploy/test_parity.py",
    "evaluation/test_scoring.py::test_commands_do_not_depend_on_the_policy",
    "evaluation/test_scoring.py::test_dense_reference_instead_of_the_keyframe",
    "evaluation/test_scoring.py::test_figures_do_not_depend_on_how_many_robots_there_are",
    "export/test_bundle.py",
    "motions/checks/test_tempo.py::test_what_does_not_walk_has_no_tempo",
    "objectives/test_ppo.py::test_a_latent_residual_learns",
    "objectives/test_ppo.py::test_the_critic_learns_however_slow_the_policy",
    "recipes/",
    "runs/test_run.py",
    "studio/test_browser.py",
    "test_regression.py",
)
"""Tests that take seconds; ``make test-fast`` leaves them out, with those that are marked where they stand."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if item.nodeid.startswith("tests/") and item.nodeid.removeprefix("tests/").startswith(SLOW):
            item.add_marker("slow")


SHARED = Path(__file__).parents[2] / "shared" / "data"


_GROWTH = 256 << 20
_held = 0


@pytest.fixture(autouse=True, scope="module")
def _memory() -> Iterator[None]:
    """Give freed memory back: a process keeps what simulations leave, gigabytes after thousands of tests."""
    global _held
    yield
    with suppress(OSError, AttributeError):  # Linux and its C library alone
        if _resident() - _held > _GROWTH:
            gc.collect()
            ctypes.CDLL(None).malloc_trim(0)
            _held = _resident()


def _resident() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


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


@pytest.fixture(scope="session")
def quick_exports() -> Iterator[None]:
    """ONNX exports of which all but the first read no table of operators: that is a third of each."""
    for package in ("onnx", "onnxscript"):
        pytest.importorskip(package)
    with pytest.MonkeyPatch.context() as patch:
        with suppress(ImportError, AttributeError):  # torch's own, it may change
            registry = import_module("torch.onnx._internal.exporter._registration").ONNXRegistry
            patch.setattr(registry, "from_torchlib", staticmethod(cache(registry.from_torchlib)))
        yield


def standing_clip(name: str = "standing", frames: int = 61, fps: float = 30.0) -> MotionClip:
    """The default pose, sliding forward at 0.3 m/s and turning at 0.5 rad/s: every velocity is known."""
    qpos = np.tile(G1.default_qpos, (frames, 1))
    time = np.arange(frames) / fps
    qpos[:, 0] = 0.3 * time
    qpos[:, 3], qpos[:, 6] = np.cos(0.25 * time), np.sin(0.25 * time)
    return MotionClip(name, qpos, fps)


@pytest.fixture
def killed_at_birth(monkeypatch):
    """Kill each spawned process as soon as it is there, as want of memory does."""
    spawn = util.spawnv_passfds

    def killed(path, args, passfds):
        process = spawn(path, args, passfds)
        if "spawn_main" in b" ".join(map(os.fsencode, args)).decode():
            os.kill(process, signal.SIGKILL)
        return process

    monkeypatch.setattr(util, "spawnv_passfds", killed)
