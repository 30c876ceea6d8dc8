"""Large data sets: an hour of motion in one file, and a library of thousands of clips. What do they cost?

python -m tests.campaigns.large                            # an hour at 120 Hz and 10,000 clips: many minutes
python -m tests.campaigns.large --seconds 60 --clips 200   # a part
python -m tests.campaigns.large --only csv

Files are made up. Each is read in a process of its own, at its size and at half of it: work that is quadratic in the
size takes four times as long for all of it as for half. Memory is what the process takes beyond the imports, at most.
"""

import argparse
import os
import pickle
import resource
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

import plat.headless  # noqa: F401
from plat.cli.motion_files import distinct
from plat.motions import MotionClip, MotionLibrary, load_motions, save_csv, save_motions, validate_motions
from plat.motions.retargeting.bvh import read_bvh
from plat.robots import G1
from plat.scratch import Scratch

RATE = 120.0
CLIP_SECONDS = 1.0
"""Length of the clips of a library."""
CLIP_RATE = 30.0
GROWTH = 3.0
"""Times as long as half of it: twice is linear, four times quadratic."""
NOISE = 1.0
"""Seconds of the processor below which growth is not judged."""


@dataclass(frozen=True)
class Cost:
    """What reading took.

    Attributes:
        count: of what was read: frames or clips.
        seconds: of the processor.
        memory: bytes, at most.
    """

    count: int
    seconds: float
    memory: int


def walking(seconds: float, fps: float, name: str = "clip", seed: int = 0) -> MotionClip:
    """Return a made up motion: the robot slides along, its joints swing; no two numbers are the same."""
    frames = round(seconds * fps) + 1
    time_s = np.arange(frames) / fps
    qpos = np.tile(G1.default_qpos.astype(np.float32), (frames, 1))
    qpos[:, 0] = np.sin(0.1 * time_s)
    phases = np.random.default_rng(seed).uniform(0, 6, G1.num_joints)
    qpos[:, 7:] += 0.1 * np.sin(2 * time_s[:, None] + phases)
    qpos[:, 7:] = np.clip(qpos[:, 7:], *G1.joint_range.numpy().T)
    return MotionClip(name, qpos.astype(np.float32), fps)


def clips_of(count: int) -> list[MotionClip]:
    """Return made up clips of a second."""
    return [walking(CLIP_SECONDS, CLIP_RATE, f"clip_{number:05d}", number) for number in range(count)]


def write_npz(folder: Path, size: float) -> None:
    """Write one long clip."""
    save_motions(folder / "long.npz", [walking(size, RATE)])


def write_csv(folder: Path, size: float) -> None:
    """Write one long table."""
    save_csv(folder, walking(size, RATE))


def write_pickle(folder: Path, size: float) -> None:
    """Write one long clip as GMR does."""
    qpos = walking(size, RATE).qpos
    content = {"fps": RATE, "root_pos": qpos[:, :3], "root_rot": qpos[:, [4, 5, 6, 3]], "dof_pos": qpos[:, 7:]}
    (folder / "long.pkl").write_bytes(pickle.dumps({**content, "local_body_pos": None, "link_body_list": None}))


def write_bvh(folder: Path, size: float) -> None:
    """Write one long capture of 20 joints."""
    lines, joints = ["HIERARCHY", "ROOT Hips", "{", "OFFSET 0 90 0"], 20
    lines.append("CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation")
    for joint in range(joints - 1):
        lines += [f"JOINT joint{joint}", "{", "OFFSET 0 10 0", "CHANNELS 3 Zrotation Xrotation Yrotation"]
    lines += ["End Site", "{", "OFFSET 0 5 0", "}", *["}"] * joints]
    frames = round(size * RATE) + 1
    values = 10 * np.sin(0.01 * np.arange(frames)[:, None] + np.arange(3 + 3 * joints))
    with (folder / "long.bvh").open("w") as file:
        file.write("\n".join([*lines, "MOTION", f"Frames: {frames}", f"Frame Time: {1 / RATE:.8f}", ""]))
        np.savetxt(file, values, "%.5f")


def write_one_library(folder: Path, size: float) -> None:
    """Write many clips to one file."""
    save_motions(folder / "many.npz", clips_of(round(size)))


def write_library(folder: Path, size: float) -> None:
    """Write many files of a clip."""
    for clip in clips_of(round(size)):
        save_motions(folder / f"{clip.name}.npz", [clip])


def write_tables(folder: Path, size: float) -> None:
    """Write many tables."""
    for clip in clips_of(round(size)):
        save_csv(folder, clip)


def read(folder: Path) -> int:
    """Read the files of a folder; return the number of frames."""
    return sum(len(clip.qpos) for clip in load_motions(folder, G1))


def read_capture(folder: Path) -> int:
    """Read a capture, and work out where its joints are."""
    return len(read_bvh(folder / "long.bvh").positions)


