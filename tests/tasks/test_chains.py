from dataclasses import replace

import mujoco
import numpy as np
import pytest
import torch

from plat.control import resting_poses
from plat.errors import ConfigError, TaskError
from plat.keyframes.partial import hands_of
from plat.motions import MotionClip, MotionLibrary, generate_motions
from plat.motions.checks.collision import self_penetration
from plat.robots import G1
from plat.robots.kinematics import ForwardKinematics
from plat.spec.timing import Timing
from plat.tasks import CHAIN_FAMILIES, draw_chains
from plat.tasks.chains import _resting_poses


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


def test_hands_that_reach_are_in_front_and_in_nobodys_way(library):
    hands = ForwardKinematics(G1, hands_of(G1))
    data = mujoco.MjData(G1.shared_model)
    chains = draw_chains(library, 40, ["reach", "three_point"])
    for family in ("reach", "three_point"):
        qpos = poses(chains, family)
        places, _ = hands(qpos[:, :3], qpos[:, 3:7], qpos[:, 7:])
        assert (places[..., 0] - qpos[:, None, 0] > 0.1).all()
        assert (places[..., 2] > qpos[:, None, 2]).all()
        inside = [self_penetration(G1.shared_model, pose.numpy(), data) for pose in qpos]
        assert sum(depth >= 0.02 for depth in inside) <= 0.02 * len(inside)  # a quarter of all draws


def test_a_robot_whose_hands_never_come_ahead_is_not_told_to_reach(library):
    knees = ("left_knee_link", "right_knee_link")
    kneeling = replace(G1, name="kneeling", end_effectors=(*G1.feet, *knees))
    library = MotionLibrary.from_clips(generate_motions("train", seconds=8), kneeling)
    assert set(draw_chains(library, 6, ["arms", "reach", "three_point"]).family) == {"arms"}
    with pytest.raises(TaskError, match="reach, three_point start from .* hands that come ahead"):
        draw_chains(library, 6, ["reach", "three_point"])


def test_partial_chains_say_what_they_command(chains):
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


def seconds(chains, dt):
    """Times (s) between keyframes, and the holds."""
    holds = [int(end) - int(chains.steps[chains.chain == number].sum()) for number, end in enumerate(chains.duration)]
    return dt * chains.steps[chains.steps > 0], {round(dt * hold, 3) for hold in holds}


@pytest.mark.parametrize("dt", [0.01, 0.02, 0.03])
def test_times_are_in_seconds_whatever_the_control_step(dt):
    motions = MotionLibrary.from_clips(generate_motions("train", seconds=8), dt=dt)
    timing = Timing(control_dt=dt, max_steps=round(1 / dt))
    between, holds = seconds(draw_chains(motions, 80, ["arms", "steps"], timing=timing), dt)
    assert 0.49 < float(between.min()) < 0.56
    assert 0.94 < float(between.max()) < 1.01
    assert holds == {3.0, 15.0}
    long = Timing(control_dt=dt, max_steps=round(3 / dt))
    between, _ = seconds(draw_chains(motions, 80, ["distant"], timing=long), dt)
    assert 1.49 < float(between.min()) < 1.6
    assert 2.8 < float(between.max()) < 3.01


@pytest.mark.parametrize("longest", [1, 20, 40])
def test_no_keyframe_takes_longer_than_the_longest_command(library, longest):
    steps = draw_chains(library, 80, timing=Timing(max_steps=longest)).steps
    assert set(steps[steps > 0].tolist()) == set(range(min(25, longest), longest + 1))


def test_without_a_timing_chains_have_the_control_step_of_the_motions():
    motions = MotionLibrary.from_clips(generate_motions("train", seconds=8), dt=0.04)
    between, _ = seconds(draw_chains(motions, 40, ["arms"]), 0.04)
    assert 0.47 < float(between.min()) < 0.6


@pytest.mark.parametrize(
    ("longest", "wanted"),
    [
        (50, [42, 35, 41, 30, 50, 39, 41, 38, 36, 27, 38, 32, 45, 42, 42, 32, 28, 48, 38, 50, 29, 38]),
        (150, [42, 109, 137, 30, 50, 39, 41, 38, 36, 84, 26, 46, 32, 41, 48, 38, 122, 81]),
    ],
)
def test_a_seed_draws_the_times_that_trained_weights_know(library, longest, wanted):
    steps = draw_chains(library, 4, ["steps", "far", "distant"], seed=7, timing=Timing(max_steps=longest)).steps
    assert steps[steps > 0].tolist() == wanted


@pytest.mark.parametrize(("name", "value"), [("count", 0), ("count", 1.5), ("seed", -1), ("timing", 0.02)])
def test_arguments_that_make_no_sense_are_refused(library, name, value):
    with pytest.raises(ConfigError, match=f"draw_chains: {name} is {value}, expected"):
        draw_chains(library, **{"count": 3, name: value})


@pytest.mark.parametrize(("height", "rests"), [(0.5485, False), (0.5515, True)])
def test_what_rests_is_the_same_in_training_and_in_evaluation(height, rests):
    qpos = np.tile(G1.default_qpos, (20, 1))
    qpos[:, 2] = height
    library = MotionLibrary.from_clips([MotionClip("low", qpos, 50.0)])
    assert bool(len(_resting_poses(library))) == bool(len(resting_poses(library))) == rests
