import json
from dataclasses import replace

import pytest

from plat.errors import RobotError
from plat.robots import G1, get_robot, register_robot


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


def test_a_description_file_is_read_and_registered(tmp_path):
    describe(tmp_path / "robot.json")
    robot = get_robot(tmp_path / "robot.json")
    assert robot.default_joint_pos[robot.joint_names.index("left_knee")] == pytest.approx(0.3)
    assert get_robot("described") is robot
    assert get_robot(tmp_path / "robot.json") is robot


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
        ({"root_height": "tall"}, r"robot.json'?: root_height: "),
        ({"feet": ["left"]}, r"robot.json'?: feet"),
    ],
)
def test_a_wrong_field_is_named(tmp_path, change, message):
    describe(tmp_path / "robot.json", **change)
    with pytest.raises(RobotError, match=message):
        get_robot(tmp_path / "robot.json")


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
