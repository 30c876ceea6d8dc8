"""Costs in time or memory: a loss step, the deployed policy, imports, the motion library."""

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch

from plat.collectors import PrivilegedGoals
from plat.control import Simulator
from plat.deploy import PolicyRunner
from plat.envs import make_keyframe_env
from plat.errors import BundleError
from plat.export import export_bundle
from plat.keyframes import standing
from plat.modules import LatentPolicy
from plat.motions import MotionClip, MotionLibrary, save_motions
from plat.objectives import LatentImitationLoss, autocast
from plat.robots import G1

__all__ = ["Cost", "costs", "write_motions"]

_WINDOWS = 2048
_CALLS = 1000
_WEIGHTS = Path(__file__).parents[1] / "plat" / "weights" / "plat"
_IMPORT = "import time; began = time.perf_counter(); import {}; print(time.perf_counter() - began)"
_LOAD = """
import sys, time
from plat.motions import MotionLibrary
from rounds import peak_memory
before, began = peak_memory(), time.perf_counter()
MotionLibrary.load(sys.argv[1])
print(time.perf_counter() - began, peak_memory() - before)
"""


@dataclass(frozen=True)
class Cost:
    """Measurement and the unit of its result."""

    unit: str
    measure: Callable[[], float]


def costs(library: MotionLibrary, folder: Path, library_seconds: float) -> dict[str, Cost]:
    """Return every cost by its name.

    Args:
        library: motions.
        folder: an empty one, for files.
        library_seconds: length of the motion library that is loaded.
    """
    rows = {
        f"stage-2 loss step, {_WINDOWS} windows, every frame": Cost("ms", loss_step(library, stride=1)),
        f"stage-2 loss step, {_WINDOWS} windows, every 5th frame": Cost("ms", loss_step(library, stride=5)),
    }
    try:
        rows["deployed policy, one robot, one core"] = Cost("ms", deployed_policy(_WEIGHTS, folder))
    except BundleError as error:
        print(f"deployed policy: not measured: {error}")
    loads = LibraryLoads(library, folder, library_seconds)
    size = f"library of {library_seconds:,.0f} s"
    return rows | {
        # the best of three: a time of 0.1 s is easily disturbed
        "import plat": Cost("s", lambda: min(import_time("plat") for _ in range(3))),
        "import plat.envs": Cost("s", lambda: import_time("plat.envs")),
        f"{size}, first load": Cost("s", loads.first),
        f"{size}, cached load": Cost("s", loads.cached),
        f"{size}, memory": Cost("MB", lambda: loads.megabytes),
    }


def loss_step(library: MotionLibrary, stride: int, windows: int = _WINDOWS) -> Callable[[], float]:
    """Return the timing (ms) of forward and backward of stage 2's loss, windows of up to 51 frames."""
    states = PrivilegedGoals(library, stride)(make_keyframe_env(library, windows).reset())
    states["expert_action"] = torch.randn(windows, G1.num_joints)
    student = LatentPolicy(G1)
    loss = LatentImitationLoss(student.training_graph())

    def measure() -> float:
        student.zero_grad()
        began = time.perf_counter()
        with autocast("cpu", "auto"):
            losses = loss(states)
        (losses["loss_posterior"] + losses["loss_prior"] + losses["loss_kl"]).backward()
        return 1e3 * (time.perf_counter() - began)

    return measure


def deployed_policy(run: Path, folder: Path) -> Callable[[], float]:
    """Return the timing (ms) of a run's exported policy on one thread: from state and keyframe to joint targets.

    Raises:
        BundleError: when a package that exports or runs it is not installed.
    """
    export_bundle(run, folder / "bundle")
    runner = PolicyRunner(folder / "bundle")
    simulator, keyframe = Simulator(G1.model()), standing(G1)
    simulator.reset(keyframe)
    state = simulator.state()

    def measure() -> float:
        began = time.perf_counter()
        for _ in range(_CALLS):
            runner(state, keyframe, 10)
        return 1e3 * (time.perf_counter() - began) / _CALLS

    return measure


def import_time(module: str) -> float:
    """Measure the seconds that an import takes in a new interpreter."""
    return _in_new_process(_IMPORT.format(module))[0]


class LibraryLoads:
    """Loads of a long library in new processes, with a separate cache."""

    def __init__(self, library: MotionLibrary, folder: Path, seconds: float):
        self._motions, self._cache = folder / "motions", folder / "cache"
        write_motions(self._motions, library, seconds)
        self.megabytes = 0.0
        """How far the last :meth:`first` raised the peak of its process's memory."""

    def first(self) -> float:
        """Measure the seconds of a load with an empty cache."""
        shutil.rmtree(self._cache, ignore_errors=True)
        seconds, self.megabytes = self._load()
        return seconds

    def cached(self) -> float:
        """Measure the seconds of a load after another."""
        return self._load()[0]

    def _load(self) -> list[float]:
        return _in_new_process(_LOAD, str(self._motions), PLAT_CACHE_DIR=str(self._cache))


def write_motions(folder: Path, library: MotionLibrary, seconds: float) -> None:
    """Fill a folder with motion files that repeat a library's clips until they last long enough."""
    frames = library.frames
    qpos = torch.cat((frames["keypoint_pos"][:, 0], frames["keypoint_quat"][:, 0], frames["joint_pos"]), -1).numpy()
    clips = [
        MotionClip(name, qpos[start : start + length], 1 / library.dt)
        for name, start, length in zip(
            library.clip_names, library.clip_start.tolist(), library.clip_length.tolist(), strict=True
        )
    ]
    folder.mkdir()
    total, number = 0.0, 0
    while total < seconds:
        part: list[MotionClip] = []
        for clip in clips:
            if total < seconds:
                part.append(clip)
                total += clip.duration
        save_motions(folder / f"{number:05d}.npz", part)
        number += 1


def _in_new_process(program: str, *arguments: str, **environment: str) -> list[float]:
    """Run a Python program in a new process and return the numbers that it prints; it can import from this folder."""
    paths = [str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")]
    environment["PYTHONPATH"] = os.pathsep.join(path for path in paths if path)
    command = [sys.executable, "-c", program, *arguments]
    out = subprocess.run(command, env=os.environ | environment, stdout=subprocess.PIPE, text=True, check=True)
    return [float(number) for number in out.stdout.split()]
