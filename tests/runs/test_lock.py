import subprocess
import sys
from pathlib import Path

import pytest

from plat.errors import CheckpointError
from plat.runs.lock import RunLock

PROGRAM = """
import sys
from pathlib import Path
from plat.runs.lock import RunLock
lock = RunLock(Path(sys.argv[1]))
print("locked", flush=True)
sys.stdin.read()
"""


def another_process(folder: Path) -> subprocess.Popen:
    """A process that locks a folder and waits."""
    pipe = subprocess.PIPE
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(folder)], stdin=pipe, stdout=pipe, stderr=pipe, text=True
    )


def test_one_process_holds_it_until_its_last_lock_is_released(tmp_path):
    locks = [RunLock(tmp_path), RunLock(tmp_path / ".." / tmp_path.name)]
    for lock in locks:
        _, error = another_process(tmp_path).communicate(timeout=60)
        assert "is writing into it; wait until it ends, or choose another --out" in error
        lock.release()
        lock.release()
    assert another_process(tmp_path).communicate(timeout=60) == ("locked\n", "")


def test_a_kill_frees_it(tmp_path):
    with another_process(tmp_path) as other:
        assert other.stdout.readline() == "locked\n"
        with pytest.raises(CheckpointError, match=f"process {other.pid} is writing into it"):
            RunLock(tmp_path)
        other.kill()
        other.wait()
        RunLock(tmp_path)


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(CheckpointError, match=r"file/run' cannot be written \(.*\); choose another --out"):
        RunLock(tmp_path / "file" / "run")
    with pytest.raises(CheckpointError, match=r"b' cannot be written \(.*its name holds a null byte"):
        RunLock(tmp_path / "a\0b")


def test_a_full_disk_does_not_hinder_it(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("plat.runs.lock.os.write", full)
    lock = RunLock(tmp_path)
    lock.release()
    assert (tmp_path / ".lock").read_bytes() == b""
