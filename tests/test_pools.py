import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import pytest

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
