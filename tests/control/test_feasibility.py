import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from plat.control.authored import FAMILIES, author
from plat.control.feasibility import Feasibility, FeasibilityLimits, support_margin
from plat.errors import KeyframeError, PlatError
from plat.keyframes import Keyframe, KeyframeSequence, only, standing
from plat.robots import G1
from plat.spec.parts import Parts
from plat.spec.timing import Timing
from tests.crossed import ABOVE, BELOW

STAND = standing(G1)
EXAMPLES = Path(__file__).parents[2] / "recipes" / "examples"


@pytest.fixture(scope="module")
def feasibility() -> Feasibility:
    return Feasibility(G1)


def posed(time: float = 1.0, **angles: float) -> Keyframe:
    joint_pos = STAND.joint_pos.copy()
    for name, angle in angles.items():
        joint_pos[G1.joint_names.index(name)] = angle
    return Keyframe(time, STAND.root_pos, STAND.root_quat, joint_pos)


def measures(concerns) -> list[str]:
    return [concern.measure for concern in concerns]


def test_standing_still_is_fine(feasibility: Feasibility) -> None:
    assert feasibility(STAND, STAND.at(0.02), held=True) == ()


def test_a_fast_joint_is_named_with_its_speed(feasibility: Feasibility) -> None:
    knee = STAND.joint_pos[G1.joint_names.index("left_knee")]
    (concern,) = feasibility(STAND, posed(0.1, left_knee=knee + 1.4))
    assert (concern.measure, concern.subject) == ("joint_speed", "left_knee")
    assert concern.value == pytest.approx(28.0)
    assert str(concern) == "left_knee would need 28 rad/s, expected at most 20"
    assert feasibility(STAND, posed(0.2, left_knee=knee + 1.4)) == ()


def test_what_is_a_little_beyond_a_limit_does_not_read_as_the_limit(feasibility: Feasibility) -> None:
    knee = STAND.joint_pos[G1.joint_names.index("left_knee")]
    (concern,) = feasibility(STAND, posed(0.1, left_knee=knee + 1.02))
    assert str(concern) == "left_knee would need 20.4 rad/s, expected at most 20"
    turned = replace(STAND.at(0.5), root_quat=np.array([np.cos(0.8), 0, 0, np.sin(0.8)]))  # 1.6 rad
    (concern,) = feasibility(STAND, turned)
    assert str(concern) == "the turn would need 6.4 rad/s, expected at most 6"
    (concern,) = feasibility(STAND, posed(0.1, left_knee=knee + 1.001))
    assert str(concern) == "left_knee would need 20.02 rad/s, expected at most 20"
    (concern,) = Feasibility(G1, FeasibilityLimits(joint_speed=6.25))(STAND, posed(0.1, left_knee=knee + 0.314))
    assert str(concern) == "left_knee would need 6.3 rad/s, expected at most 6.25"


def test_the_fastest_joint_comes_first(feasibility: Feasibility) -> None:
    concerns = feasibility(STAND, posed(0.1, left_elbow=2.0, right_elbow=1.8))
    assert [concern.subject for concern in concerns] == ["left_elbow", "right_elbow"]


@pytest.mark.parametrize(
    ("distance", "seconds", "expected"),
    [
        (0.5, 0.5, []),
        (2.0, 3.0, []),
        (2.5, 1.0, ["root_speed", "root_acceleration"]),
        (0.3, 0.2, ["root_acceleration"]),
    ],
)
def test_going_somewhere(feasibility: Feasibility, distance: float, seconds: float, expected: list[str]) -> None:
    away = Keyframe(seconds, STAND.root_pos + np.array([0, distance, 0]), STAND.root_quat, STAND.joint_pos)
    assert measures(feasibility(STAND, away)) == expected


def test_a_turn_counts_by_the_shorter_way(feasibility: Feasibility) -> None:
    around = np.array([np.cos(1.5), 0, 0, np.sin(1.5)])  # 3 rad
    assert measures(feasibility(STAND, replace(STAND.at(0.5), root_quat=around))) == ["turn_speed"]
    assert feasibility(STAND, replace(STAND.at(1.5), root_quat=around)) == ()
    assert feasibility(STAND, replace(STAND.at(0.5), root_quat=-STAND.root_quat)) == ()


def test_a_lean_tips_over_only_where_it_is_held(feasibility: Feasibility) -> None:
    lean = posed(left_ankle_pitch=-0.8, right_ankle_pitch=-0.8)
    # the soles stay flat on the floor when the root is turned by what the ankles give
    pitch = 0.8 - 0.363
    lean = Keyframe(
        1.0, np.array([0.3, 0, 0.70]), np.array([np.cos(pitch / 2), 0, np.sin(pitch / 2), 0]), lean.joint_pos
    )
    assert measures(feasibility(STAND, lean)) == []
    (concern,) = feasibility(STAND, lean, held=True)
    assert concern.measure == "support_margin"
    assert concern.value < 0
    assert "outside the feet" in concern.words


