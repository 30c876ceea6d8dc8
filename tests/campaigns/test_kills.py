import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.campaigns.kills import TASKS, needed


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs os.fork")
def test_killed_runs_end_as_those_that_were_not():
    # a process of its own: one that ran other tests may be too large to be forked
    words = ["--kills", "2", "--seed", "1", "--iterations", "3", "--tasks", "expert", "imagine"]
    command = [sys.executable, "-m", "tests.campaigns.kills", *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=Path(__file__).parents[2])
    assert done.returncode == 0, done.stdout + done.stderr
    last = done.stdout.splitlines()[-1].split()
    assert int(last[1]) >= 2  # kills that hit


def test_runs_that_others_start_from_come_first():
    assert needed(["refine"]) == ["expert", "distill", "refine"]
    assert needed(["imagine"]) == ["imagine"]
    assert needed(list(TASKS)) == list(TASKS)
