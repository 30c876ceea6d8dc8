import json
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

from plat.errors import KeyframeError
from plat.keyframes import KeyframeSequence, standing
from plat.motions import generate_motions
from plat.robots import G1


@pytest.fixture(scope="module")
def wave() -> KeyframeSequence:
    clip = generate_motions("val", seconds=4, families=("wave",))[0]
    return KeyframeSequence.from_motion(clip, [0.5, 1.22, 2.0], G1, names=["hand up", None, "Gruß"])


@pytest.fixture
def content(wave, tmp_path) -> dict:
    wave.save(tmp_path / "good.json")
    return json.loads((tmp_path / "good.json").read_text())


def test_nothing_is_lost_on_the_way_to_disk_and_back(wave, tmp_path):
    path = tmp_path / "new" / "wave.json"
    wave.save(path)
    back = KeyframeSequence.load(path, G1)
    for before, after in zip((wave.start, *wave.keyframes), (back.start, *back.keyframes), strict=True):
        assert (before.time, before.name) == (after.time, after.name)
        np.testing.assert_allclose(after.qpos, before.qpos, rtol=0, atol=1e-15)
    assert [file.name for file in path.parent.iterdir()] == ["wave.json"]


def test_joints_are_read_by_name_and_quaternions_in_the_order_that_the_file_says(content, wave, tmp_path):
    content["quaternion_order"] = "xyzw"
    for entry in (content["start"], *content["keyframes"]):
        w, x, y, z = entry["root_quat"]
        entry["root_quat"] = [x, y, z, w]
        entry["joint_pos"] = dict(reversed(entry["joint_pos"].items()))
    path = tmp_path / "other.json"
    path.write_text(json.dumps(content))
    back = KeyframeSequence.load(path, G1)
    for before, after in zip(wave.keyframes, back.keyframes, strict=True):
        np.testing.assert_allclose(after.qpos, before.qpos, rtol=0, atol=1e-15)


def test_joints_may_be_called_as_in_the_robots_own_files(content, wave, tmp_path):
    for entry in (content["start"], *content["keyframes"]):
        entry["joint_pos"] = {f"{name}_joint": value for name, value in entry["joint_pos"].items()}
    content["version"] = 2
    content["keyframes"][0]["commands"] = {"joints": ["left_knee_joint"]}
    (tmp_path / "a.json").write_text(json.dumps(content))
    back = KeyframeSequence.load(tmp_path / "a.json", G1)
    np.testing.assert_array_equal(back.keyframes[0].joint_pos, wave.keyframes[0].joint_pos)
    assert back.keyframes[0].commands.names(G1)["joints"] == ["left_knee"]


def test_without_a_start_the_robot_stands_at_the_origin(content, tmp_path):
    del content["start"]
    (tmp_path / "a.json").write_text(json.dumps(content))
    np.testing.assert_array_equal(KeyframeSequence.load(tmp_path / "a.json", G1).start.qpos, standing(G1).qpos)


def test_long_intervals_are_refused_or_split(content, tmp_path):
    content["keyframes"][2]["time"] = 3.5
    path = tmp_path / "long.json"
    path.write_text(json.dumps(content))
    with pytest.raises(KeyframeError, match=r"long.json'.*keyframe 2 \('Gruß'\): time is 3.5 s, 114 control steps"):
        KeyframeSequence.load(path, G1)
    split = KeyframeSequence.load(path, G1, split=True)
    assert [keyframe.name for keyframe in split.keyframes] == ["hand up", None, "Gruß 1/3", "Gruß 2/3", "Gruß"]


def test_a_file_that_cannot_be_written_is_named(wave, tmp_path):
    (tmp_path / "folder").write_text("")
    with pytest.raises(KeyframeError, match="folder/wave.json' could not be written"):
        wave.save(tmp_path / "folder" / "wave.json")
    with pytest.raises(KeyframeError, match="could not be written .its name holds a null byte"):
        wave.save(tmp_path / "a\0b.json")


