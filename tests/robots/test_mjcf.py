from dataclasses import replace

import mujoco
import numpy as np
import pytest

from plat.errors import RobotError
from plat.robots import G1, Capsule

MINIMAL = """<mujoco><worldbody><body name="pelvis"><freejoint/><geom size=".1"/>
<body name="foot"><joint name="knee_joint" range="-60 60"/><geom size=".1"/></body></body></worldbody>{}</mujoco>"""
MOTOR = '<actuator><position joint="knee_joint" kp="50" kv="2" forcerange="-9 9"/></actuator>'
TINY = MINIMAL.format(MOTOR)
GENERAL = MINIMAL.format(
    '<actuator><general joint="knee_joint" gaintype="fixed" gainprm="50" biastype="affine" biasprm="0 -50 -2" '
    'forcerange="-9 9"/></actuator>'
)


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
        (
            TINY.replace('forcerange="-9 9"', 'forcerange="-5 9"'),
            "the actuator of joint 'knee_joint' has forcerange -5 9, expected one torque .*, such as -9 9",
        ),
        (
            TINY.replace("range=", 'actuatorfrcrange="-5 9" range=', 1),
            "joint 'knee_joint' has actuatorfrcrange -5 9, expected one torque .*, such as -9 9",
        ),
        (
            TINY.replace("kp=", 'ctrlrange="-0.5 1.1" kp='),
            "'knee_joint' has ctrlrange -0.5 1.1 inside the joint's range -1.0472 1.0472, expected none: plat does not",
        ),
        (TINY.replace("kp=", 'inheritrange="0.5" kp='), "has ctrlrange -0.523599 0.523599 inside the joint's range"),
        (
            TINY.replace("kp=", 'timeconst="0.1" kp='),
            "'knee_joint' has activation dynamics, expected none: .* leave out its timeconst or dyntype",
        ),
        (
            TINY.replace("kp=", 'delay="0.01" nsample="4" kp='),
            "'knee_joint' has a delay of 0.01 s, expected none: nothing resets",
        ),
        (TINY.replace("<position", "<pid"), "'knee_joint' is no position actuator of gear 1"),
        (GENERAL.replace("0 -50 -2", "1 -50 -2"), "'knee_joint' is no position actuator of gear 1"),
        (GENERAL.replace('gaintype="fixed"', 'gaintype="affine"'), "'knee_joint' is no position actuator of gear 1"),
        (TINY.replace('name="foot"', 'name="foot1"'), "keypoints: body 'foot' is not in .*, perhaps 'foot1'"),
        (
            TINY.replace("<worldbody>", '<worldbody><geom name="step" size=".1"/>'),
            "geom 'step' of body 'world' collides with the robot, expected the robot alone: plat adds a floor",
        ),
        (
            TINY.replace("<worldbody>", '<worldbody><geom type="plane" size="1 1 1" euler="5 0 0"/>'),
            "a geom without a name of body 'world' collides with the robot",
        ),
        (
            TINY.replace("</worldbody>", '<body name="table"><geom name="top" size=".1"/></body></worldbody>'),
            "geom 'top' of body 'table' collides with the robot, expected the robot alone",
        ),
    ],
)
def test_a_bad_asset_is_one_line(tmp_path, text, message):
    with pytest.raises(RobotError, match=message) as caught:
        robot(tmp_path / "tiny.xml", text).model()
    assert "\n" not in str(caught.value)
    assert "'tiny'" in str(caught.value)


@pytest.mark.parametrize(
    ("actuator", "joint", "effort"),
    [
        ("", 'actuatorfrcrange="-7 7"', 7.0),
        ('forcerange="-9 9"', 'actuatorfrcrange="-7 7"', 7.0),
        ('forcerange="-9 9"', 'actuatorfrcrange="-20 20"', 9.0),
        ('forcerange="-9 9"', 'actuatorfrcrange="-7 7" actuatorfrclimited="false"', 9.0),
        ('forcerange="-9 9"', "", 9.0),
    ],
)
def test_the_torque_limit_is_the_narrower_of_actuator_and_joint(tmp_path, actuator, joint, effort):
    text = TINY.replace('forcerange="-9 9"', actuator).replace("range=", f"{joint} range=", 1)
    tiny = robot(tmp_path / "tiny.xml", text)
    assert tiny.effort_limit.tolist() == [effort]
    assert tiny.action_scale.tolist() == pytest.approx([0.25 * effort / 50])
    model, theirs = tiny.model(), mujoco.MjModel.from_xml_string(text)
    for one in (model, theirs):  # a target far away: MuJoCo moves the joint alike by the description as it is
        data = mujoco.MjData(one)
        data.ctrl[:] = 1.0
        mujoco.mj_forward(one, data)
        assert data.qfrc_actuator[-1] == pytest.approx(min(effort, 50.0))