def test_feet_in_the_air_and_in_the_floor(feasibility: Feasibility) -> None:
    for height, expected in ((0.2, ["floating"]), (-0.1, ["floor_penetration"])):
        pose = Keyframe(1.0, STAND.root_pos + np.array([0, 0, height]), STAND.root_quat, STAND.joint_pos)
        assert measures(feasibility(STAND, pose, held=True)) == expected


def test_links_inside_each_other(feasibility: Feasibility) -> None:
    (concern,) = feasibility(STAND, posed(left_shoulder_roll=-1.2))
    assert concern.measure == "self_penetration"
    assert "left_" in concern.subject
    assert re.match(r"\w+ and \w+ are \d+ cm inside each other$", concern.words)


def test_forearms_that_would_go_through_each_other(feasibility: Feasibility) -> None:
    assert feasibility(STAND, ABOVE) == feasibility(STAND, BELOW) == ()
    (concern,) = feasibility(ABOVE, BELOW)
    assert concern.measure == "way_penetration"
    assert concern.limit < concern.value < 0.1
    assert re.match(r"left_\w+ and right_\w+ would get \d cm into each other on the straight way there$", concern.words)
    assert Feasibility(G1, FeasibilityLimits(way_penetration=0.1))(ABOVE, BELOW) == ()


@pytest.mark.parametrize(
    ("commands", "expected"),
    [
        (Parts.only(G1, bodies=["left_wrist_yaw_link", "right_wrist_yaw_link"]), ["way_penetration"]),
        (Parts.only(G1, bodies=["left_wrist_yaw_link"]), []),
        (Parts.only(G1, joints=[name for name in G1.joint_names if "leg" not in name]), ["way_penetration"]),
        (Parts.only(G1, joints=[name for name in G1.joint_names if "left" in name]), []),
        (Parts.only(G1, root=["height"]), []),
    ],
)
def test_a_hand_that_is_free_moves_out_of_the_way(feasibility: Feasibility, commands, expected) -> None:
    assert measures(feasibility(ABOVE, replace(BELOW, commands=commands))) == expected


def test_a_way_out_of_a_pose_that_was_doubted_is_not_doubted_as_well(feasibility: Feasibility) -> None:
    folded = posed(1.0, left_shoulder_roll=-1.2)
    assert feasibility(folded, STAND.at(2.0)) == ()
    assert measures(feasibility(STAND, folded)) == ["self_penetration"]


def test_hands_in_the_body(feasibility: Feasibility) -> None:
    folded = posed(left_shoulder_roll=-1.2)
    for hand, expected in (("left", ["self_penetration"]), ("right", [])):
        commands = Parts.only(G1, bodies=[f"{hand}_wrist_yaw_link"])
        assert measures(feasibility(STAND, replace(folded, commands=commands))) == expected


def test_hands_that_meet_may_turn_out_of_each_other(feasibility: Feasibility) -> None:
    """Of the shipped circle the hands are drawn through each other in three keyframes, in one at one place."""
    drawn = KeyframeSequence.load(EXAMPLES / "hands.json", G1)
    whole = [feasibility(STAND, replace(keyframe, commands=None)) for keyframe in drawn.keyframes]
    assert [number for number, found in enumerate(whole) if "self_penetration" in measures(found)] == [3, 4, 5]
    found = feasibility.sequence(drawn)
    assert [number for number, concerns in enumerate(found) if concerns] == [4]
    assert measures(found[4]) == ["self_penetration"]
    yaw = Parts.only(G1, joints=["left_wrist_yaw", "right_wrist_yaw"])
    turned = replace(drawn.keyframes[3].commands, joints=yaw.joints)  # they are not free to
    assert measures(feasibility(STAND, replace(drawn.keyframes[3], commands=turned))) == ["self_penetration"]


def test_of_a_partial_keyframe_only_what_it_commands_is_measured(feasibility: Feasibility) -> None:
    """The whole pose is far away, in the air, bent into itself and held."""
    there = posed(0.1, left_shoulder_roll=-1.2, left_knee=2.0)
    there = replace(there, root_pos=STAND.root_pos + np.array([2.0, 0, 0.2]))
    assert len(feasibility(STAND, there, held=True)) > 3
    elbow = replace(there, commands=Parts.only(G1, joints=["left_elbow"]))
    assert feasibility(STAND, elbow, held=True) == ()
    height = replace(there, commands=Parts.only(G1, root=["height"]))
    assert feasibility(STAND, height, held=True) == ()
    away = replace(there, commands=Parts.only(G1, root=["horizontal"]))
    assert measures(feasibility(STAND, away)) == ["root_speed", "root_acceleration"]


