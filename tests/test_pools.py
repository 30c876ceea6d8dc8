import math
import multiprocessing
import os
import signal
import time
from concurrent.futures import CancelledError
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from types import SimpleNamespace

import pytest

import plat
from plat import pools
from plat.cli.options import Retarget
from plat.errors import WorkerError
from plat.pools import HelperPool, available_cpus, may_start_processes, told_if_killed
from tests.in_process import in_time


def test_a_process_that_was_killed_is_one_line():
    with (
        pytest.raises(WorkerError, match="killed, perhaps for want of memory: try fewer --workers; all is kept"),
        told_if_killed("all is kept"),
        HelperPool(1, int) as pool,
    ):
        pool.submit(os._exit, 9).result()


@pytest.mark.skipif(os.name != "posix", reason="signals are others")
def test_a_process_that_is_killed_while_it_begins_is_one_line(killed_at_birth):
    """What it is given is larger than a pipe: the pool waited for ever until it would have been read."""
    pool = HelperPool(1, len, bytes(1 << 20))
    (future,) = in_time(lambda: pool.submit(abs, -1))
    with pytest.raises(WorkerError, match="a worker process was killed"), told_if_killed(), pool:
        future.result(60)


def _as_it_began(folder: str) -> None:
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, ()) if hasattr(signal, "pthread_sigmask") else {signal.SIGINT}
    (Path(folder) / "began").write_text(f"{signal.getsignal(signal.SIGINT)} {signal.SIGINT in blocked}")


def test_processes_of_a_pool_leave_ctrl_c_to_the_one_that_started_them_from_their_first_moment(tmp_path):
    """The mask is that of their start: what a process says of itself comes seconds later."""
    with HelperPool(1, _as_it_began, str(tmp_path)) as pool:
        assert list(pool.map(abs, [-1, -2])) == [1, 2]
    assert (tmp_path / "began").read_text() == f"{signal.SIG_IGN} True"
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_a_pool_that_is_left_by_a_key_waits_for_nothing():
    pool = HelperPool(1, int)
    futures = [pool.submit(time.sleep, 300) for _ in range(3)]
    (process,) = pool._processes.values()
    began = time.monotonic()
    pool.__exit__(KeyboardInterrupt, KeyboardInterrupt(), None)
    with pytest.raises((CancelledError, BrokenProcessPool)):  # whichever comes first
        futures[-1].result(60)
    while process.is_alive() and time.monotonic() - began < 200:  # a thread of the pool waits for it as well
        time.sleep(0.01)
    assert time.monotonic() - began < 200


def test_whatever_starts_processes_keeps_ctrl_c_from_them():
    """Each of these words starts processes; pools.py has what keeps a key from them."""
    starters = ("ProcessPoolExecutor(", ".Process(", "MultiSyncCollector(", ".Pool(")
    for path in Path(plat.__file__).parent.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        if path.name != "pools.py" and any(word in text for word in starters):
            assert "with deaf_to_interrupts():" in text, path


def test_other_errors_pass():
    with pytest.raises(KeyError), told_if_killed():
        raise KeyError("a")


def test_a_process_ends_with_the_one_that_started_it(monkeypatch):
    ended: list[object] = []
    parent = SimpleNamespace(join=lambda: ended.append("parent"))
    monkeypatch.setattr(pools.multiprocessing, "parent_process", lambda: parent)
    monkeypatch.setattr(pools.os, "_exit", ended.append)
    pools._end_with_parent()
    assert ended == ["parent", 1]


@pytest.mark.parametrize(
    ("lines", "files", "expected"),
    [
        ("0::/\n", {}, math.inf),
        ("0::/\n", {"cpu.max": "max 100000\n"}, math.inf),
        ("0::/\n", {"cpu.max": "150000 100000\n"}, 1.5),
        ("0::/a/b\n", {"cpu.max": "400000 100000\n", "a/cpu.max": "200000 100000\n", "a/b/cpu.max": "max 1\n"}, 2.0),
        ("0::/of/the/machine\n", {"cpu.max": "300000 100000\n"}, 3.0),
        (
            "9:name=systemd:/\n4:cpu,cpuacct:/a\n2:cpuset:/\n0::/\n",
            {"cpu/cpu.cfs_quota_us": "-1\n", "cpu/cpu.cfs_period_us": "100000\n"}
            | {"cpu/a/cpu.cfs_quota_us": "250000\n", "cpu/a/cpu.cfs_period_us": "100000\n"},
            2.5,
        ),
        ("nonsense\n", {"cpu.max": "nonsense"}, math.inf),
    ],
)
def test_a_containers_share_of_the_cpus(lines, files, expected, tmp_path):
    (tmp_path / "process").write_text(lines)
    for name, text in files.items():
        (tmp_path / "groups" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "groups" / name).write_text(text)
    assert pools._quota(tmp_path / "process", tmp_path / "groups") == expected
    assert pools._quota(tmp_path / "missing", tmp_path / "groups") == math.inf


def test_cpus_are_those_that_this_process_may_use(monkeypatch):
    monkeypatch.setattr(pools.os, "sched_getaffinity", lambda _: set(range(16)), raising=False)
    for quota, expected in ((math.inf, 16), (1.5, 2), (0.1, 1), (64.0, 16)):
        monkeypatch.setattr(pools, "_quota", lambda quota=quota: quota)
        assert available_cpus() == expected
    monkeypatch.setattr(pools.os, "sched_getaffinity", lambda _: {3})
    assert Retarget(files=("a.bvh",), out=Path("out")).workers == 1


def test_a_daemon_starts_no_processes(monkeypatch):
    assert may_start_processes()
    monkeypatch.setitem(multiprocessing.current_process()._config, "daemon", True)
    assert not may_start_processes()
