from collections.abc import Callable
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule

import plat
from plat.control import Chase, KeyframeScorer, PolicyController, Simulator
from plat.control.authored import Authored, author
from plat.errors import RecordsError
from plat.evaluation.authored_rollout import AuthoredRollout, Pushes
from plat.evaluation.authored_scores import (
    AuthoredRecords,
    AuthoredScore,
    _samples,
    authored_table,
    evaluate_authored,
    write_authored_csv,
)
from plat.keyframes import KeyframeSequence, standing
from plat.robots import G1
from plat.spec.parts import Parts

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
    return AuthoredRecords(
        ["a", "a", "a", "b"],
        sample=torch.arange(4),
        reached=torch.tensor([[True, True], [True, False], [False, False], [True, True]]),
        fell_before=torch.tensor([[False, False], [False, False], [False, True], [False, False]]),
        root_error=torch.zeros(4, 2),
        joint_error=torch.zeros(4, 2),
        body_error=torch.zeros(4, 2),
        feasible=torch.tensor([[True, True], [True, False], [True, False], [False, False]]),
        fell=torch.tensor([False, True, True, False]),
        fell_in_hold=torch.tensor([False, True, False, False]),
        foot_travel=torch.zeros(4),
        stepped=torch.tensor([True, True, False, False]),
        in_pose=torch.tensor([True, True, True, True]),
        at_rest=torch.tensor([True, True, True, False]),
    )


def test_scores_are_shares_of_chains_keyframes_and_holds() -> None:
    score = AuthoredScore.of(records(), "a")
    assert score.chains == 3
    assert score.fell[0] == pytest.approx(200 / 3)
    assert score.reached[0] == pytest.approx(50.0)
    assert score.fell_in_hold[0] == pytest.approx(50.0)  # of two that began upright
    assert score.fell[1] < score.fell[0] <= score.fell[2]
    assert score.late_or_off[0] == pytest.approx(100 / 3)  # of the three that were not reached one had fallen
    assert score.reached_feasible[0] == pytest.approx(75.0)
    assert score.stepped[0] == pytest.approx(100.0)  # of the one that did not fall
    upright = replace(records(), fell=torch.zeros(4, dtype=torch.bool), reached=torch.ones(4, 2, dtype=torch.bool))
    assert AuthoredScore.of(upright, "a").stepped[0] == pytest.approx(200 / 3)
    walks_on = replace(upright, in_pose=torch.tensor([False, True, True, True]))
    assert AuthoredScore.of(walks_on, "a").stepped[0] == pytest.approx(50.0)  # of the two that were where they hold
    late = replace(upright, reached=torch.tensor([[True, False], [True, True], [False, True], [True, True]]))
    assert AuthoredScore.of(late, "a").stepped[0] == pytest.approx(50.0)
    other = AuthoredScore.of(records(), "b")
    assert other.fell == pytest.approx((0.0, 0.0, 97.5))  # one chain says little of others
    assert np.isnan(other.reached_feasible).all()  # no keyframe was feasible
    assert np.isnan(other.stepped).all()


def test_a_robot_that_is_not_there_holds_nothing() -> None:
    far = replace(STAND, root_pos=np.array([3.0, 0.0, 0.76]))
    away = tuple(far.at(0.1 * number) for number in range(1, 6))
    out_of_reach = Authored("far", KeyframeSequence(G1, STAND, away), 1.3)
    # the last hold ends where feet begin to be watched
    chains = [out_of_reach, still(0.5, hold=1.3), still(0.5, hold=1.0)]
    records = evaluate_authored(plat.load("plat-g1").deployed(), G1, chains)
    assert records.in_pose.tolist() == [False, True, False]
    assert np.isnan(AuthoredScore.of(records, "far").stepped).all()
    assert float(records.foot_travel[2]) == 0