def test_bodies_that_are_too_far_or_below_the_floor(feasibility: Feasibility) -> None:
    hand = Parts.only(G1, bodies=["left_wrist_yaw_link"])
    away = replace(STAND.at(0.2), root_pos=STAND.root_pos + np.array([2.0, 0, 0]), commands=hand)
    (concern,) = feasibility(STAND, away)
    assert (concern.measure, concern.subject) == ("body_speed", "left_wrist_yaw_link")
    assert concern.value == pytest.approx(20.0)
    below = replace(STAND.at(2.0), root_pos=STAND.root_pos - np.array([0, 0, 1.2]), commands=hand)
    (concern,) = feasibility(STAND, below)
    assert concern.measure == "floor_penetration"
    assert re.match(r"left_wrist_yaw_link is \d+ cm inside the floor$", concern.words)


def test_a_commanded_height_under_the_floor(feasibility: Feasibility) -> None:
    low = only(G1, 2.0, height=-0.5)
    assert list(map(str, feasibility(STAND, low))) == ["root is 50 cm inside the floor"]
    elsewhere = replace(low, commands=Parts.only(G1, root=["horizontal"]))
    assert feasibility(STAND, elsewhere) == ()


@pytest.mark.parametrize(("up", "words"), [(3.0, "3.0 m up"), (-0.36, "0.4 m down")])
def test_a_root_that_moves_up_or_down_too_fast(feasibility: Feasibility, up: float, words: str) -> None:
    """As tall as a person and more in a second, and into the knees in a control step."""
    seconds = 1.0 if up > 0 else 0.02
    there = replace(STAND.at(seconds), root_pos=STAND.root_pos + np.array([0, 0, up]))
    for commands in (None, Parts.only(G1, root=["height"])):
        found = feasibility(STAND, replace(there, commands=commands))
        concern = next(concern for concern in found if concern.measure == "vertical_speed")
        assert concern.value == pytest.approx(2 * abs(up) / seconds)
        assert str(concern).startswith(f"{words} in {seconds:.2f} s takes ")
    elsewhere = replace(there, commands=Parts.only(G1, root=["horizontal"]))
    assert feasibility(STAND, elsewhere) == ()
    slow = replace(there.at(20.0), commands=Parts.only(G1, root=["height"]))
    assert measures(feasibility(STAND, slow)) == (["clearance"] if up > 0 else [])


def test_a_robot_that_hangs_in_the_air(feasibility: Feasibility) -> None:
    for up, expected in ((0.5, []), (0.8, ["clearance"])):
        there = replace(STAND.at(2.0), root_pos=STAND.root_pos + np.array([0, 0, up]))
        assert measures(feasibility(STAND, there)) == expected
        assert measures(feasibility(STAND, there, held=True)) == ["floating"]
        height = replace(there, commands=Parts.only(G1, root=["height"]))
        assert measures(feasibility(STAND, height)) == expected
    (concern,) = feasibility(STAND, there)
    assert str(concern) == "the robot is 80 cm above the floor, higher than a jump"
    assert str(feasibility(STAND, height)[0]) == "root is 80 cm above where it is in standing, higher than a jump"
    lying = replace(there, root_pos=np.array([0, 0, 0.1]), root_quat=np.array([0.5**0.5, 0, -(0.5**0.5), 0]))
    assert "clearance" not in measures(feasibility(STAND, lying)), "its legs may be anywhere"


@pytest.mark.parametrize("family", FAMILIES)
def test_what_people_draw_is_neither_too_high_nor_too_fast_upward(feasibility: Feasibility, family: str) -> None:
    timing = Timing(max_steps=150)
    for chain in author(family, G1, 2, 0, STAND.qpos[None], timing):
        found = {concern.measure for concerns in feasibility.sequence(chain.sequence) for concern in concerns}
        assert not found & {"vertical_speed", "clearance"}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"root_quat": np.zeros(4)}, "root_quat has length 0, expected 1"),
        ({"root_quat": np.array([1.02, 0, 0, 0])}, "root_quat has length 1.02, expected 1"),
        ({"joint_pos": np.full(29, np.nan)}, r"joint_pos\[0\] is nan, expected a finite number"),
        ({"joint_pos": STAND.joint_pos + 3 * np.eye(29)[3]}, "joint_pos: 'left_knee' is 3.669 rad, .* to 2.88"),
        ({"root_pos": np.array([0, 0, 760.0])}, "root_pos puts the root at a height of 760 m, expected meters"),
        ({"root_pos": None}, "root_pos has shape"),
        ({"commands": "hands"}, "commands is 'hands', expected plat.keyframes.Parts"),
        ({"time": float("nan")}, "time is nan, expected a finite number of seconds"),
    ],
)
def test_what_no_file_may_hold_is_refused(feasibility: Feasibility, changes, message: str) -> None:
    good = STAND.at(1.0)
    with pytest.raises(KeyframeError, match=f"^after: {message}"):
        feasibility(STAND, replace(good, **changes))
    with pytest.raises(KeyframeError, match=f"^before: {message}"):
        feasibility(replace(STAND, **changes), good)


