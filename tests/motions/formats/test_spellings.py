import pytest

from plat.motions.formats.spellings import classify_columns, is_generic, match_joint, tokens
from plat.robots import G1

SPELLINGS = {
    "plain": lambda name: name,
    "capital letters": str.upper,
    "a suffix": lambda name: f"{name}_joint_pos",
    "a prefix": lambda name: f"q_{name}_joint",
    "a path": lambda name: f"joint/{name}",
    "a dot": lambda name: f"{name}.pos",
    "an index": lambda name: f"dof_{name}",
    "degrees of freedom": lambda name: f"{name}_joint_dof",
    "quotes": lambda name: f'"{name}"',
    "camel case": lambda name: "".join(word.capitalize() for word in name.split("_")),
    "spaces": lambda name: name.replace("_", " "),
    "a unit": lambda name: f"{name} (rad)",
    "the side last": lambda name: "_".join([*name.split("_")[1:], name.split("_")[0]]),
    "a topic of ROS": lambda name: f"/joint_states/{name}_joint/position",
    "short sides": lambda name: name.replace("left", "L").replace("right", "R"),
}


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_joints_are_known_however_they_are_spelled(spelling):
    for name in G1.joint_names:
        assert match_joint(SPELLINGS[spelling](name), G1) == name


@pytest.mark.parametrize("name", ["left_tail", "joint_0", "", "left", "left_knee_vel", "tau_left_knee", "root_x"])
def test_other_names_are_no_joints(name):
    assert match_joint(name, G1) is None


def test_names_that_only_number():
    assert all(map(is_generic, ["col7", "joint_0", "dof[3]", "12", "", "column A", "q12", "x.3"]))
    assert not any(map(is_generic, ["left_tail", "hip_pitch", "joint_left"]))


@pytest.mark.parametrize(
    ("name", "kind", "part"),
    [
        ("root_pos_x", "place", "x"),
        ("root_translateZ", "place", "z"),
        ("z", "place", "z"),
        ("pelvis_ty", "place", "y"),
        ("qw", "quat", "w"),
        ("root_quat_x", "quat", "x"),
        ("root_rot_z", "quat", "z"),
        ("left_knee_joint", "joint", "left_knee"),
        ("left_knee_velocity", "derived", ""),
        ("root_vel_x", "derived", ""),
        ("Frame", "count", ""),
        ("Unnamed: 0", "count", ""),
        ("7", "unknown", ""),
        ("time", "time", ""),
        ("timestamp_ns", "time", "ns"),
        ("contact", "derived", ""),
        ("style", "unknown", ""),
    ],
)
def test_columns_are_what_their_names_say(name, kind, part):
    column, _ = classify_columns([name, "root_w"], G1)
    assert (column.kind, column.part) == (kind, part)


def test_turns_without_a_w_are_angles():
    kinds = classify_columns(["root_rotateX", "root_pitch", "yaw"], G1)
    assert [(column.kind, column.part) for column in kinds] == [("euler", "x"), ("euler", "y"), ("euler", "z")]


def test_words_of_a_name():
    assert tokens("LHipPitch") == ("left", "hip", "pitch")
