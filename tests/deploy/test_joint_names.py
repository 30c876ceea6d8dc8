import pytest

from plat.deploy.joint_names import check_joints, plain_joint
from plat.deploy.lerobot import lerobot_motor
from plat.errors import BundleError
from plat.robots import G1

OURS = G1.joint_names


@pytest.mark.parametrize(
    "spelled",
    [
        lambda name: name,
        lambda name: f"{name}_joint",
        lambda name: name.title().replace("_", ""),
        lerobot_motor,
        str.upper,
    ],
    ids=["plat", "URDF", "SDK", "LeRobot", "capitals"],
)
def test_names_and_tables_of_other_software_are_known(spelled):
    names = [spelled(name) for name in OURS]
    assert [plain_joint(name) for name in names] == list(OURS)
    check_joints("here", OURS, names)
    check_joints("here", OURS, iter(names))
    check_joints("here", OURS, {name: index for index, name in enumerate(names)})


def test_a_table_may_have_more_motors_and_other_names_for_one():
    table = {name: index for index, name in enumerate(OURS)}
    more = {"LeftAnkleB": table["left_ankle_pitch"], **table, "kNotUsedJoint0": 29}
    check_joints("here", OURS, dict(reversed(more.items())))


@pytest.mark.parametrize("turned", [list, lambda items: [*items][::-1]])
def test_a_table_that_contradicts_itself_is_refused_in_any_order(turned):
    table = {**{name: index for index, name in enumerate(OURS)}, "LeftKnee": 9}
    with pytest.raises(BundleError, match="'left_knee' is number 3 in the bundle and (3 and 9|9 and 3) on this robot"):
        check_joints("here", OURS, dict(turned(table.items())))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (OURS[:-1], "here: 29 joints in the bundle, 28 on this robot"),
        ((*OURS, "tail"), "here: 29 joints in the bundle, 30 on this robot"),
        (OURS[::-1], "here: joint 0 is 'left_hip_pitch' in the bundle and 'right_wrist_yaw' on this robot"),
        ({"LeftHipPitch": 0}, "here: joint 'left_hip_roll' is not in this robot's table of 1 motors"),
        (
            {**{name: index for index, name in enumerate(OURS)}, "left_knee": 2, "left_hip_yaw": 3},
            "here: joint 'left_hip_yaw' is number 2 in the bundle and 3 on this robot",
        ),
        (5, "here: joint_names is 5, expected names in order, or a table of motors"),
        ("left_knee", "here: joint_names is 'left_knee', expected names in order, or a table of motors"),
        ({"left_knee"}, "here: joint_names is {'left_knee'}, expected names in order, or a table of motors"),
        ([*OURS[:-1], None], "here: joint_names has None, expected names"),
        ({0: "left_knee"}, "here: joint_names has 0, expected names"),
    ],
)
def test_others_are_refused_by_name(given, message):
    with pytest.raises(BundleError) as error:
        check_joints("here", OURS, given)
    assert str(error.value) == message
