from dataclasses import replace

import mujoco
import numpy as np
import pytest

from plat.errors import RobotError
from plat.robots import G1, joint_symmetry, keypoint_symmetry
from plat.rotations_np import quat_from_rotvec, quat_multiply, quat_to_matrix

HALF_TURN = quat_from_rotvec(np.array([0.0, 0.0, np.pi]))
ASKEW = quat_from_rotvec(np.array([0.4, -1.1, 0.7]))


def turned(folder, body: str, turn: np.ndarray):
    """The G1 with the frame of a link turned: its axis and what hangs on it are where they were."""
    spec = mujoco.MjSpec.from_file(str(G1.asset_path))
    link = spec.body(body)
    back = quat_to_matrix(turn).T
    link.quat = quat_multiply(link.quat, turn)
    for joint in link.joints:
        joint.axis = back @ joint.axis
    for part in link.bodies:
        part.pos = back @ part.pos
        part.quat = quat_multiply(turn * [1, -1, -1, -1], part.quat)
    spec.compile()
    (folder / "turned.xml").write_text(spec.to_xml())
    return replace(G1, name="turned", asset=str(folder / "turned.xml"))


@pytest.mark.parametrize("turn", [HALF_TURN, ASKEW])
@pytest.mark.parametrize("body", ["right_hip_roll_link", "right_elbow_link"])
def test_signs_are_of_axes_in_the_world_however_the_frame_of_a_link_is_turned(tmp_path, body, turn):
    robot = turned(tmp_path, body, turn)
    partner, sign = joint_symmetry(robot)
    for ours, theirs in zip(joint_symmetry(G1), (partner, sign), strict=True):
        np.testing.assert_array_equal(theirs, ours)
    # in a pose and its mirror image all joints are at mirrored places
    model, data = robot.model(), [mujoco.MjData(robot.model()) for _ in range(2)]
    pose = np.random.default_rng(0).uniform(-0.5, 0.5, robot.num_joints)
    for one, joints in zip(data, (pose, pose[partner] * sign), strict=True):
        one.qpos[:] = [0, 0, 0, 1, 0, 0, 0, *joints]
        mujoco.mj_kinematics(model, one)
    places = [one.xanchor[1:] for one in data]
    np.testing.assert_allclose(places[1], places[0][partner] * [1, -1, 1], atol=2e-3)


def test_an_axis_that_points_the_other_way_has_the_other_sign(tmp_path):
    """A half turn of a frame, without the axis' being turned back in it: that joint turns the other way."""
    text = G1.asset_path.read_text()
    hip = next(line for line in text.splitlines() if 'name="right_hip_pitch_joint"' in line)
    assert 'axis="0 1 0"' in hip
    (tmp_path / "other.xml").write_text(text.replace(hip, hip.replace('axis="0 1 0"', 'axis="0 -1 0"')))
    _, sign = joint_symmetry(replace(G1, name="other", asset=str(tmp_path / "other.xml")))
    changed = np.flatnonzero(sign != joint_symmetry(G1)[1])
    assert [G1.joint_names[joint] for joint in changed] == ["left_hip_pitch", "right_hip_pitch"]


def test_keypoints_change_sides():
    partner = keypoint_symmetry(G1)
    pairs = {name: G1.keypoints[other] for name, other in zip(G1.keypoints, partner, strict=True)}
    assert pairs["left_knee_link"] == "right_knee_link"
    assert pairs["pelvis"] == "pelvis"
    assert all(pairs[pairs[name]] == name for name in pairs)


def test_names_without_sides_are_refused():
    other = {name: name.replace("left_", "l_").replace("right_", "r_") for name in G1.keypoints}
    robot = replace(G1, name="short", keypoints=tuple(other.values()), feet=(other[G1.feet[0]], other[G1.feet[1]]))
    with pytest.raises(RobotError, match=r"'short': feet 'l_ankle_roll_link' .*, expected left_\.\.\. and right_"):
        keypoint_symmetry(robot)


def test_a_keypoint_without_a_partner_is_named():
    robot = replace(G1, name="one-handed", keypoints=G1.keypoints[:-1])
    with pytest.raises(RobotError, match="'one-handed': keypoints without a partner .*wrist"):
        keypoint_symmetry(robot)
