import os
import subprocess
import sys
from pathlib import Path

import pytest

from plat.scratch import Scratch

PROGRAM = """
import sys
from pathlib import Path
from plat.scratch import Scratch
scratch = Scratch("mine-", Path(sys.argv[1]))
(scratch.path / "large.bin").write_text("large")
print(scratch.path, flush=True)
sys.stdin.read()
"""


def make_old(folder: Path) -> None:
    os.utime(folder / ".lock", (0, 0))


@pytest.mark.slow
def test_what_a_killed_process_left_is_removed_by_the_next(tmp_path):
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", PROGRAM, str(tmp_path)], stdin=pipe, stdout=pipe, text=True) as other:
        folder = Path(other.stdout.readline().strip())
        make_old(folder)
        Scratch("mine-", tmp_path).remove()
        assert (folder / "large.bin").exists()  # its process lives
        other.kill()
        other.wait()
    Scratch("mine-", tmp_path).remove()
    assert not folder.exists()


def test_what_is_in_use_new_or_of_others_stays(tmp_path):
    ours = Scratch("mine-", tmp_path)
    make_old(ours.path)
    (tmp_path / "mine-file").write_text("a file")
    (tmp_path / "mine-without").mkdir()
    for name in ("mine-new", "other-old"):
        (tmp_path / name).mkdir()
        (tmp_path / name / ".lock").touch()
    make_old(tmp_path / "other-old")
    (tmp_path / "mine-link").symlink_to(tmp_path / "other-old", target_is_directory=True)
    before = sorted(tmp_path.iterdir())
    with Scratch("mine-", tmp_path) as second:
        assert second.is_dir()
        assert sorted(tmp_path.iterdir()) == sorted([*before, second])
    assert sorted(tmp_path.iterdir()) == before
    ours.remove()
    ours.remove()
    assert not ours.path.exists()


@pytest.mark.parametrize("prefix", [".a[1]-", ".a**b-", ".*-"])
def test_a_prefix_is_no_pattern(tmp_path, prefix):
    for name in (f"{prefix}old", ".a1-old"):
        (tmp_path / name).mkdir()
        (tmp_path / name / ".lock").touch()
        make_old(tmp_path / name)
    Scratch(prefix, tmp_path).remove()
    assert [path.name for path in tmp_path.iterdir()] == [".a1-old"]


def test_a_disk_without_locks_is_used_all_the_same(tmp_path, monkeypatch):
    def refuse(file):
        raise OSError("no locks available")

    monkeypatch.setattr("plat.scratch.lock_file", refuse)
    first = Scratch("mine-", tmp_path)
    make_old(first.path)
    with Scratch("mine-", tmp_path):
        assert first.path.exists()
    first.remove()
