from dataclasses import replace

import numpy as np
import pytest

from plat.errors import RobotError
from plat.robots import G1, Capsule

MINIMAL = """<mujoco><worldbody><body name="pelvis"><freejoint/><geom size=".1"/>
<body name="foot"><joint name="knee_joint"/><geom size=".1"/></body></body></worldbody>{}</mujoco>"""
MOTOR = '<actuator><position joint="knee_joint"/></actuator>'


def robot(path, text: str):
    path.write_text(text)
    return replace(
        G1,
        name="tiny",
        asset=str(path),
        default_pose={},
        keypoints=("pelvis",),
        anchor="pelvis",
        end_effectors=(),
        feet=("foot", "foot"),
    )


def test_an_asset_may_be_a_path_elsewhere(tmp_path):
    assert robot(tmp_path / "tiny.xml", MINIMAL.format(MOTOR)).joint_names == ("knee",)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<mujoco><worldbody>", r"tiny.xml'?: not a readable MJCF file"),
        (MINIMAL.format(MOTOR).replace('size=".1"', ""), r"tiny.xml'? does not compile"),
        (MINIMAL.format(""), "has 0 actuators, expected one position actuator for each of the 1 hinges"),
        (MINIMAL.format(MOTOR).replace("<freejoint/>", ""), "not one free joint followed by hinges"),
        (MINIMAL.format(MOTOR).replace('"foot"', '"paw"'), "body 'foot' is not in"),
    ],
)
def test_a_bad_asset_is_one_line(tmp_path, text, message):
    with pytest.raises(RobotError, match=message) as caught:
        robot(tmp_path / "tiny.xml", text).model()
    assert "\n" not in str(caught.value)
    assert "'tiny'" in str(caught.value)


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
