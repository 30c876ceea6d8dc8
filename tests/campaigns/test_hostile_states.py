import pytest

from plat.deploy.safety import TargetLimiter
from tests.campaigns.hostile_states import run


def test_no_command_leaves_its_limits():
    counts = run(3000)
    assert min(counts[mode] for mode in ("ramp", "run", "damping")) > 10  # it has been everywhere
    assert {f"stepped in: {piece}" for piece in ("watchdog", "tilt", "finite", "rate", "range", "policy")} <= set(
        counts
    )


def test_the_campaign_can_fail(monkeypatch):
    monkeypatch.setattr(TargetLimiter, "__call__", lambda self, target, state, dt: (self.high + 1.0, {}))
    with pytest.raises(AssertionError):
        run(500)
