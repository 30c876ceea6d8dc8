"""Keys of MuJoCo's model files, against MuJoCo itself."""

import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from plat.errors import KeyframeError
from plat.keyframes import Keyframe, only
from plat.keyframes.mjcf_keys import read_mjcf_keys, write_mjcf_keys
from plat.robots import G1

POSES = [
    Keyframe.from_qpos(0.5, G1.default_qpos, "a & b"),
    Keyframe.from_qpos(1.5, G1.default_qpos + np.eye(36)[20] * 0.1),
]


def model(names, keys: str, more: str = "") -> str:
    """A chain of hinges under a free root, with a box that may fall."""
    bodies = "".join(f'<body><geom size=".1"/><joint name="{name}_joint"/>' for name in names) + "</body>" * len(names)
    pelvis = f'<body name="pelvis"><freejoint name="root"/><geom size=".1"/>{bodies}</body>'
    box = '<body name="box"><freejoint/><geom size=".1"/></body>'
    other = '<body name="other"><geom size=".1"/><joint type="ball"/></body>'
    world = f"<worldbody>{pelvis}{box}{other}</worldbody>"
    return f"<mujoco>{more}{world}<keyframe>{keys}</keyframe></mujoco>"


def test_keys_are_read_by_the_names_of_joints(tmp_path):
    names = G1.joint_names[::-1]
    qpos = np.arange(36 + 7 + 4) / 100
    qpos[3:7] = 0.5
    text = model(names, f'<key name="pose" time="2" qpos="{" ".join(map(str, qpos))}"/>')
    (tmp_path / "a.xml").write_text(text)
    compiled = mujoco.MjModel.from_xml_string(text)
    (pose,) = read_mjcf_keys(tmp_path / "a.xml", G1)
    assert (pose.name, pose.time) == ("pose", 2)
    np.testing.assert_allclose(pose.qpos[:7], compiled.key_qpos[0, :7])
    wanted = [compiled.key_qpos[0, compiled.joint(f"{name}_joint").qposadr[0]] for name in G1.joint_names]
    np.testing.assert_allclose(pose.joint_pos, wanted)


def test_a_bodys_joint_comes_before_its_childrens_wherever_it_stands(tmp_path):
    # each joint after the body within, the free one too, and half of them in frames
    body = ""
    for number, name in reversed([*enumerate(G1.joint_names)]):
        joint = f'<joint name="{name}"/>'
        body = f'<body><geom size=".1"/>{body}{f"<frame>{joint}</frame>" if number % 2 else joint}</body>'
    qpos = " ".join(f"{value:.2f}" for value in [1.5, 2.5, 0.7, 1, 0, 0, 0, *(0.01 * n for n in range(29))])
    world = f'<worldbody><body name="pelvis"><geom size=".1"/>{body}<freejoint name="root"/></body></worldbody>'
    text = f'<mujoco>{world}<keyframe><key qpos="{qpos}"/></keyframe></mujoco>'
    (tmp_path / "a.xml").write_text(text)
    compiled = mujoco.MjModel.from_xml_string(text)
    (pose,) = read_mjcf_keys(tmp_path / "a.xml", G1)
    np.testing.assert_allclose(pose.qpos[:7], compiled.key_qpos[0, :7])
    wanted = [compiled.key_qpos[0, compiled.joint(name).qposadr[0]] for name in G1.joint_names]
    np.testing.assert_allclose(pose.joint_pos, wanted)


@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("first", [False, True])
def test_an_included_robot_stands_where_it_is_included(tmp_path, first, inside):
    """Beside a box that is free as well, before it or after it, within ``<worldbody>`` or beside it."""
    robot = model(G1.joint_names, "")
    robot = robot[robot.index('<body name="pelvis">') : robot.index('<body name="box">')]
    (tmp_path / "robot.xml").write_text(f"<mujoco>{robot if inside else f'<worldbody>{robot}</worldbody>'}</mujoco>")
    include, box = '<include file="robot.xml"/>', '<body name="box"><freejoint/><geom size=".1"/></body>'
    parts = [include if inside else f"</worldbody>{include}<worldbody>", box][:: 1 if first else -1]
    angles = " ".join(f"{0.01 * number:.2f}" for number in range(29))
    qpos = " ".join([f"1.5 2.5 0.7 1 0 0 0 {angles}", "9 9 9 1 0 0 0"][:: 1 if first else -1])
    text = f"<mujoco><worldbody>{''.join(parts)}</worldbody><keyframe><key qpos='{qpos}'/></keyframe></mujoco>"
    (tmp_path / "scene.xml").write_text(text)
    compiled = mujoco.MjModel.from_xml_path(str(tmp_path / "scene.xml"))
    (pose,) = read_mjcf_keys(tmp_path / "scene.xml", G1)
    root = compiled.joint("left_hip_pitch_joint").qposadr[0] - 7
    np.testing.assert_allclose(pose.qpos, compiled.key_qpos[0, root : root + 36])
    assert pose.root_pos.tolist() == [1.5, 2.5, 0.7]