def test_chains_through_the_same_poses_are_one_sample() -> None:
    """Three copies of a pose that was missed at all times say as much as one."""
    chains = [still(1.0), still(2.0), *author("steps", G1, 2, seed=0)]
    assert _samples(chains).tolist() == [0, 0, 1, 2]
    one, copies = records(), replace(records(), family=["a"] * 4, sample=torch.tensor([0, 1, 1, 1]))
    one = replace(one, family=["a", "a", "-", "-"], fell=torch.tensor([False, True, True, True]))
    copies = replace(copies, fell=one.fell)
    assert AuthoredScore.of(one, "a").fell == pytest.approx((50.0, 0.0, 100.0))
    assert AuthoredScore.of(copies, "a").fell == pytest.approx((75.0, 0.0, 100.0))
    assert AuthoredScore.of(replace(copies, sample=torch.arange(4)), "a").fell[1] == pytest.approx(25.0)
    fell = torch.zeros(4, dtype=torch.bool)
    of_two = AuthoredScore.of(replace(copies, fell=fell), "a").fell
    assert of_two == pytest.approx((0.0, 0.0, 84.19), abs=0.01)
    alone = AuthoredScore.of(replace(copies, sample=torch.zeros(4, dtype=torch.int64)), "a")
    assert alone.fell == (75.0, 0.0, 100.0)  # nothing is known of other poses


def test_a_table_has_a_row_a_family() -> None:
    lines = authored_table(records()).splitlines()
    assert [line.split("|")[1].strip() for line in lines[2:]] == ["a", "b"]
    assert "| 50.0 (" in lines[2]
    assert lines[3].endswith("| - | 0.0 (0.0-97.5) | - |")


def test_an_interval_without_a_width_is_left_out_as_in_other_tables() -> None:
    """Every chain had one of its two keyframes reached: all samples are alike."""
    alike = replace(records(), reached=torch.tensor([[True, False]] * 4))
    (line,) = (line for line in authored_table(alike).splitlines() if line.startswith("| a |"))
    assert line.split(" | ")[3] == "50.0"


def test_one_keyframe_of_thousands_is_not_rounded_away() -> None:
    rows = torch.zeros(2000, dtype=torch.long)
    columns = {name: column[rows] for name, column in vars(records()).items() if isinstance(column, torch.Tensor)}
    columns |= {"sample": torch.arange(2000), "fell": rows > 0, "reached": torch.ones(2000, 2, dtype=torch.bool)}
    columns["reached"][0, 0] = False
    (line,) = authored_table(AuthoredRecords(["a"] * 2000, **columns)).splitlines()[2:]
    assert line.startswith("| a | 2000 | 0.0 (0.0-0.2) | 99.9 (99.9-100.0) |")


def test_a_file_has_a_line_for_every_figure(tmp_path: Path) -> None:
    write_authored_csv(tmp_path / "scores.csv", {"plat": records()})
    lines = (tmp_path / "scores.csv").read_text().splitlines()
    assert lines[0] == "policy,family,chains,metric,value,low,high"
    assert len(lines) == 1 + 2 * 6
    assert "plat,b,1,stepped,,," in lines
    assert [line for line in lines if line.startswith("plat,a,3,late_or_off,33.333,")]


def test_pushes_are_felt_and_a_seed_repeats_them() -> None:
    policy, chains = plat.load("plat-g1").deployed(), [still(1.0), still(1.0)]
    calm = evaluate_authored(policy, G1, chains)
    one, again, other = (
        evaluate_authored(policy, G1, chains, pushes=Pushes(0.4, every=0.9, seed=seed)) for seed in (1, 1, 2)
    )
    torch.testing.assert_close(one.root_error, again.root_error)
    torch.testing.assert_close(one.root_error[:, :4], calm.root_error[:, :4])  # before the first push
    assert float((one.root_error - calm.root_error)[:, 4].abs().min()) > 0.005
    assert float((one.root_error - other.root_error)[:, 4].abs().max()) > 1e-4
    assert calm.at_rest.all()
    assert not one.at_rest.any()


def test_a_robot_begins_at_rest() -> None:
    rollout = AuthoredRollout(plat.load("plat-g1").deployed(), G1, author("steps", G1, 2, seed=0))
    first = next(iter(rollout)).before["robot"]
    for velocity in ("joint_vel", "root_ang_vel_b", "root_lin_vel_b"):
        assert not bool(first[velocity].any())


