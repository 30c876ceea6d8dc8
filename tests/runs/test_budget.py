import pytest

from plat.errors import PlatError
from plat.runs import Budget


@pytest.fixture
def now(monkeypatch):
    """Time of the budget's clock (s), in a list."""
    time = [0.0]
    monkeypatch.setattr("plat.runs.budget.time.monotonic", lambda: time[0])
    return time


def test_steps():
    budget = Budget(steps=100)
    assert not budget.done
    budget.add(50)
    assert budget.fraction == pytest.approx(0.5)
    budget.add(50)
    assert budget.done
    assert budget.seconds_left == 0


def test_minutes(now):
    now[0] = 100.0
    budget = Budget(minutes=2)
    now[0] += 90
    assert budget.fraction == pytest.approx(0.75)
    assert budget.seconds_left == pytest.approx(30)
    budget.add(1)
    now[0] += 30
    assert budget.done


def test_a_budget_shorter_than_an_iteration_is_one_iteration(now):
    budget = Budget(minutes=0.01)
    now[0] = 5.0
    assert not budget.done
    budget.add(8)
    assert budget.done


def test_what_comes_after_training_does_not_count(now):
    budget = Budget(minutes=2)
    now[0] = 30.0
    budget.end()
    now[0] = 500.0
    assert budget.seconds == budget.state_dict()["seconds"] == 30.0
    budget.begin()
    assert budget.seconds == 0.0


def test_what_comes_before_training_does_not_count(now):
    budget = Budget(minutes=2)
    now[0] = 500.0
    budget.begin()
    now[0] = 530.0
    assert budget.seconds == 30.0


def test_pauses_do_not_count(now):
    budget = Budget(minutes=2)
    now[0] = 30.0
    with budget.paused():
        now[0] = 500.0
        assert budget.state_dict()["seconds"] == 30.0
    now[0] = 510.0
    budget.add(80)
    assert (budget.seconds, budget.rate) == (40.0, 2.0)
    budget.end()
    with budget.paused():
        now[0] = 900.0
    assert budget.seconds == 40.0


def test_the_first_limit_counts():
    budget = Budget(minutes=1000, steps=10)
    budget.add(10)
    assert budget.done


def test_time_to_go_follows_the_rate(now):
    budget = Budget(steps=1000)
    assert budget.seconds_left == float("inf")
    now[0] = 10.0
    budget.add(200)
    assert budget.rate == pytest.approx(20)
    assert budget.seconds_left == pytest.approx(40)


def test_resumed_runs_go_on_counting(now):
    first = Budget(minutes=1)
    first.add(500)
    now[0] = 30.0
    state = first.state_dict()
    now[0] = 1000.0  # an hour off
    second = Budget(minutes=1)
    second.load_state_dict(state)
    assert second.steps == 500
    assert second.fraction == pytest.approx(0.5)
    now[0] = 1010.0
    second.add(100)
    assert second.rate == pytest.approx(10)  # of this process alone


@pytest.mark.parametrize("limits", [{}, {"minutes": 0}, {"steps": -1}, {"minutes": 1, "steps": 0}])
def test_a_budget_needs_a_limit(limits):
    with pytest.raises(PlatError, match="expected a positive number"):
        Budget(**limits)
