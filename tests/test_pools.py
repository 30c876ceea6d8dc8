import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from types import SimpleNamespace

import pytest

from plat import pools
from plat.errors import WorkerError
from plat.pools import told_if_killed


def test_a_process_that_was_killed_is_one_line():
    with (
        pytest.raises(WorkerError, match="killed, perhaps for want of memory: try fewer --workers; all is kept"),
        told_if_killed("all is kept"),
        ProcessPoolExecutor(1, get_context("spawn")) as pool,
    ):
        pool.submit(os._exit, 9).result()


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