def test_a_quaternion_within_what_files_allow_is_that_of_unit_length(feasibility: Feasibility) -> None:
    turned = replace(STAND.at(0.5), root_quat=np.array([np.cos(0.8), 0, 0, np.sin(0.8)]))
    longer = replace(turned, root_quat=1.009 * turned.root_quat)
    assert feasibility(STAND, longer) == feasibility(STAND, turned)
    assert feasibility(STAND, replace(STAND.at(0.5), root_quat=0.991 * STAND.root_quat)) == ()


def test_what_is_no_robot_limits_or_keyframe_is_refused(feasibility: Feasibility) -> None:
    with pytest.raises(PlatError, match="robot is None, expected a Robot"):
        Feasibility(None)
    with pytest.raises(PlatError, match="Feasibility: limits is 3, expected a FeasibilityLimits or None"):
        Feasibility(G1, 3)
    with pytest.raises(PlatError, match="FeasibilityLimits: joint_speed is nan, expected a number of at least 0"):
        FeasibilityLimits(joint_speed=float("nan"))
    with pytest.raises(PlatError, match="before is None, expected a Keyframe"):
        feasibility(None, STAND)
    with pytest.raises(PlatError, match="keyframes is None, expected a KeyframeSequence"):
        feasibility.sequence(None)


def test_limits_are_the_callers() -> None:
    strict = Feasibility(G1, FeasibilityLimits(joint_speed=0.1))
    assert measures(strict(STAND, posed(left_elbow=0.8))) == ["joint_speed"]
    high = replace(STAND.at(0.5), root_pos=STAND.root_pos + np.array([0, 0, 3.0]))
    free = Feasibility(G1, FeasibilityLimits(vertical_speed=float("inf"), clearance=float("inf")))
    assert free(STAND, high) == ()


def test_the_last_keyframe_of_a_sequence_is_held(feasibility: Feasibility) -> None:
    jump = Keyframe(0.5, STAND.root_pos + np.array([0, 0, 0.2]), STAND.root_quat, STAND.joint_pos)
    landing = feasibility.sequence(KeyframeSequence(G1, STAND, (jump, STAND.at(1.0))))
    assert [measures(concerns) for concerns in landing] == [[], []]
    assert [measures(concerns) for concerns in feasibility.sequence(KeyframeSequence(G1, STAND, (jump,)))] == [
        ["floating"]
    ]


def test_a_keyframe_that_the_next_one_repeats_is_held(feasibility: Feasibility) -> None:
    jump = Keyframe(0.5, STAND.root_pos + np.array([0, 0, 0.2]), STAND.root_quat, STAND.joint_pos)
    hold = feasibility.sequence(KeyframeSequence(G1, STAND, (jump, jump.at(1.0), STAND.at(1.5))))
    assert [measures(concerns) for concerns in hold] == [["floating"], [], []]


def test_margin_of_a_line_and_of_a_point() -> None:
    assert support_margin(np.array([0.0, 0.3]), [[-1, 0], [1, 0]]) == pytest.approx(-0.3, abs=1e-4)
    assert support_margin(np.array([0.5, 0.0]), [[-1, 0], [1, 0]]) == pytest.approx(0.0, abs=1e-9)
    assert support_margin(np.array([3.0, 4.0]), [[0, 0]]) == pytest.approx(-5.0, abs=1e-3)


def test_a_way_begins_where_the_robot_was_last_commanded_to_be(feasibility: Feasibility) -> None:
    """The elbow's keyframe is drawn at the origin, which says nothing of where the robot is."""
    way, elbow = only(G1, 3.0, root=(2.0, 0.0)), only(G1, 4.0, joints={"right_elbow": 1.2})
    near, far = only(G1, 4.5, root=(2.1, 0.0)), only(G1, 4.5, root=(0.1, 0.0))
    for last, expected in ((near, []), (far, ["root_speed", "root_acceleration"])):
        *_, concerns = feasibility.sequence(KeyframeSequence(G1, STAND, (way, elbow, last), Timing(max_steps=150)))
        assert measures(concerns) == expected
