"""What a machine lacks ends a command in one line; faults of programs end in their traceback."""

import errno
import os
import tempfile

import numpy as np
import pytest
import torch

from plat.runs import report_errors

TOO_MUCH = 1 << 52  # numbers: beyond what a process can address


def allocated_by_torch() -> None:
    torch.empty(TOO_MUCH)


def allocated_by_numpy() -> None:
    np.empty(TOO_MUCH)


def allocated_by_python() -> None:
    bytes(1 << 60)


def no_temporary_folder() -> None:
    raise FileNotFoundError(errno.ENOENT, "No usable temporary directory found in ['/tmp']")  # as tempfile does


def lacking(number: int) -> None:
    raise OSError(number, os.strerror(number))


@pytest.mark.parametrize(
    ("work", "message"),
    [
        (
            allocated_by_torch,
            "not enough memory .*can't allocate memory.*: take fewer --num-envs, --workers or",
        ),
        (allocated_by_numpy, "not enough memory .*Unable to allocate"),
        (allocated_by_python, "not enough memory: take fewer"),
        (no_temporary_folder, "No usable temporary directory found in"),
        (lambda: lacking(errno.EMFILE), "Too many open files"),
        (lambda: lacking(errno.ENOMEM), "Cannot allocate memory"),
        (lambda: lacking(errno.EDQUOT), "Dis[ck] quota exceeded"),
    ],
)
def test_what_the_machine_lacks_is_one_line(work, message):
    with pytest.raises(SystemExit, match=f"^error: {message}") as end, report_errors():
        work()
    assert "\n" not in str(end.value)


@pytest.mark.parametrize("error", [RuntimeError("shapes cannot be multiplied"), OSError("of a program"), KeyError("a")])
def test_faults_of_a_program_keep_their_traceback(error):
    with pytest.raises(type(error)), report_errors():
        raise error


def test_without_a_temporary_folder(monkeypatch, tmp_path):
    monkeypatch.setattr(tempfile, "tempdir", None)
    monkeypatch.setattr(tempfile, "_candidate_tempdir_list", lambda: [str(tmp_path / "missing")])
    with pytest.raises(SystemExit, match="error: No usable temporary directory found"), report_errors():
        tempfile.gettempdir()