@pytest.mark.parametrize(
    ("limits", "left_out"),
    [
        ('inheritrange="1"', True),
        ('inheritrange="1.2"', True),
        ('ctrlrange="-1.05 1.047"', True),
        ('ctrlrange="-3.14 3.14" ctrllimited="true"', True),
        ('ctrlrange="-0.1 0.1" ctrllimited="false"', False),
        ("", False),
    ],
)
def test_targets_are_not_clipped_and_that_is_said(tmp_path, limits, left_out):
    tiny = robot(tmp_path / "tiny.xml", TINY.replace("kp=", f"{limits} kp="))
    assert [note.partition("tiny.xml: ")[2].partition(":")[0] for note in tiny.notes] == (
        ["the ctrlrange of 1 actuator is left out"] if left_out else []
    )
    data = mujoco.MjData(tiny.model())
    data.ctrl[:] = 1.1
    mujoco.mj_forward(data.model, data)
    assert data.actuator_force[0] == pytest.approx(9.0)
    data.qpos[-1] = 1.0472
    mujoco.mj_forward(data.model, data)
    assert data.actuator_force[0] == pytest.approx(50 * (1.1 - 1.0472))  # beyond the joint's limit


@pytest.mark.parametrize(
    "floors",
    [
        '<geom name="floor" type="plane" size="1 1 1"/>',
        '<geom name="ground" type="plane" size="0 0 1" euler="0 0 30" friction="1.5"/>',
        '<geom name="floor" type="plane" size="1 1 1" contype="0" conaffinity="0"/>',
        '<geom type="plane" size="1 1 1"/><light pos="0 0 3"/><geom name="ground" type="plane" size="1 1 1"/>',
    ],
)
def test_a_floor_of_the_description_gives_way_to_plats_and_that_is_said(tmp_path, floors):
    tiny = robot(tmp_path / "tiny.xml", TINY.replace("<worldbody>", f"<worldbody>{floors}"))
    assert tiny.model().ngeom == 3
    assert tiny.model().geom_friction[tiny.model().geom("floor").id, 0] == 0
    (note,) = tiny.notes
    assert note.startswith("robot 'tiny': ")
    assert note.endswith("is left out: plat adds its own, at height 0")


def test_an_actuator_that_is_out_of_order_is_named(tmp_path):
    spec = G1.spec()
    spec.delete(spec.geom("floor"))
    spec.compile()
    first, second = (f'joint="left_hip_{axis}_joint"' for axis in ("pitch", "roll"))
    head, motors = spec.to_xml().split("<actuator>")
    swapped = motors.replace(first, "one").replace(second, first).replace("one", second)
    (tmp_path / "robot.xml").write_text(f"{head}<actuator>{swapped}")
    message = "in their order; actuator 1 drives 'left_hip_roll_joint', and hinge 1 is 'left_hip_pitch_joint'"
    with pytest.raises(RobotError, match=message):
        replace(G1, asset=str(tmp_path / "robot.xml")).model()


@pytest.mark.parametrize("given", ['body1="{}" body2="world"', 'body1="world" subtree2="{}"'])
def test_a_foot_sensor_of_the_other_foot_is_refused(tmp_path, given):
    spec = G1.spec()
    spec.delete(spec.geom("floor"))
    spec.compile()
    text = spec.to_xml()
    ours = 'body1="left_ankle_roll_link" body2="world"'
    assert ours in text
    for side, foot in zip(("left", "right"), G1.feet, strict=True):
        (tmp_path / f"{side}.xml").write_text(text.replace(ours, given.format(foot), 1))
    assert replace(G1, asset=str(tmp_path / "left.xml")).model().nsensor == 4
    message = "sensor 'left_foot_contact' is of body 'right_ankle_roll_link', expected 'left_ankle_roll_link'"
    with pytest.raises(RobotError, match=message):
        replace(G1, asset=str(tmp_path / "right.xml")).model()


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