def inspect(folder: Path) -> int:
    """Read and judge."""
    clips = load_motions(folder, G1)
    return len(validate_motions(clips, G1))


def library(folder: Path) -> int:
    """Make the library for training, and read it once more out of the cache."""
    os.environ["PLAT_CACHE_DIR"] = str(folder / "cache")
    made = MotionLibrary.load(folder, G1)
    again = MotionLibrary.load(folder, G1)
    if len(made) != len(again):
        raise AssertionError("the cached library is another one")
    return made.num_clips


def library_of_named_files(folder: Path) -> int:
    """Make the library of files that are named one by one, as shells do with ``*.npz``."""
    return MotionLibrary.load(sorted(folder.glob("*.npz")), G1, cache=False).num_clips


def name_apart(folder: Path) -> int:
    """Name clips apart that are all called alike, as ``plat motions convert`` does."""
    clips = [clip for clip in load_motions(folder, G1) for _ in range(4)]
    return len({clip.name for clip in distinct([MotionClip("clip", clip.qpos, clip.fps) for clip in clips])})


Write, Read = Callable[[Path, float], None], Callable[[Path], int]
LONG: dict[str, tuple[Write, Read]] = {
    "npz, read": (write_npz, read),
    "npz, inspect": (write_npz, inspect),
    "npz, library": (write_npz, library),
    "csv, read": (write_csv, read),
    "pkl, read": (write_pickle, read),
    "bvh, read": (write_bvh, read_capture),
}
"""By name, files of one long clip and what is done with them."""
MANY: dict[str, tuple[Write, Read]] = {
    "clips in one npz, library": (write_one_library, library),
    "clips in one npz, inspect": (write_one_library, inspect),
    "clips in one npz, named apart": (write_one_library, name_apart),
    "files, library": (write_library, library),
    "files one by one, library": (write_library, library_of_named_files),
    "tables, read": (write_tables, read),
}
"""By name, files of many clips."""


def cost(write: Write, work: Read, size: float) -> Cost:
    """Return what work on files of a size costs in a process of its own."""
    with Scratch("plat-large-") as scratch:
        folder = scratch / "files"
        folder.mkdir()
        process = os.fork()  # imports are paid once
        if not process:
            _exit(lambda: write(folder, size))
        _wait(process)
        result = scratch / "result"
        process = os.fork()
        if not process:
            _exit(lambda: _measure(work, folder, result))
        _wait(process)
        count, seconds, memory = result.read_text().split()
        return Cost(int(count), float(seconds), int(memory))


def _exit(work: Callable[[], None]) -> None:
    status = 1
    try:
        work()
        status = 0
    except BaseException as error:
        print(f"{type(error).__name__}: {str(error)[:500]}", file=sys.stderr, flush=True)
    os._exit(status)


def _wait(process: int) -> None:
    _, status = os.waitpid(process, 0)
    if status:
        raise SystemExit(f"process ended with {os.waitstatus_to_exitcode(status)}")


def _measure(work: Read, folder: Path, result: Path) -> None:
    before, began = _resident(), time.process_time()
    count = work(folder)
    seconds = time.process_time() - began
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    result.write_text(f"{count} {seconds} {max(0, peak - before)}")


def _resident() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def measured(seconds: float, clips: int, only: str = "") -> list[tuple[str, Cost, Cost]]:
    """Return name, cost of half and cost of all for each work."""
    torch.set_num_threads(1)  # threads do not live on in a forked process
    rows = []
    for cases, size in ((LONG, seconds), (MANY, float(clips))):
        for name, (write, work) in cases.items():
            if only in name:
                half, whole = cost(write, work, size / 2), cost(write, work, size)
                rows.append((name, half, whole))
                mark = "  GROWS" if grows(half, whole) else ""
                print(
                    f"{name:<32} {whole.count:>9,} {half.seconds:>8.1f} s {whole.seconds:>8.1f} s "
                    f"{half.memory / 1e6:>7.0f} MB {whole.memory / 1e6:>7.0f} MB{mark}",
                    flush=True,
                )
    return rows


def grows(half: Cost, whole: Cost) -> bool:
    """Return whether work takes more than in proportion to its size."""
    return whole.seconds > NOISE and whole.seconds > GROWTH * half.seconds


def main() -> None:
    """Run the campaign; print a table, and end with 1 where work grows more than in proportion."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=3600.0, help="of the long motion")
    parser.add_argument("--clips", type=int, default=10_000, help="of the library")
    parser.add_argument("--only", default="", help="part of the names of works")
    chosen = parser.parse_args()
    print(f"{'work':<32} {'count':>9} {'half':>10} {'all':>10} {'half':>10} {'all':>10}")
    sys.exit(any(grows(half, whole) for _, half, whole in measured(chosen.seconds, chosen.clips, chosen.only)))


if __name__ == "__main__":
    main()
