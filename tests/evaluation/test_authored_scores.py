import pytest
import torch
from tensordict.nn import TensorDictModule

import plat
from plat.control.authored import Authored, author
from plat.errors import RecordsError
from plat.evaluation.authored_scores import AuthoredRecords, AuthoredScore, authored_table, evaluate_authored
from plat.keyframes import KeyframeSequence, standing
from plat.robots import G1

STAND = standing(G1)


def still(seconds: float, hold: float = 0.2) -> Authored:
    """Stay as you stand."""
    poses = tuple(STAND.at(seconds * number / 5) for number in range(1, 6))
    return Authored("still", KeyframeSequence(G1, STAND, poses), hold)


def limp() -> TensorDictModule:
    """A policy that throws itself over: all joints far off."""
    return TensorDictModule(lambda pos: torch.full_like(pos, 6.0), [("robot", "joint_pos")], ["action"])


def test_a_policy_that_can_stand_reaches_what_it_stands_in() -> None:
    policy = plat.load("plat-g1").deployed()
    records = evaluate_authored(policy, G1, [still(1.0), *author("steps", G1, 1, seed=0)])
    assert records.family == ["still", "steps"]
    assert bool(records.reached[0].all())
    assert not bool(records.fell[0])
    assert float(records.root_error[0].max()) < 0.1
    assert float(records.joint_error[0].max()) < 0.1
    # steps are 0.25 m and more away: whoever reaches one has gone there
    assert float(records.root_error[1].min()) < 0.2


def test_a_fall_is_seen_and_what_comes_after_is_not_reached() -> None:
    records = evaluate_authored(limp(), G1, [still(2.0), still(2.0, hold=1.0)])
    assert records.fell.tolist() == [True, True]
    assert not bool(records.reached[:, -1].any())
    assert records.fell_in_hold.tolist() == [False, False]


def test_a_robot_does_not_depend_on_its_neighbors() -> None:
    policy = plat.load("dagger-g1").deployed()
    chains = author("steps", G1, 3, seed=4)
    together = evaluate_authored(policy, G1, chains)
    alone = evaluate_authored(policy, G1, chains[1:2])
    # chains of other lengths beside it, and another place in the library
    torch.testing.assert_close(together.root_error[1:2, :1], alone.root_error[:, :1], atol=1e-4, rtol=0)


def records() -> AuthoredRecords:
    reached = torch.tensor([[True, True], [True, False], [False, False], [True, True]])
    return AuthoredRecords(
        ["a", "a", "a", "b"],
        reached,
        torch.zeros(4, 2),
        torch.zeros(4, 2),
        fell=torch.tensor([False, True, True, False]),
        fell_in_hold=torch.tensor([False, True, False, False]),
    )


def test_scores_are_shares_of_chains_keyframes_and_holds() -> None:
    score = AuthoredScore.of(records(), "a")
    assert score.chains == 3
    assert score.fell[0] == pytest.approx(200 / 3)
    assert score.reached[0] == pytest.approx(50.0)
    assert score.fell_in_hold[0] == pytest.approx(50.0)  # of two that began upright
    assert score.fell[1] < score.fell[0] <= score.fell[2]
    assert AuthoredScore.of(records(), "b").fell == (0.0, 0.0, 0.0)


def test_a_table_has_a_row_a_family() -> None:
    lines = authored_table(records()).splitlines()
    assert [line.split("|")[1].strip() for line in lines[2:]] == ["a", "b"]
    assert "| 50.0 (" in lines[2]


def test_another_family_is_named() -> None:
    with pytest.raises(RecordsError, match=r"'c': no records, expected one of \['a', 'b'\]"):
        AuthoredScore.of(records(), "c")
