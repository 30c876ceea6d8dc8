from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch

from plat.control import authored
from plat.control.authored import FAMILIES, UndrawableError, _times, author, resting_poses
from plat.control.feasibility import Feasibility
from plat.errors import KeyframeError, PlatError
from plat.evaluation.authored_scores import author_families
from plat.keyframes import KeyframeSequence
from plat.keyframes.chain_families import FAMILY_TABLE
from plat.keyframes.partial import hands_of
from plat.motions import MotionClip, MotionLibrary
from plat.robots import G1, ForwardKinematics
from plat.spec.timing import Timing
from plat.tasks.chains import _chains
from tests.conftest import standing_clip

# Of each family's second chain of seed 0: time of the last keyframe, its root's pose, and its joint angles weighted by
# 1 to 29. Scores of policies are comparable while these stay.
DRAWN = {
    "hold": (3.56, 0.0, 0.0, 0.76, 1.0, 0.0, 0.0, 0.0, 121.4620014429),
    "arms": (3.56, 0.0, 0.0, 0.76, 1.0, 0.0, 0.0, 0.0, -29.6875568491),
    "poses": (3.82, -0.0920204795, -0.0256609037, 0.76, 0.9976291272, 0.0, 0.0, 0.0688195078, 34.4620014429),
    "steps": (3.9, -0.2010528562, 0.5630144963, 0.76, 0.938001952, 0.0, 0.0, 0.3466299727, 34.4620014429),
    "crouch": (3.48, -0.0457701847, -0.0, 0.6414026942, 0.9750984944, 0.0, 0.2217722396, 0.0, 33.4544432964),
    "reach": (3.78, 0.0, 0.0, 0.76, 1.0, 0.0, 0.0, 0.0, 21.7487563239),
    "three_point": (3.86, -0.0278565899, 0.0, 0.6379896656, 0.9994727424, 0.0, 0.0324690191, 0.0, 75.7212523001),
    "waypoint": (3.84, -0.5906001032, -0.3892236072, 0.76, 0.9741779232, 0.0, 0.0, -0.2257816954, 34.4620014429),
    "far": (4.24, 0.4715347524, -5.2571789285, 0.76, 0.6123566312, 0.0, 0.0, -0.7905816569, 34.4620014429),
    "far3s": (15.0, -1.5910490934, -0.2844283301, 0.76, 0.6899278647, 0.0, 0.0, 0.7238781261, 34.4620014429),
}

UPPER = [joint for joint in range(29) if joint not in G1.leg_joints]


@pytest.fixture(scope="module")
def resting(library: MotionLibrary) -> np.ndarray:
    return resting_poses(library)


def poses(family: str, resting: np.ndarray, count: int = 20) -> np.ndarray:
    chains = author(family, G1, count, seed=3, resting=resting)
    return np.stack([[frame.qpos for frame in chain.sequence.keyframes] for chain in chains])


@pytest.mark.parametrize("timing", [Timing(), Timing(max_steps=150), Timing(control_dt=0.04, max_steps=25)])
@pytest.mark.parametrize("family", [name for name in FAMILIES if name != "far3s"])
def test_a_chain_is_five_keyframes_half_a_second_to_one_apart(family: str, resting: np.ndarray, timing: Timing) -> None:
    for chain in author(family, G1, 20, seed=0, resting=resting, timing=timing):
        times = np.diff([0.0, *(frame.time for frame in chain.sequence.keyframes)])
        assert len(times) == 5
        assert ((times > 0.5 - 1e-9) & (times < 1 + 1e-9)).all()
        commanded = np.diff([0, *chain.sequence.arrival_steps])
        np.testing.assert_allclose(commanded * timing.control_dt, times, atol=1e-9)
        assert chain.hold == (10.0 if family == "hold" else 3.0)
        np.testing.assert_array_equal(chain.sequence.start.qpos, G1.default_qpos)


