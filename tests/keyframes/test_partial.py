import json
from dataclasses import replace

import numpy as np
import pytest

from plat.deploy.kinematics import KeypointKinematics
from plat.errors import KeyframeError
from plat.keyframes import KeyframeSequence, Parts, only, split_long_intervals, standing
from plat.keyframes.roots import with_commanded_root
from plat.robots import G1
from plat.robots.describe import describe_robot
from plat.spec.timing import Timing

LEFT, RIGHT = "left_wrist_yaw_link", "right_wrist_yaw_link"


def place(keyframe, body):
    points = KeypointKinematics(describe_robot(G1, control_dt=0.02))(
        keyframe.root_pos, keyframe.root_quat, keyframe.joint_pos
    )
    return points[G1.keypoints.index(body)]


@pytest.mark.parametrize("left", [(0.35, 0.2, 0.95), (0.1, 0.4, 1.2), (0.2, 0.25, 0.75)])
def test_hands_are_where_they_are_asked_to_be(left):
    right = (left[0], -left[1], left[2])
    keyframe = only(G1, 1.0, left_hand=left, right_hand=right)
    np.testing.assert_allclose(place(keyframe, LEFT), left, atol=0.005)
    np.testing.assert_allclose(place(keyframe, RIGHT), right, atol=0.005)
    assert keyframe.commands == Parts.only(G1, bodies=(LEFT, RIGHT))
    # nothing but the arms and the waist moved
    moved = np.abs(keyframe.joint_pos - standing(G1).joint_pos) > 1e-6
    assert not moved[G1.leg_joints].any()
    np.testing.assert_array_equal(keyframe.root_pos, standing(G1).root_pos)


def test_places_that_extreme_poses_reach_are_reached():
    random = np.random.default_rng(0)
    free = [index for index, name in enumerate(G1.joint_names) if index not in G1.leg_joints]
    low, high = np.asarray(G1.joint_range, dtype=np.float64)[free].T
    for number in range(8):
        share = random.uniform(size=len(free))
        pose = standing(G1)
        pose.joint_pos[free] = low + (share.round() if number % 3 == 0 else share) * (high - low)
        left, right = place(pose, LEFT), place(pose, RIGHT)
        keyframe = only(G1, 1.0, left_hand=left, right_hand=right)
        np.testing.assert_allclose(place(keyframe, LEFT), left, atol=0.006)
        np.testing.assert_allclose(place(keyframe, RIGHT), right, atol=0.006)
    again = only(G1, 1.0, left_hand=left, right_hand=right)
    np.testing.assert_array_equal(keyframe.joint_pos, again.joint_pos)


def test_a_hand_out_of_reach_needs_a_pose_that_is_near():
    wanted = (1.85, 0.2, 1.0)
    with pytest.raises(KeyframeError, match=rf"'{LEFT}' comes no nearer than 1.\d\d m to \[1.85, 0.2, 1.0\].*base="):
        only(G1, 1.0, left_hand=wanted)
    near = replace(standing(G1), root_pos=np.array([1.5, 0.0, G1.root_height]))
    np.testing.assert_allclose(place(only(G1, 1.0, left_hand=wanted, base=near), LEFT), wanted, atol=0.005)


