import os

import pytest

from tests.campaigns.kills import TASKS, campaign, needed


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs os.fork")
@pytest.mark.filterwarnings("ignore:.*fork.*")
def test_killed_runs_end_as_those_that_were_not(capsys):
    assert campaign(kills=2, seed=1, iterations=3, tasks=["expert", "imagine"]) == 0
    last = capsys.readouterr().out.splitlines()[-1].split()
    assert int(last[1]) >= 2  # kills that hit


def test_runs_that_others_start_from_come_first():
    assert needed(["refine"]) == ["expert", "distill", "refine"]
    assert needed(["imagine"]) == ["imagine"]
    assert needed(list(TASKS)) == list(TASKS)
