import json
from dataclasses import replace

import pytest

from plat.errors import RobotError
from plat.robots import G1, Capsule, get_robot, register_robot

CAPSULE = {"start": [0, 0, 0], "end": [0.1, 0, 0], "radius": 0.02}


def describe(path, **changes) -> None:
    fields = {
        "name": "described",
        "asset": "g1.xml",
        "root_height": 0.76,
        "default_pose": {"left_knee": 0.3},
        "keypoints": list(G1.keypoints),
        "anchor": G1.anchor,
        "end_effectors": list(G1.end_effectors),
        "feet": list(G1.feet),
    }
    path.write_text(json.dumps({**fields, **changes}))


def test_names_are_of_one_robot():
    assert register_robot(G1) is G1
    with pytest.raises(RobotError, match="robot 'g1' is registered already with other settings"):
        register_robot(replace(G1, root_height=1.0))
    assert get_robot("g1") is G1


def test_an_unknown_name_tells_the_known_ones():
    with pytest.raises(
        RobotError, match=r"robot 'h1' is unknown, expected one of \[.*'g1'.*register_robot.*--robot PATH"
    ):
        get_robot("h1")


def test_a_description_file_is_read_and_registered(tmp_path, monkeypatch):
    describe(tmp_path / "robot.json")
    robot = get_robot(tmp_path / "robot.json")
    assert robot.default_joint_pos[robot.joint_names.index("left_knee")] == pytest.approx(0.3)
    assert get_robot("described") is robot
    assert get_robot(tmp_path / "robot.json") is robot
    monkeypatch.setenv("HOME", str(tmp_path))
    assert get_robot("~/robot.json") is robot


def test_a_keyframe_file_is_no_description(tmp_path):
    (tmp_path / "bow.json").write_text('{"format": "plat-keyframes", "version": 1}')
    with pytest.raises(RobotError, match="bow.json': is of format 'plat-keyframes', expected a robot's description"):
        get_robot(tmp_path / "bow.json")


def test_an_asset_that_is_called_like_one_of_plat_is_the_one_beside(tmp_path):
    """Who copies the G1's file and makes it heavier would train on the G1 as it was."""
    text = G1.asset_path.read_text()
    (tmp_path / "g1.xml").write_text(text.replace('name="pelvis"', 'name="pelvis" gravcomp="1"', 1))
    describe(tmp_path / "robot.json", name="edited", asset="g1.xml")
    robot = get_robot(tmp_path / "robot.json")
    assert robot.asset_path == tmp_path / "g1.xml"
    assert robot.model().body_gravcomp[1] == 1