def test_a_chain_is_scored_like_a_chase() -> None:
    """One robot in plain MuJoCo, by the scorer of ``plat play``."""
    policy = plat.load("plat-g1").deployed()
    (chain,) = author("steps", G1, 1, seed=0)
    records = evaluate_authored(policy, G1, [chain])
    scorer = KeyframeScorer(G1)
    controller = PolicyController(policy, G1)
    for step in Chase(controller, chain.sequence, Simulator(G1.model()), hold=chain.hold):
        scorer.add(step)
    # contacts amplify the rounding of two simulations: the first keyframe is compared
    scores, figures = scorer.scores()[:1], {"root": records.root_error, "joint": records.joint_error}
    for name, errors in figures.items():
        np.testing.assert_allclose([getattr(score.arrival, name) for score in scores], errors[0, :1], atol=0.01)
    assert [score.reached for score in scores] == records.reached[0, :1].tolist()
    assert [score.fell for score in scores] == records.fell_before[0, :1].tolist()


def test_another_family_is_named() -> None:
    with pytest.raises(RecordsError, match=r"'c': no records, expected one of \['a', 'b'\]"):
        AuthoredScore.of(records(), "c")


def test_a_fall_is_seen_however_the_keyframes_are_drawn() -> None:
    """Of a pose that lies upside down only the hands are commanded; the robot tips over after a while."""
    hands = Parts.only(G1, bodies=("left_wrist_yaw_link", "right_wrist_yaw_link"))
    lying = replace(STAND, root_pos=np.array([0.0, 0.0, 0.12]), root_quat=np.array([0.0, 0.0, 1.0, 0.0]))
    poses = tuple(replace(lying.at(0.5 * number), commands=hands) for number in range(1, 6))
    stiff = TensorDictModule(lambda pos: torch.ones_like(pos), [("robot", "joint_pos")], ["action"])
    records = evaluate_authored(stiff, G1, [Authored("drawn low", KeyframeSequence(G1, STAND, poses), 1.0)])
    assert records.fell.tolist() == [True]
    assert not bool(records.fell_before[0, 0])


def test_who_is_told_to_be_low_may_be_low_until_told_to_be_up() -> None:
    low, elbow = replace(STAND, root_pos=np.array([0.0, 0.0, 0.3])), Parts.only(G1, joints=("left_elbow",))
    poses = (STAND.at(0.2), low.at(0.4), replace(STAND, commands=elbow).at(0.6), STAND.at(0.8), STAND.at(1.0))
    stiff = TensorDictModule(lambda pos: torch.zeros_like(pos), [("robot", "joint_pos")], ["action"])
    rollout = AuthoredRollout(stiff, G1, [Authored("low", KeyframeSequence(G1, STAND, poses), 1.0)])
    heights = [float(rollout.lowest_root(step).height) for step in (10, 11, 20, 21, 30, 31, 40, 41, 51, 90)]
    np.testing.assert_allclose(heights, [0.76, *[0.3] * 6, *[0.76] * 3], atol=1e-6)


def test_what_there_is_nothing_of_in_a_resample_is_not_zero() -> None:
    """One keyframe of three chains is feasible, and was reached: all of them, whichever chains are drawn."""
    feasible = torch.zeros(4, 2, dtype=torch.bool)
    feasible[0, 0] = True
    score = AuthoredScore.of(replace(records(), feasible=feasible), "a")
    assert score.reached_feasible == pytest.approx((100, 2.5, 100))


def wild(absurd: Callable[[int], bool] = lambda step: step == 20) -> TensorDictModule:
    """A policy that stands, but for the first robot's absurd actions, as in the twentieth step.

    The simulation is not given them.
    """
    policy, steps = plat.load("plat-g1").deployed(), count(1)

    def act(*values: torch.Tensor) -> torch.Tensor:
        action = policy(TensorDict(dict(zip(policy.in_keys, values, strict=True)), values[0].shape[:1]))["action"]
        if absurd(next(steps)):
            action[0] = 2e4
        return action

    return TensorDictModule(act, policy.in_keys, ["action"])


def test_a_robot_whose_action_is_absurd_has_fallen() -> None:
    records = evaluate_authored(wild(), G1, [still(1.0)])
    assert records.fell.tolist() == [True]
    assert records.fell_before.tolist() == [[False, True, True, True, True]]
    assert records.reached.tolist() == [[True, False, False, False, False]]


def test_a_robot_that_is_broken_for_good_does_not_end_the_scores_of_others() -> None:
    records = evaluate_authored(wild(lambda step: step >= 30), G1, [still(2.0), still(2.0)])
    assert records.fell.tolist() == [True, False]
    assert records.reached.tolist() == [[True, False, False, False, False], [True] * 5]