@pytest.mark.parametrize(("clips", "family", "told"), [(3, "poses", True), (5, "poses", False), (1, "hold", False)])
def test_poses_that_repeat_within_a_chain_are_told(clips: int, family: str, told: bool, caplog) -> None:
    rest = np.tile(G1.default_qpos, (clips, 1))
    author(family, G1, 1, seed=0, resting=rest)
    line = "authored family 'poses': 3 clips with a resting pose, and 5 keyframes a chain: poses repeat"
    assert caplog.messages == ([line] if told else [])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"count": 1.5}, "author: count is 1.5, expected a whole number of at least 1"),
        ({"count": -1}, "author: count is -1, expected a whole number of at least 1"),
        ({"seed": -1}, "author: seed is -1, expected a whole number from 0 to"),
        ({"family": None}, "authored family None, expected one of hold, "),
        ({"robot": "g1"}, "robot is 'g1', expected a Robot"),
        ({"timing": 0.02}, "author: timing is 0.02, expected a Timing or None"),
        (
            {"family": "hold", "resting": np.zeros((5, 7))},
            r"author: resting has shape \(5, 7\), expected poses",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(changes: dict, message: str) -> None:
    with pytest.raises(PlatError, match=message):
        author(**{"family": "arms", "robot": G1, "count": 1, "seed": 0, **changes})


def test_the_same_seed_is_the_same_chains(resting: np.ndarray) -> None:
    first, again, other = (author("arms", G1, 3, seed=seed) for seed in (1, 1, 2))
    for a, b, c in zip(first, again, other, strict=True):
        np.testing.assert_array_equal(a.sequence.keyframes[0].qpos, b.sequence.keyframes[0].qpos)
        assert (a.sequence.keyframes[0].qpos != c.sequence.keyframes[0].qpos).any()


@pytest.mark.parametrize("family", FAMILIES)
def test_a_seed_draws_what_it_always_drew(family: str) -> None:
    rest = np.tile(G1.default_qpos, (3, 1))
    rest[:, 7:] += 0.1 * np.arange(3)[:, None]
    last = author(family, G1, 2, seed=0, resting=rest)[1].sequence.keyframes[-1]
    drawn = [last.time, *last.qpos[:7], last.qpos[7:] @ np.arange(1, 30)]
    np.testing.assert_allclose(drawn, DRAWN[family], rtol=0, atol=1e-8)


def test_arms_move_all_but_the_legs_within_the_middle_of_their_ranges(resting: np.ndarray) -> None:
    chains = poses("arms", resting)
    np.testing.assert_array_equal(chains[..., :7], np.broadcast_to(G1.default_qpos[:7], chains[..., :7].shape))
    legs = 7 + np.array(G1.leg_joints)
    np.testing.assert_array_equal(chains[..., legs], np.broadcast_to(G1.default_qpos[legs], chains[..., legs].shape))
    low, high = G1.joint_range.double().numpy().T
    share = ((chains[..., 7:] - low) / (high - low))[..., UPPER]
    assert 0.2 - 1e-6 <= share.min() < 0.25
    assert 0.75 < share.max() <= 0.8 + 1e-6


@pytest.mark.parametrize(("family", "nearest", "farthest", "turn"), [("steps", 0.25, 0.5, 0.4), ("far", 1.5, 2.5, 2.0)])
def test_ways(resting: np.ndarray, family: str, nearest: float, farthest: float, turn: float) -> None:
    chains = poses(family, resting)
    places = np.concatenate((np.zeros((len(chains), 1, 2)), chains[..., :2]), 1)
    distance = np.linalg.norm(np.diff(places, axis=1), axis=-1)
    assert nearest <= distance.min() < distance.max() <= farthest
    heading = np.unwrap(2 * np.arctan2(chains[..., 6], chains[..., 3]), axis=1)
    assert np.abs(heading[:, 0]).max() <= turn
    np.testing.assert_array_equal(chains[..., 7:], np.broadcast_to(G1.default_qpos[7:], chains[..., 7:].shape))


def test_crouching_keeps_the_feet_in_place_and_the_balance(resting: np.ndarray) -> None:
    chains = poses("crouch", resting, count=4).reshape(-1, 36)
    lowered = G1.root_height - chains[:, 2]
    assert 0.05 <= lowered.min() < lowered.max() <= 0.3
    feet = ForwardKinematics(G1, G1.feet)
    at_rest, _ = feet(*torch.from_numpy(G1.default_qpos).split((3, 4, 29)))
    there, _ = feet(*torch.from_numpy(chains).split((3, 4, 29), -1))
    assert float((there - at_rest).norm(dim=-1).max()) < 0.01
    feasibility = Feasibility(G1)
    for chain in author("crouch", G1, 4, seed=3):
        for frame in chain.sequence.keyframes:
            held = feasibility(frame.at(frame.time - 1.0), frame, held=True)
            assert "support_margin" not in [concern.measure for concern in held]


def test_a_robot_that_stands_lower_crouches_less() -> None:
    small = replace(G1, name="small", root_height=0.38)
    scored = np.stack(
        [frame.qpos for chain in author("crouch", small, 2, seed=0) for frame in chain.sequence.keyframes]
    )
    trained = _chains(FAMILY_TABLE["crouch"], 2, small, torch.empty(0, 36)).flatten(0, 1)
    for poses in (scored, trained.double().numpy()):
        lowered = 0.38 - poses[:, 2]
        assert 0.025 - 1e-6 <= lowered.min() < lowered.max() <= 0.15 + 1e-6


def test_families_command_what_they_are_named_after(resting: np.ndarray) -> None:
    hands = list(hands_of(G1))
    for family, expected in {
        "reach": {"joints": [], "bodies": hands, "root": []},
        "three_point": {"joints": [], "bodies": ["torso_link", *hands], "root": []},
        "waypoint": {"joints": [], "bodies": [], "root": ["horizontal", "orientation"]},
    }.items():
        for frame in author(family, G1, 1, seed=0)[0].sequence.keyframes:
            assert frame.commands is not None
            assert frame.commands.names(G1) == expected
    assert all(frame.whole for frame in author("poses", G1, 1, 0, resting)[0].sequence.keyframes)


@pytest.mark.parametrize("family", ["reach", "three_point"])
def test_hands_reach_in_front_and_above_and_no_links_are_deep_in_each_other(family: str, resting: np.ndarray) -> None:
    chains = poses(family, resting, count=4).reshape(-1, 36)
    places, _ = ForwardKinematics(G1, hands_of(G1))(*torch.from_numpy(chains).split((3, 4, 29), -1))
    root = torch.from_numpy(chains[:, None, :3])
    assert float((places - root)[..., 0].min()) > 0.1
    assert float((places - root)[..., 2].min()) > 0
    assert float(places[..., 1].max() - places[..., 1].min()) > 0.3  # not one place
    feet = ForwardKinematics(G1, G1.feet)
    at_rest, _ = feet(*torch.from_numpy(G1.default_qpos).split((3, 4, 29)))
    there, _ = feet(*torch.from_numpy(chains).split((3, 4, 29), -1))
    assert float((there - at_rest).norm(dim=-1).max()) < 0.01
    feasibility = Feasibility(G1)
    for chain in author(family, G1, 4, seed=3):
        for frame in chain.sequence.keyframes:
            found = feasibility(frame.at(frame.time - 1.0), frame)
            assert "self_penetration" not in [concern.measure for concern in found]


def test_resting_poses_rest(library: MotionLibrary, resting: np.ndarray) -> None:
    assert 0 < len(resting) <= library.num_clips
    assert (resting[:, 2] > 0.55).all()
    low = MotionClip("low", np.tile(G1.default_qpos, (30, 1)) - 0.3 * np.eye(36)[2], 30.0)
    assert len(resting_poses(MotionLibrary.from_clips([low]))) == 0  # its pelvis is at 0.46 m
    small = replace(G1, name="small", root_height=0.46)
    assert len(resting_poses(MotionLibrary.from_clips([low], small))) == 1
    np.testing.assert_array_equal(resting[:, :2], 0)
    heading = 2 * np.arctan2(resting[:, 6], resting[:, 3])
    np.testing.assert_allclose(heading, 0, atol=1e-5)
    chains = poses("hold", resting, count=3)
    np.testing.assert_array_equal(chains[:, 0], chains[:, 4])


def test_three_seconds_stay_for_a_policy_of_three() -> None:
    (chain,) = author("far3s", G1, 1, seed=0, timing=Timing(max_steps=150))
    assert len(chain.sequence) == 5
    assert chain.sequence.arrival_steps == (150, 300, 450, 600, 750)


def test_three_seconds_are_split_for_a_policy_of_one() -> None:
    (chain,) = author("far3s", G1, 1, seed=0)
    assert isinstance(chain.sequence, KeyframeSequence)
    assert len(chain.sequence) == 15
    assert chain.sequence.duration == pytest.approx(15.0)


def test_errors_are_one_line() -> None:
    with pytest.raises(KeyframeError, match="'fly', expected one of hold, arms"):
        author("fly", G1, 1, 0)
    with pytest.raises(KeyframeError, match="'hold' needs resting poses"):
        author("hold", G1, 1, 0)


def test_poses_that_a_robot_cannot_take_end_in_one_line(monkeypatch) -> None:
    knees = ("left_knee_link", "right_knee_link")
    kneeling = replace(G1, name="kneeling", end_effectors=(*G1.feet, *knees))
    monkeypatch.setattr(authored, "_MOST_ROUNDS", 3)
    message = "'reach' cannot be drawn: robot 'kneeling': of 192 poses none has both hands ahead of the body and above"
    with pytest.raises(UndrawableError, match=message):
        author("reach", kneeling, 1, seed=0)
    monkeypatch.setattr(authored, "_MOST_CROUCHES", 2)
    monkeypatch.setattr(authored, "_FOOT_OFF", 0.0)
    message = "'crouch' cannot be drawn: robot 'g1': its feet stay in place in none of 2 crouches, with"
    with pytest.raises(UndrawableError, match=message):
        author("crouch", G1, 1, seed=0)


def test_families_that_a_robot_cannot_take_are_left_out_and_told(library: MotionLibrary, monkeypatch, caplog) -> None:
    monkeypatch.setattr(authored, "_MOST_ROUNDS", 0)
    with caplog.at_level("WARNING", "plat.motions"):
        families = {chain.family for chain in author_families(G1, library, 1)}
    assert "arms" in families
    assert not families & {"reach", "three_point"}
    assert [record.getMessage().split(":")[0] for record in caplog.records if "left out" in record.getMessage()] == [
        "authored family 'reach' cannot be drawn",
        "authored family 'three_point' cannot be drawn",
    ]


def test_families_without_resting_poses_are_left_out_and_told(caplog) -> None:
    sliding = MotionLibrary.from_clips([standing_clip()])
    with caplog.at_level("WARNING", "plat.motions"):
        families = {chain.family for chain in author_families(G1, sliding, 1)}
    assert not families & {"hold", "poses"}
    assert [record.getMessage() for record in caplog.records] == [
        f"authored family {name!r} needs resting poses: give motions that have some; left out"
        for name in ("hold", "poses")
    ]


def test_times_are_on_control_steps_and_intervals_in_their_range() -> None:
    steps = FAMILIES["steps"]
    assert _times(np.array([0.592, 0.999, 0.5, 0.503, 0.75]), steps, Timing()) == [0.6, 1.6, 2.1, 2.6, 3.36]
    # of 30 ms 0.5 to 1 s have 17 to 33 steps, of 0.4 s two; 3 s are between two steps of 0.7 s
    assert _times(np.array([0.5, 1.0, 0.9]), steps, Timing(control_dt=0.03)) == [0.51, 1.5, 2.4]
    assert _times(np.array([0.5, 1.0]), steps, Timing(control_dt=0.4, max_steps=3)) == [0.8, 1.6]
    assert _times(np.array([3.0, 3.0]), FAMILIES["far3s"], Timing()) == [3.0, 6.0]
    assert _times(np.array([3.0, 3.0]), FAMILIES["far3s"], Timing(control_dt=0.7, max_steps=9)) == [3.5, 7.0]


def test_poses_of_a_chain_are_of_different_clips() -> None:
    resting = np.tile(G1.default_qpos, (6, 1))
    resting[:, 7] = np.arange(6) / 10 - 1
    for chain in author("poses", G1, 20, seed=0, resting=resting):
        assert len({frame.joint_pos[0] for frame in chain.sequence.keyframes}) == 5
    few = [author("poses", G1, 1, seed=0, resting=resting[:count])[0] for count in (1, 2)]
    first = [[float(frame.joint_pos[0]) for frame in chain.sequence.keyframes] for chain in few]
    assert first[0] == [-1.0] * 5
    assert set(first[1]) == {-1.0, -0.9}
    assert all(a != b for a, b in pairwise(first[1]))
