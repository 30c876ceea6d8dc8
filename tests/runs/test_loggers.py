"""Experiment loggers: what they are given, and users who are not logged in."""

import os
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from plat.errors import PlatError
from plat.runs import check_logger, log_table, log_video, start_logging
from plat.runs.loggers import chosen_loggers, logging_id


class Log:
    """A run that keeps what is logged."""

    __module__ = "wandb.sdk"

    def __init__(self):
        self.entries: list[tuple[dict, int | None]] = []

    def log(self, entry, step=None):
        self.entries.append((entry, step))


def test_flags_choose_loggers():
    assert chosen_loggers(wandb=False, trackio=False) == ()
    assert chosen_loggers(wandb=True, trackio=True) == ("wandb", "trackio")


def test_a_logger_that_is_missing_says_how_to_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "trackio", None)
    monkeypatch.delitem(sys.modules, "trackio")
    monkeypatch.setattr(sys, "path", [])
    with pytest.raises(PlatError, match=r"--trackio needs: pip install 'plat-rl\[trackio\]'"):
        check_logger("trackio")


def test_tables_and_pictures_are_logged(tmp_path):
    pytest.importorskip("wandb")
    picture = tmp_path / "radar.png"
    pytest.importorskip("imageio").imwrite(picture, np.zeros((4, 4, 3), dtype=np.uint8))
    log = Log()
    log_table(log, "evaluation", ("policy", "tks"), [("PLAT", 99.5), ("DAgger", 98.0)], [picture, tmp_path / "a.pdf"])
    ((entry, _),) = log.entries
    assert entry["evaluation"].columns == ["policy", "tks"]
    assert entry["evaluation"].data == [["PLAT", 99.5], ["DAgger", 98.0]]
    assert [name for name in entry if name != "evaluation"] == ["figures/radar"]


def test_a_video_is_logged_at_its_step(tmp_path, monkeypatch):
    wandb = pytest.importorskip("wandb")
    monkeypatch.setattr(wandb, "Video", lambda path, format: SimpleNamespace(path=path, format=format))
    log = Log()
    log_video(log, tmp_path / "7.mp4", 7)
    ((entry, step),) = log.entries
    assert step == 7
    assert (entry["video"].path, entry["video"].format) == (str(tmp_path / "7.mp4"), "mp4")


def started(monkeypatch, logger, folder, run_id):
    """What a logger's init is given."""
    given = {}
    monkeypatch.setitem(sys.modules, logger, SimpleNamespace(init=lambda **settings: given.update(settings)))
    monkeypatch.setenv("WANDB_MODE", "offline")
    start_logging(logger, "expert", folder, {"seed": 0}, run_id)
    return given


def test_a_resumed_training_goes_on_with_its_run_and_a_new_one_of_the_name_does_not(tmp_path, monkeypatch):
    for folder in ("one", "other"):
        (tmp_path / folder).mkdir()
    first, again, new, other = (
        logging_id(tmp_path / folder, resume)
        for folder, resume in (("one", False), ("one", True), ("one", False), ("other", True))
    )
    assert first == again
    assert len({first, new, other}) == 3
    given = started(monkeypatch, "wandb", tmp_path, first)
    assert (given["name"], given["id"], given["resume"]) == ("expert", first, "allow")
    # trackio finds runs by name: two trainings called "expert" are two runs
    given = started(monkeypatch, "trackio", tmp_path, first)
    assert (given["name"], given["resume"]) == (f"expert-{first}", "allow")


def test_an_evaluation_is_a_run_of_its_own(tmp_path, monkeypatch):
    assert started(monkeypatch, "wandb", tmp_path, None)["id"] is None
    assert started(monkeypatch, "trackio", tmp_path, None)["resume"] == "never"
    assert not list(tmp_path.iterdir())


PROGRAM = """
import sys
from pathlib import Path

if sys.argv[3:] == ["late"]:  # wandb reads WANDB_MODE when it is imported
    import os
    import wandb
    os.environ["WANDB_MODE"] = "offline"
from plat.runs import log_table, start_logging

run = start_logging(sys.argv[1], "name", Path(sys.argv[2]), {"seed": 0})
run.log({"loss": 0.5}, step=1)
log_table(run, "evaluation", ("policy", "tks"), [("PLAT", 99.5)])
run.finish()
"""


def start(logger, folder, *arguments, **environment):
    """A process that logs with a home of its own, where nobody is logged in."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("WANDB", "TRACKIO"))}
    environment = {**kept, "HOME": str(folder), "NETRC": str(folder / "none"), **environment}
    command = [sys.executable, "-c", PROGRAM, logger, str(folder), *arguments]
    return subprocess.run(
        command, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=120
    )


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [(), ("late",)])
def test_wandb_is_offline_for_a_user_who_is_not_logged_in(tmp_path, arguments):
    pytest.importorskip("wandb")
    done = start("wandb", tmp_path, *arguments)
    assert done.returncode == 0, done.stderr
    assert "deprecated" not in done.stderr
    assert len(list((tmp_path / "wandb").glob("offline-run-*"))) == 1


@pytest.mark.slow
def test_trackio_keeps_its_files_here(tmp_path):
    pytest.importorskip("trackio")
    done = start("trackio", tmp_path, TRACKIO_DIR=str(tmp_path / "trackio"))
    assert done.returncode == 0, done.stderr
    assert list((tmp_path / "trackio").glob("plat*"))