def test_an_asset_is_relative_to_its_description(tmp_path):
    (tmp_path / "mine.xml").write_bytes(G1.asset_path.read_bytes())
    describe(tmp_path / "robot.json", name="beside", asset="mine.xml")
    robot = get_robot(tmp_path / "robot.json")
    assert robot.asset_path == tmp_path / "mine.xml"
    assert robot.num_joints == 29


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"root_height": "tall"}, "root_height is 'tall', expected a number above 0 and at most 5"),
        ({"root_height": 0}, "root_height is 0, expected a number above 0"),
        ({"root_height": -0.7}, "root_height is -0.7, expected a number above 0"),
        ({"root_height": 76}, "root_height is 76, expected a number above 0 and at most 5"),
        ({"root_height": True}, "root_height is True, expected a number above 0"),
        ({"root_heigth": 0.7}, "unknown field 'root_heigth', perhaps 'root_height'"),
        ({"color": "red"}, "unknown field 'color', expected name, asset, root_height, "),
        ({"feet": ["left"]}, r"feet is \('left',\), expected 2 values, each a text"),
        (
            {"feet": [G1.feet[0], G1.feet[0]]},
            "feet: 'left_ankle_roll_link' twice, expected the left and the",
        ),
        ({"name": " "}, "name is ' ', expected a text that is not empty"),
        ({"name": 3}, "name is 3, expected a text that is not empty"),
        ({"asset": None}, "asset is None, expected a text"),
        ({"default_pose": [0.1]}, "default_pose is .*, expected a dict"),
        ({"default_pose": {"left_knee": "bent"}}, "default_pose: 'left_knee' is 'bent', expected a number"),
        ({"default_pose": {"left_knee_joint": 0.3}}, "default_pose names no joint .*, perhaps 'left_knee'"),
        ({"default_pose": {"left_knee": 17.0}}, "default_pose: 'left_knee' at 17 rad, expected an angle within"),
        ({"keypoints": []}, r"keypoints is \(\), expected a tuple, each a text and at least one"),
        ({"keypoints": "pelvis"}, "keypoints is 'pelvis', expected a tuple"),
        ({"keypoints": [*G1.keypoints, "left_hand"]}, "keypoints: body 'left_hand' is not in "),
        ({"anchor": "torso_lnk"}, "anchor: 'torso_lnk' is not among its keypoints, perhaps 'torso_link'"),
        ({"end_effectors": ["left_toe"]}, "end_effectors: 'left_toe' is not among its keypoints"),
        ({"sole_capsules": [3]}, r"sole_capsules\[0\]: holds 3, expected an object"),
        ({"sole_capsules": [{"start": [0, 0, 0]}]}, r"sole_capsules\[0\]: end is missing"),
        ({"sole_capsules": [{**CAPSULE, "radious": 1}]}, r"sole_capsules\[0\]: unknown field .*, perhaps 'radius'"),
        ({"sole_capsules": [{**CAPSULE, "radius": -0.01}]}, "sole capsule: radius is -0.01, expected a number above 0"),
        ({"sole_capsules": [{**CAPSULE, "end": [0, 0]}]}, r"sole capsule: end is \(0, 0\), expected 3 values"),
        ({"asset": "nowhere.xml"}, "asset '.*nowhere.xml': no such file"),
        ({"asset": "x" * 5000}, "asset '.*x': no such file"),
        ({"asset": "a\0.xml"}, "asset .* holds a null byte, expected a path"),
    ],
)
def test_a_wrong_field_is_named(tmp_path, change, message):
    describe(tmp_path / "robot.json", **{"name": "wrong", **change})
    with pytest.raises(RobotError, match=message) as caught:
        get_robot(tmp_path / "robot.json")
    assert str(caught.value).startswith(f"{str(tmp_path / 'robot.json')!r}: ")
    assert "\n" not in str(caught.value)
    with pytest.raises(RobotError, match="is unknown"):  # what is wrong is not registered
        get_robot("wrong")


@pytest.mark.parametrize("number", ["NaN", "Infinity", "1e999"])
def test_a_number_that_is_none(tmp_path, number):
    describe(tmp_path / "robot.json", name="wrong")
    text = (tmp_path / "robot.json").read_text().replace("0.76", number)
    (tmp_path / "robot.json").write_text(text)
    with pytest.raises(RobotError, match=r"robot.json': (holds|.* root_height is inf, expected a number)"):
        get_robot(tmp_path / "robot.json")


def test_a_missing_field_is_named(tmp_path):
    describe(tmp_path / "robot.json")
    fields = json.loads((tmp_path / "robot.json").read_text())
    del fields["anchor"]
    (tmp_path / "robot.json").write_text(json.dumps(fields))
    with pytest.raises(RobotError, match="robot.json': anchor is missing"):
        get_robot(tmp_path / "robot.json")


def test_capsules_are_those_of_the_file(tmp_path):
    describe(tmp_path / "robot.json", name="shod", sole_capsules=[CAPSULE])
    assert get_robot(tmp_path / "robot.json").sole_capsules == (Capsule((0, 0, 0), (0.1, 0, 0), 0.02),)


def test_what_is_read_otherwise_is_said_once(tmp_path, capsys):
    text = G1.asset_path.read_text()
    (tmp_path / "clipped.xml").write_text(text.replace("<position kp", '<position inheritrange="1" kp'))
    describe(tmp_path / "robot.json", name="clipped", asset="clipped.xml")
    for _ in range(2):
        get_robot(tmp_path / "robot.json")
    (line,) = capsys.readouterr().err.splitlines()
    assert "clipped.xml: the ctrlrange of 29 actuators is left out" in line


def test_a_file_that_is_none(tmp_path):
    with pytest.raises(RobotError, match="nowhere.json': no such file"):
        get_robot(tmp_path / "nowhere.json")
    (tmp_path / "robot.json").write_text('["g1"]')
    with pytest.raises(RobotError, match=r"robot.json': holds \['g1'\], expected an object with the fields of a robot"):
        get_robot(tmp_path / "robot.json")


@pytest.mark.parametrize("name", [["g1"], 3, "x" * 5000])
def test_what_is_no_name(name):
    with pytest.raises(RobotError, match=r"^robot .{1,80} is unknown, expected"):
        get_robot(name)
