import subprocess
import sys
from pathlib import Path

import pytest
import torch

from plat.motions import MotionLibrary

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from costs import LibraryLoads, import_time, loss_step, write_motions


def test_written_motions_are_the_library_repeated(library: MotionLibrary, tmp_path):
    write_motions(tmp_path / "motions", library, seconds=2.5 * library.duration)
    again = MotionLibrary.load(tmp_path / "motions", cache=False)
    assert 2.5 * library.duration <= again.duration < 2.5 * library.duration + 20
    assert len(list((tmp_path / "motions").iterdir())) == 3
    for name in ("joint_pos", "keypoint_ang_vel"):
        torch.testing.assert_close(again.frames[name][: len(library)], library.frames[name], atol=1e-4, rtol=0)


def test_the_second_load_finds_the_first_one_in_the_cache(library: MotionLibrary, tmp_path):
    loads = LibraryLoads(library, tmp_path, seconds=60.0)
    assert loads.first() > 0
    (entry,) = (tmp_path / "cache" / "motions").iterdir()
    written = entry.stat().st_mtime_ns
    assert loads.cached() > 0
    assert [entry.stat().st_mtime_ns] == [other.stat().st_mtime_ns for other in entry.parent.iterdir()] == [written]


def test_imports_are_timed_in_a_new_interpreter():
    assert 0 < import_time("plat") < 60
    with pytest.raises(subprocess.CalledProcessError):
        import_time("no_such_module")


def test_a_loss_step_takes_longer_on_longer_windows(library: MotionLibrary):
    short, long = (loss_step(library, stride, windows=128) for stride in (50, 1))
    assert min(short() for _ in range(3)) < min(long() for _ in range(3))
