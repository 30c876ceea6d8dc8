"""A Ray cluster of two machines, both on this one, of which one is lost."""

import pytest
import torch

from plat.collectors import collect
from plat.envs import make_tracking_env
from tests.collectors.test_workers import assert_same, flailing, motions
from tests.on_ray import two_machines

ray = pytest.importorskip("ray", reason="Ray is not installed: pip install 'plat-rl[ray]'")
pytestmark = pytest.mark.slow


def test_workers_of_a_lost_machine_go_on_elsewhere(capsys):
    runs = []
    with two_machines(ray) as machines:
        for lost in (False, True):
            torch.manual_seed(1)
            with collect(make_tracking_env, motions(), 4, flailing(), 20, workers=2, ray=True) as source:
                first = next(source)
                if lost:
                    machines.lose_one()
                runs.append((first, next(source)))
    for found, wanted in zip(*runs, strict=True):
        assert_same(found, wanted)
    assert "ended (" in capsys.readouterr().out