def test_a_waypoint_commands_place_and_heading():
    keyframe = only(G1, 2.0, root=(1.0, 0.5), heading=np.pi / 2, name="there")
    assert keyframe.commands.names(G1) == {"joints": [], "bodies": [], "root": ["horizontal", "orientation"]}
    np.testing.assert_allclose(keyframe.root_pos, (1.0, 0.5, G1.root_height))
    np.testing.assert_allclose(keyframe.root_quat, (np.sqrt(0.5), 0, 0, np.sqrt(0.5)))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({}, "nothing is commanded"),
        ({"left_hand": (1, 2)}, "expected 3 finite numbers"),
        ({"bodies": {"left_tail": (0, 0, 0)}}, "left_tail"),
        ({"joints": {"left_elbow": 99.0}}, "left_elbow"),
        ({"root": (0.0, float("nan"))}, "root is"),
        ({"height": "low"}, "height is 'low', expected a finite number"),
        ({"heading": "north"}, "heading is 'north', expected a finite number"),
        ({"height": "0.7"}, "height is '0.7', expected a finite number"),
        ({"joints": {"left_elbow": True}}, "joints: 'left_elbow' is True, expected a finite number"),
        ({"joints": ["left_elbow"]}, r"joints is \['left_elbow'\], expected values by name"),
        ({"height": 0.7, "base": replace(standing(G1), joint_pos=np.zeros(3))}, r"joint_pos has shape \(3,\)"),
        ({"root": (1e9, 0)}, r"puts the root 1e\+09 m away"),
        ({"heading": 90}, "heading is 90 rad, expected at most 6.28"),
        ({"height": 76}, "height is 76 m, expected at most 5"),
        ({"bodies": {"pelvis": (0, 0, 0.5)}}, "'pelvis' comes no nearer than 0.26 m"),
        (
            {"left_hand": (0.3, 0.2, 0.9), "joints": dict.fromkeys(G1.joint_names, 0.0)},
            "'left_wrist_yaw_link' comes no nearer than",
        ),
        (
            {"left_hand": (0.3, 0.2, 0.9), "bodies": {"left_wrist_yaw_link": (0.3, 0.3, 0.9)}},
            "left_hand: 'left_wrist_yaw_link' is among bodies as well",
        ),
        ({"joints": {"left_elbow": [1, 2]}}, "joints: 'left_elbow' is"),
        ({"height": 10**400}, "height is 1000.*000, expected a finite number"),
        ({"left_hand": (10**400, 0, 0)}, "is .1000.*000, 0, 0., expected 3 finite numbers"),
    ],
)
def test_bad_parts_are_named(given, message):
    with pytest.raises(KeyframeError, match=message):
        only(G1, 1.0, **given)


def test_a_pelvis_that_is_where_it_is_asked_to_be():
    place = tuple(standing(G1).root_pos)
    assert only(G1, 1.0, bodies={"pelvis": place}).commands == Parts.only(G1, bodies=("pelvis",))


def test_a_joint_may_be_called_as_in_robots_own_files_and_once():
    assert only(G1, 0.5, joints={"left_knee_joint": 0.4}).commands.names(G1)["joints"] == ["left_knee"]
    with pytest.raises(KeyframeError, match="name one joint twice"):
        only(G1, 0.5, joints={"left_knee_joint": 0.4, "left_knee": 0.5})


@pytest.mark.parametrize("time", ["1.0", None, [1.0], float("nan")])
def test_a_time_that_is_no_number(time):
    with pytest.raises(KeyframeError, match="time is .*, expected a finite number"):
        only(G1, time, joints={"left_elbow": 0.5})


def test_files_keep_what_is_commanded(tmp_path):
    start = standing(G1)
    sequence = KeyframeSequence(G1, start, (only(G1, 0.5, left_hand=(0.3, 0.2, 0.9)), start.at(1.0)))
    path = tmp_path / "hands.json"
    sequence.save(path)
    content = json.loads(path.read_text())
    assert content["version"] == 2
    assert content["keyframes"][0]["commands"] == {"bodies": [LEFT]}
    assert "commands" not in content["keyframes"][1]
    again = KeyframeSequence.load(path, G1)
    assert again.keyframes[0].commands == sequence.keyframes[0].commands
    assert again.keyframes[1].whole
    assert again.partial is again.keyframes[0]


def test_whole_keyframes_are_written_as_version_1(tmp_path):
    start = standing(G1)
    KeyframeSequence(G1, start, (start.at(1.0),)).save(tmp_path / "whole.json")
    assert json.loads((tmp_path / "whole.json").read_text())["version"] == 1