def change(*path, to):
    """A function that sets one value deep inside; ``to=None`` removes it."""

    def apply(content):
        content = deepcopy(content)
        inner = content
        for key in path[:-1]:
            inner = inner[key]
        if to is None:
            del inner[path[-1]]
        else:
            inner[path[-1]] = to
        return content

    return apply


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        (change("format", to="plat-run"), "not a keyframe file, expected an object with 'format': 'plat-keyframes'"),
        (change("version", to=3), "version is 3, this plat reads up to 2: update plat"),
        (change("version", to=0), "version is 0, expected 1 or 2"),
        (change("robot", to="h1"), "robot is 'h1', expected 'g1'; for another .* --robot PATH$"),
        (change("robot", to=None), "robot is missing"),
        (change("quaternion_order", to=None), "quaternion_order is missing"),
        (change("quaternion_order", to="zyxw"), "quaternion_order is 'zyxw', expected 'wxyz' or 'xyzw'"),
        (change("quaternion_order", to=[1]), r"quaternion_order is \[1\]"),
        (change("keyframes", to={}), "keyframes: expected a list"),
        (change("keyframes", to=[]), "keyframes: none"),
        (change("speed", to=1), "unknown field 'speed', expected format, version"),
        (change("keyframes", 1, to=7), "keyframe 1 is 7, expected an object"),
        (change("keyframes", 1, "time", to=None), "keyframe 1: time is missing"),
        (change("keyframes", 0, "tiem", to=1), r"keyframe 0 \('hand up'\): unknown field 'tiem', expected time"),
        (change("keyframes", 1, "name", to=[]), r"keyframe 1: name is \[\], expected a text"),
        (change("keyframes", 1, "time", to=0.1), "keyframe 1: time is 0.1 s, expected at least 0.02 s after 0.5 s"),
        (change("keyframes", 0, "time", to=0), r"keyframe 0 \('hand up'\): time is 0 s"),
        (change("keyframes", 0, "time", to=True), "time is True, expected a finite number"),
        (change("keyframes", 0, "root_pos", to=[0, 0]), r"root_pos is \[0, 0\], expected a list of 3 numbers"),
        (change("keyframes", 0, "root_pos", 2, to=float("nan")), r"root_pos\[2\] is nan, expected a finite number"),
        (change("keyframes", 0, "root_pos", 2, to=76.0), "root_pos puts the root at a height of 76 m, expected meters"),
        (change("start", "root_pos", 2, to=-76.0), "start: root_pos puts the root at a height of -76 m"),
        (change("keyframes", 1, "root_pos", 0, to=1e9), r"keyframe 1: root_pos puts the root 1e\+09 m away"),
        (change("keyframes", 0, "joint_pos", "left_knee_joint", to=1.0), "'left_knee' are one joint"),
        (change("keyframes", 0, "root_quat", 0, to="1"), r"root_quat\[0\] is '1'"),
        (change("keyframes", 0, "root_quat", to=[1, 1, 0, 0]), "root_quat has length 1.414, expected 1"),
        (change("keyframes", 0, "joint_pos", to=[0.0] * 29), "joint_pos: expected an object of joint names"),
        (change("keyframes", 0, "joint_pos", "tail", to=0.1), r"joint_pos: unknown joints \['tail'\]"),
        (change("keyframes", 0, "joint_pos", "left_knee", to=None), r"missing joints \['left_knee'\] \(0 unknown, 1"),
        (change("keyframes", 0, "joint_pos", "left_knee", to=9.0), "joint_pos: 'left_knee' is 9 rad, expected -0.087"),
        (change("keyframes", 0, "joint_pos", "left_knee", to=float("inf")), "joint_pos: 'left_knee' is inf"),
        (change("keyframes", 0, "commands", to={"root": ["height"]}), "commands is a field of version 2, and version"),
        (change("start", "commands", to={"root": ["height"]}), "start: unknown field 'commands'"),
        (change("start", "time", to=0.1), "start: unknown field 'time'"),
        (change("start", "root_pos", to=None), "start: root_pos is missing"),
        (change("start", to=[]), r"start is \[\], expected an object"),
    ],
)  # fmt: skip
def test_a_bad_file_gets_one_line_that_names_file_and_field(content, tmp_path, broken, message):
    path = tmp_path / "bad.json"
    path.write_text(json.dumps(broken(content)))
    with pytest.raises(KeyframeError, match=message) as caught:
        KeyframeSequence.load(path, G1)
    assert str(caught.value).startswith(f"keyframe file {str(path)!r}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not a readable JSON file"),
        ("[]", "not a keyframe file"),
        ('{"format": "plat-keyframes", "format": "plat-keyframes"}', "field 'format' comes twice"),
        (b"\xff\xfe\x00", "not a readable JSON file"),
    ],
)
def test_what_is_not_json_is_said_so(tmp_path, text, message):
    path = tmp_path / "bad.json"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(KeyframeError, match=message):
        KeyframeSequence.load(path, G1)


def test_a_missing_file_and_a_folder_are_named(tmp_path):
    with pytest.raises(KeyframeError, match="nowhere.json': no such file"):
        KeyframeSequence.load(tmp_path / "nowhere.json", G1)
    with pytest.raises(KeyframeError, match="not a regular file"):
        KeyframeSequence.load(tmp_path, G1)


def test_a_split_does_not_shift_the_number_of_a_keyframe_that_is_wrong(content, tmp_path):
    content["keyframes"][0]["time"], content["keyframes"][1]["time"], content["keyframes"][2]["time"] = 3.0, 3.5, 3.2
    path = tmp_path / "bad.json"
    path.write_text(json.dumps(content))
    with pytest.raises(KeyframeError, match=r"keyframe 2 \('Gruß'\): time is 3.2 s"):
        KeyframeSequence.load(path, G1, split=True)


def test_another_robot_finds_its_joints_missing(wave, tmp_path):
    wave.save(tmp_path / "g1.json")

    class Arm:
        name = "g1"
        joint_names = ("elbow",)
        joint_range = np.array([[-1.0, 1.0]])
        default_qpos = replace(standing(G1), joint_pos=np.zeros(1)).qpos

    with pytest.raises(KeyframeError, match=r"\(29 unknown, 1 missing\), expected the 1 of 'g1'"):
        KeyframeSequence.load(tmp_path / "g1.json", Arm())
