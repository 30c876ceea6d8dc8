from dataclasses import replace

import numpy as np
import pytest

from plat.control import PoseComparison, ReachLimits
from plat.deploy import RobotState
from plat.envs.transforms import TerminationLimits
from plat.keyframes import Keyframe, standing
from plat.robots import G1
from plat.spec.parts import Parts

POSE = standing(G1)


def state(keyframe: Keyframe) -> RobotState:
    zero = np.zeros(3)
    return RobotState(keyframe.joint_pos, np.zeros(29), keyframe.root_pos, keyframe.root_quat, zero, zero)


def moved(**changes) -> Keyframe:
    return replace(POSE, **changes)


@pytest.fixture(scope="module")
def compare() -> PoseComparison:
    return PoseComparison(G1)


def test_a_shift_is_the_error_of_every_keypoint(compare):
    errors = compare(state(moved(root_pos=POSE.root_pos + np.array([0.3, -0.4, 0.0]))), POSE)
    assert errors.keypoint == errors.bodies == pytest.approx(0.5)
    assert errors.joint == 0
    assert not errors.off_pose  # where the robot stands does not count, only heights and the torso's orientation
    assert not errors.fallen


def test_an_angle_is_shared_by_all_joints(compare):
    joint_pos = POSE.joint_pos.copy()
    joint_pos[G1.joint_names.index("left_elbow")] += 0.29
    errors = compare(state(moved(joint_pos=joint_pos)), POSE)
    assert errors.joint == pytest.approx(0.01)
    assert 0 < errors.keypoint < 0.1


@pytest.mark.parametrize(
    ("changes", "off_pose", "fallen"),
    [
        ({"root_pos": POSE.root_pos - np.array([0, 0, 0.24])}, False, False),
        ({"root_pos": POSE.root_pos - np.array([0, 0, 0.26])}, True, True),
        ({"root_quat": np.array([np.cos(0.48), 0, 0, np.sin(0.48)])}, False, False),
        ({"root_quat": np.array([np.cos(0.52), 0, 0, np.sin(0.52)])}, True, False),
        ({"root_quat": np.array([np.cos(0.75), np.sin(0.75), 0, 0])}, True, True),
    ],
)
def test_limits_are_those_of_the_evaluation(compare, changes, off_pose, fallen):
    errors = compare(state(moved(**changes)), POSE)
    assert (errors.off_pose, errors.fallen) == (off_pose, fallen)


def test_limits_can_be_chosen():
    strict = PoseComparison(G1, ReachLimits(window=TerminationLimits(root_height=0.1)))
    assert strict(state(moved(root_pos=POSE.root_pos - np.array([0, 0, 0.15]))), POSE).fallen


def test_root_height_and_turn_are_told_apart(compare):
    errors = compare(state(moved(root_pos=POSE.root_pos + np.array([0.3, 0.0, 0.4]))), POSE)
    assert errors.root == pytest.approx(0.5)
    assert errors.height == pytest.approx(0.4)
    assert errors.turn == pytest.approx(0)
    turned = compare(state(moved(root_quat=np.array([np.cos(0.3), 0, 0, np.sin(0.3)]))), POSE)
    assert turned.turn == pytest.approx(0.6)
    assert turned.root == pytest.approx(0)


LOW = moved(root_pos=POSE.root_pos - np.array([0, 0, 0.37]))
LYING = moved(root_quat=np.array([np.cos(0.75), 0, np.sin(0.75), 0]))


@pytest.mark.parametrize(
    ("there", "wanted", "down"), [(LOW, POSE, True), (LOW, LOW, False), (LYING, POSE, True), (LYING, LYING, False)]
)
def test_whoever_is_low_or_tilted_without_being_told_to_is_down(compare, there, wanted, down):
    assert compare(state(there), wanted).down is down


def test_only_what_is_commanded_is_off(compare):
    elbow = G1.joint_names.index("left_elbow")
    joint_pos = POSE.joint_pos.copy()
    joint_pos[elbow] += 0.5
    away = state(moved(joint_pos=joint_pos, root_pos=POSE.root_pos + np.array([0.5, 0.0, 0.1])))
    right = compare(away, POSE, Parts.only(G1, joints=["right_elbow"]))
    assert (right.joint, right.near) == (0.0, True)
    assert np.isnan([right.root, right.bodies, right.turn, right.keypoint]).all()  # nothing says where they should be
    left = compare(away, POSE, Parts.only(G1, joints=["left_elbow"]))
    assert left.joint == pytest.approx(0.5)
    assert not left.near
    height = compare(away, POSE, Parts.only(G1, root=["height"]))
    assert height.root == pytest.approx(0.1)
    assert np.isnan([height.joint, height.bodies, height.turn, height.keypoint]).all()
    assert compare(away, POSE, Parts.only(G1, root=["horizontal"])).root == pytest.approx(0.5)
    torso = compare(away, POSE, Parts.only(G1, bodies=["torso_link"]))
    assert torso.bodies == torso.keypoint == pytest.approx(np.hypot(0.5, 0.1))
    assert torso.height == pytest.approx(0.1)


def test_all_parts_are_the_whole_pose(compare):
    away = state(moved(root_pos=POSE.root_pos + np.array([0.1, 0.0, 0.0])))
    assert compare(away, POSE, Parts.all(G1)) == compare(away, POSE)


LAID = moved(root_pos=np.array([0.3, 0.0, 0.12]), root_quat=np.array([np.sqrt(0.5), 0, np.sqrt(0.5), 0]))


@pytest.mark.parametrize("drawn", [POSE, LAID])
def test_a_fall_is_a_fall_however_the_rest_of_the_pose_is_drawn(compare, drawn):
    hands = Parts.only(G1, bodies=["left_wrist_yaw_link", "right_wrist_yaw_link"])
    errors = compare(state(LAID), drawn, hands)
    assert (errors.down, errors.fallen, errors.off_pose) == (True, True, True)
    assert not compare(state(POSE), drawn, hands).fallen


def test_who_was_told_to_be_low_and_not_to_get_up_has_not_fallen(compare):
    elbow = Parts.only(G1, joints=["left_elbow"])
    errors = compare(state(LOW), POSE, elbow, root=LOW)
    assert (errors.down, errors.fallen, errors.off_pose) == (False, False, False)
    assert compare(state(LAID), POSE, elbow, root=LOW).down


@pytest.mark.parametrize("ends", [(LOW, POSE), (POSE, LOW)])
def test_whoever_is_between_a_low_keyframe_and_a_high_one_is_not_down(compare, ends):
    assert not compare(state(LOW), POSE, root=POSE, ends=ends).down
    assert compare(state(LOW), POSE, root=POSE, ends=(POSE, POSE)).down
