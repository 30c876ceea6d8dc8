import pytest
import torch

from plat.errors import TaskError
from plat.keyframes.partial import hands_of
from plat.robots import G1
from plat.robots.kinematics import ForwardKinematics
from plat.tasks import CHAIN_FAMILIES, draw_chains


@pytest.fixture(scope="module")
def chains(library):
    return draw_chains(library, 48)


def poses(chains, family):
    """All keyframes of a family, without the standing pose that chains begin with."""
    rows = [row for row in range(len(chains.qpos)) if chains.family[chains.chain[row]] == family and chains.steps[row]]
    return chains.qpos[rows]


def test_every_family_is_there_as_often(chains):
    expected = [family for family in CHAIN_FAMILIES if family != "distant"]  # which needs more than a second
    assert {family: chains.family.count(family) for family in expected} == dict.fromkeys(expected, 6)


def test_joints_are_within_their_limits(chains):
    low, high = G1.joint_range.unbind(-1)
    joints = chains.qpos[:, 7:]
    assert (joints >= low - 0.02).all()
    assert (joints <= high + 0.02).all()


def test_chains_begin_standing_and_lead_on(chains):
    standing = torch.as_tensor(G1.default_qpos, dtype=torch.float32)
    assert all(chains.qpos[row].equal(standing) for row in chains.first_row)
    assert (chains.chain[chains.next_row] == chains.chain).all()
    assert ((chains.steps == 0) | ((chains.steps >= 25) & (chains.steps <= 50))).all()


def test_arms_leave_the_legs_alone(chains):
    qpos, standing = poses(chains, "arms"), torch.as_tensor(G1.default_qpos, dtype=torch.float32)
    legs = [7 + joint for joint in G1.leg_joints]
    assert qpos[:, legs].equal(standing[legs].expand(len(qpos), -1))
    assert (qpos[:, 7:].std(0)[12:] > 0.1).all()


def test_a_crouch_keeps_the_feet_where_they_are(chains):
    qpos = poses(chains, "crouch")
    feet = ForwardKinematics(G1, G1.feet)
    pos, quat = feet(qpos[:, :3], qpos[:, 3:7], qpos[:, 7:])
    standing = torch.as_tensor(G1.default_qpos, dtype=torch.float32)[None]
    wanted, upright = feet(standing[:, :3], standing[:, 3:7], standing[:, 7:])
    off = (pos - wanted).norm(dim=-1)
    assert float(off.median()) < 0.01
    assert float((off < 0.05).float().mean()) > 0.9
    assert (qpos[:, 2] < G1.root_height - 0.04).all()
    assert float((quat - upright).abs().median()) < 0.05


def test_steps_are_short_and_far_is_far(chains):
    for family, (low, high) in {"steps": (0.25, 0.5), "far": (1.5, 2.5)}.items():
        rows = [
            row for row in range(len(chains.qpos)) if chains.family[chains.chain[row]] == family and chains.steps[row]
        ]
        way = (chains.qpos[rows, :2] - chains.qpos[[row - 1 for row in rows], :2]).norm(dim=-1)
        moved = way > 0
        assert (way[moved] > low - 1e-4).all()
        assert (way[moved] < high + 1e-4).all()
        assert moved.all() == (family == "steps")


def test_a_seed_draws_the_same_and_leaves_the_generator_alone(library, chains):
    state = torch.get_rng_state()
    assert draw_chains(library, 48).qpos.equal(chains.qpos)
    assert torch.get_rng_state().equal(state)
    assert not draw_chains(library, 48, seed=1).qpos.equal(chains.qpos)


def test_an_unknown_family_is_refused(library):
    with pytest.raises(TaskError, match="'dance'"):
        draw_chains(library, 3, ["dance"])


def test_hands_that_reach_are_in_front(chains):
    hands = ForwardKinematics(G1, hands_of(G1))
    for family in ("reach", "three_point"):
        qpos = poses(chains, family)
        places, _ = hands(qpos[:, :3], qpos[:, 3:7], qpos[:, 7:])
        assert (places[..., 0] - qpos[:, None, 0] > 0.1).all()
    assert dict(zip(chains.family, chains.commands, strict=True)) == {
        **dict.fromkeys(chains.family, ""),
        "reach": "hands",
        "three_point": "hands_and_head",
    }


def test_some_holds_are_long(library):
    chains = draw_chains(library, 80, ["arms", "steps"])
    arrivals = [int(chains.steps[chains.chain == number].sum()) for number in range(80)]
    holds = [(family, int(chains.duration[n]) - arrivals[n]) for n, family in enumerate(chains.family)]
    assert {hold for family, hold in holds if family == "steps"} == {150}
    assert {hold for family, hold in holds if family == "arms"} == {150, 750}
    assert 3 < sum(hold == 750 for _, hold in holds) < 20
