from dataclasses import replace

import numpy as np
import pytest

from plat.errors import RobotError
from plat.robots import G1, Capsule

MINIMAL = """<mujoco><worldbody><body name="pelvis"><freejoint/><geom size=".1"/>
<body name="foot"><joint name="knee_joint" range="-60 60"/><geom size=".1"/></body></body></worldbody>{}</mujoco>"""
MOTOR = '<actuator><position joint="knee_joint" kp="50" kv="2" forcerange="-9 9"/></actuator>'
TINY = MINIMAL.format(MOTOR)


def robot(path, text: str, **changes):
    path.write_text(text)
    names = {"keypoints": ("pelvis", "foot"), "anchor": "pelvis", "end_effectors": (), "feet": ("foot", "foot")}
    return replace(G1, name="tiny", asset=str(path), default_pose={}, **{**names, **changes})


def test_an_asset_may_be_a_path_elsewhere(tmp_path):
    assert robot(tmp_path / "tiny.xml", TINY).joint_names == ("knee",)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<mujoco><worldbody>", r"tiny.xml'?: not a readable MJCF file"),
        (TINY.replace('size=".1"', ""), r"tiny.xml'? does not compile"),
        (MINIMAL.format(""), "has 0 actuators, expected one position actuator for each of the 1 hinges"),
        (TINY.replace("<freejoint/>", ""), "not one free joint followed by hinges"),
        (MINIMAL.replace('<joint name="knee_joint" range="-60 60"/>', ""), "not one free joint followed by hinges"),
        (TINY.replace('"foot"', '"paw"'), "body 'foot' is not in"),
        (
            TINY.replace("<worldbody>", '<worldbody><body name="table"/>'),
            "the free joint is that of body 'pelvis', expected the first body, 'table'",
        ),
        (
            TINY.replace("<joint", '<joint name="hip_joint" axis="1 0 0" range="-60 60"/><joint', 1).replace(
                "<position", '<position joint="hip_joint" kp="50" kv="2" forcerange="-9 9"/><position', 1
            ),
            "body 'foot' has 2 hinges, expected one; give each a body of its own",
        ),
        (TINY.replace("range=", 'ref="17.188734" range=', 1), "joint 'knee_joint' has ref 0.3 rad, expected none"),
        (TINY.replace("range=", 'pos="0 0 .1" range=', 1), "joint 'knee_joint' is off its body's origin; set its pos"),
        (TINY.replace('range="-60 60"', "", 1), "joint 'knee_joint' has no limits, expected its range"),
        (
            TINY.replace("<position", "<motor").replace('kp="50" kv="2"', ""),
            "the actuator of joint 'knee_joint' is no position actuator of gear 1, expected <position> with kp and kv",
        ),
        (TINY.replace("kp=", 'gear="2" kp='), "'knee_joint' is no position actuator of gear 1"),
        (
            TINY.replace('forcerange="-9 9"', ""),
            "the actuator of joint 'knee_joint' has no torque limits, expected its forcerange",
        ),
    ],
)
def test_a_bad_asset_is_one_line(tmp_path, text, message):
    with pytest.raises(RobotError, match=message) as caught:
        robot(tmp_path / "tiny.xml", text).model()
    assert "\n" not in str(caught.value)
    assert "'tiny'" in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"keypoints": ("foot", "pelvis")}, "keypoints: the first is 'foot', expected the root, 'pelvis'"),
        ({"anchor": "torso"}, "anchor: 'torso' is not among its keypoints"),
        ({"end_effectors": ("foot", "hand")}, "end_effectors: 'hand' is not among its keypoints"),
        ({"keypoints": ("pelvis",)}, "feet: 'foot' is not among its keypoints"),
    ],
)
def test_bodies_that_have_to_be_keypoints(tmp_path, changes, message):
    with pytest.raises(RobotError, match=f"robot 'tiny': {message}"):
        robot(tmp_path / "tiny.xml", TINY, **changes).model()


def test_a_missing_asset_is_named():
    with pytest.raises(RobotError, match=r"asset 'nowhere/x.xml': no such file"):
        replace(G1, asset="nowhere/x.xml").model()


def test_capsules_of_the_robot_are_its_soles():
    model = replace(G1, sole_capsules=(Capsule((0, 0, 0), (0.1, 0, 0), 0.02),)).model("capsules")
    (left,), (right,) = G1.sole_geoms(model)
    np.testing.assert_allclose(model.geom_size[[left, right], 0], 0.02)
    np.testing.assert_allclose(model.geom_pos[left], [0.05, 0, 0], atol=1e-9)


def test_a_robot_without_capsules_says_so():
    with pytest.raises(RobotError, match="robot 'g1' has no sole_capsules, expected feet 'spheres'"):
        replace(G1, sole_capsules=()).model("capsules")