@pytest.mark.parametrize(
    ("version", "commands", "message"),
    [
        (1, {"bodies": [LEFT]}, "commands is a field of version 2, and version is 1"),
        (2, {"bodies": ["left_tail"]}, "commands: parts: bodies has 'left_tail'"),
        (2, {"hands": [LEFT]}, "commands: unknown field 'hands'"),
        (2, {"bodies": LEFT}, "commands: bodies is"),
        (2, [LEFT], "commands is"),
        (2, {}, "nothing is commanded"),
        (True, {"bodies": [LEFT]}, "version is"),
        (3, {"bodies": [LEFT]}, "version is 3, this plat reads up to 2: update plat"),
    ],
)
def test_broken_commands_are_one_line(tmp_path, version, commands, message):
    path = tmp_path / "broken.json"
    KeyframeSequence(G1, standing(G1), (only(G1, 0.5, left_hand=(0.3, 0.2, 0.9)),)).save(path)
    content = json.loads(path.read_text())
    content["version"], content["keyframes"][0]["commands"] = version, commands
    path.write_text(json.dumps(content))
    with pytest.raises(KeyframeError, match=message) as error:
        KeyframeSequence.load(path, G1)
    assert "\n" not in str(error.value)


def test_a_split_keyframe_stays_partial():
    sequence = KeyframeSequence(G1, standing(G1), (only(G1, 2.5, root=(2.0, 0.0)),), Timing(max_steps=150))
    split = sequence.with_timing(Timing(), split=True)
    assert len(split) == 3
    assert {keyframe.commands for keyframe in split.keyframes} == {sequence.keyframes[0].commands}


def test_a_start_is_written_without_commands(tmp_path):
    reach = only(G1, 0.5, left_hand=(0.3, 0.2, 0.9))
    KeyframeSequence(G1, reach.at(0.0), (reach,)).save(tmp_path / "reach.json")
    again = KeyframeSequence.load(tmp_path / "reach.json", G1)
    assert again.start.whole
    np.testing.assert_array_equal(again.start.qpos, reach.qpos)
    assert again.keyframes[0].commands == reach.commands


WAY, ELBOW, ON = only(G1, 1.0, root=(2.0, 0.0)), only(G1, 2.0, joints={"right_elbow": 1.2}), only(G1, 4.0, root=(3, 0))


def test_a_long_way_begins_where_the_robot_was_last_commanded_to_be():
    split = split_long_intervals(standing(G1), (WAY, ELBOW, ON))
    assert [keyframe.root_pos[0] for keyframe in split[2:]] == [2.5, 3.0]
    hands = only(G1, 2.0, left_hand=(0.35, 0.2, 1.0))
    split = split_long_intervals(standing(G1), (WAY, hands, ON))
    assert [keyframe.root_pos[0] for keyframe in split[2:]] == [1.5, 3.0], "the hand was at the origin"


def test_a_sequence_says_where_the_root_is_and_where_it_is_commanded_to_be():
    low = replace(standing(G1), root_pos=np.array([0.0, 0.0, 0.3]))
    drawn_low = replace(low.at(5.0), commands=Parts.only(G1, bodies=(LEFT,)))
    sequence = KeyframeSequence(G1, standing(G1), (WAY, ELBOW, ON, drawn_low), Timing(max_steps=150))
    for pose in (sequence.sample, sequence.commanded):
        np.testing.assert_allclose([pose(time).root_pos[0] for time in (1.0, 1.5, 2.0, 3.0)], [2.0, 2.0, 2.0, 2.5])
    assert sequence.sample(5.0).root_pos[2] == 0.3, "the hand's place is that of the drawn pose"
    np.testing.assert_allclose(sequence.commanded(5.0).root_pos, (3.0, 0.0, G1.root_height))


@pytest.mark.parametrize(
    ("commands", "commanded"),
    [
        ({"root": ["horizontal"]}, ("x", "y")),
        ({"root": ["height"]}, ("z",)),
        ({"root": ["orientation"]}, ("turn",)),
        ({"bodies": ["pelvis"]}, ("x", "y", "z")),
        ({"joints": ["left_elbow"]}, ()),
    ],
)
def test_what_is_not_commanded_of_a_root_is_as_before(commands, commanded):
    before = standing(G1)
    turned = np.array([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    after = replace(before, root_pos=before.root_pos + 0.1, root_quat=turned, commands=Parts.only(G1, **commands))
    found = with_commanded_root(before, after)
    changed = dict(zip("xyz", found.root_pos != before.root_pos, strict=True)) | {"turn": found.root_quat[3] > 0}
    assert tuple(part for part, new in changed.items() if new) == commanded
    np.testing.assert_array_equal(found.joint_pos, after.joint_pos)