def test_what_is_written_is_read_and_fits_the_model(tmp_path):
    write_mjcf_keys(tmp_path / "keys.xml", G1, POSES)
    found = read_mjcf_keys(tmp_path / "keys.xml", G1)
    for pose, again in zip(POSES, found, strict=True):
        np.testing.assert_allclose(again.qpos, pose.qpos, atol=1e-8)
        assert again.time == pose.time
    assert [pose.name for pose in found] == ["a & b", "key1"]
    # with the robot's own bodies, through an include
    text = model(G1.joint_names, "", '<include file="keys.xml"/>').replace("<keyframe></keyframe>", "")
    (tmp_path / "scene.xml").write_text(text)
    compiled = read_mjcf_keys(tmp_path / "scene.xml", G1)
    np.testing.assert_allclose(compiled[1].qpos, POSES[1].qpos, atol=1e-8)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<mujoco><keyframe/></mujoco>", "no keys, expected <keyframe>"),
        ("<mujoco><keyframe><key qpos='1 2'/></keyframe></mujoco>", "key 0 has 2 positions, expected 36 for 'g1'"),
        ("<mujoco><keyframe><key qpos='1 x'/></keyframe></mujoco>", "key 0: could not convert"),
        ("<mujoco><keyframe><key/></keyframe></mujoco>", "key 0 has no 'qpos'"),
        ("<robot/>", "begins with <robot>, expected <mujoco>"),
        ("<mujoco>", "not readable XML"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><mujoco/>', "defines entities"),
        (model(G1.joint_names[1:], "<key qpos='1'/>"), r"lacks the joints \['left_hip_pitch'\]"),
        (model(G1.joint_names, "<key qpos='1 2 3'/>"), "has 3 positions, fewer than the joints of the file"),
    ],
)
def test_what_is_no_keys_of_the_robot(tmp_path, text, message):
    (tmp_path / "a.xml").write_text(text)
    with pytest.raises(KeyframeError, match=rf"a.xml'.*{message}"):
        read_mjcf_keys(tmp_path / "a.xml", G1)


def test_a_partial_keyframe_is_refused(tmp_path):
    with pytest.raises(KeyframeError, match=r"a.xml': keyframe 1 \('low'\) commands .* MJCF keys have"):
        write_mjcf_keys(tmp_path / "a.xml", G1, [POSES[0], only(G1, 1.0, height=0.7, name="low")])
    assert not (tmp_path / "a.xml").exists()


def test_a_file_is_included_once(tmp_path):
    own = '<include file="a.xml"/>' * 300
    (tmp_path / "a.xml").write_text(model(G1.joint_names, "", own).replace("<keyframe></keyframe>", ""))
    with pytest.raises(KeyframeError, match="no keys, expected <keyframe>"):
        read_mjcf_keys(tmp_path / "a.xml", G1)


def test_messages_are_short(tmp_path):
    long = "x" * 5000
    for text in (
        f"<{long}/>",
        f"<mujoco><keyframe><key name='{long}'/></keyframe></mujoco>",
        f"<mujoco><keyframe><key qpos='{long}'/></keyframe></mujoco>",
        f"<mujoco><worldbody><body><joint type='{long}'/></body></worldbody></mujoco>",
        "<mujoco><keyframe><key time='1 2' qpos='{}'/></keyframe></mujoco>".format("0 " * 36),
    ):
        (tmp_path / "a.xml").write_text(text)
        with pytest.raises(KeyframeError) as caught:
            read_mjcf_keys(tmp_path / "a.xml", G1)
        assert len(str(caught.value).replace(str(tmp_path), "")) < 300


@pytest.mark.parametrize("name", ["my--g1", "g1---", "-->", "bell\x07", "<a & b>"])
def test_a_robot_of_any_name_stands_in_a_comment(tmp_path, name):
    robot = replace(G1, name=name)
    write_mjcf_keys(tmp_path / "keys.xml", robot, POSES)
    assert len(read_mjcf_keys(tmp_path / "keys.xml", robot)) == 2
    mujoco.MjSpec.from_file(str(tmp_path / "keys.xml"))


def test_names_that_come_again_are_numbered_for_mujoco(tmp_path):
    names = ["wave", "wave", "wave 2", None, "key3", "bell\x07"]
    poses = [replace(POSES[0].at(0.5 * number), name=name) for number, name in enumerate(names)]
    write_mjcf_keys(tmp_path / "keys.xml", G1, poses)
    text = model(G1.joint_names, "", '<include file="keys.xml"/>').replace("<keyframe></keyframe>", "")
    box = "".join(part for part in re.findall(r'<body name="(?:box|other)">.*?</body>', text))
    assert box  # with other things in it the keys would lack positions
    text = re.sub(r'<body name="(?:box|other)">.*?</body>', "", text)
    (tmp_path / "scene.xml").write_text(text)
    compiled = mujoco.MjModel.from_xml_path(str(tmp_path / "scene.xml"))
    found = [compiled.key(number).name for number in range(compiled.nkey)]
    assert found == ["wave", "wave 3", "wave 2", "key3", "key3 2", "bell?"]
    assert [pose.name for pose in read_mjcf_keys(tmp_path / "keys.xml", G1)] == found
