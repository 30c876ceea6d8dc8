from dataclasses import replace

import numpy as np
import pytest
import torch

from plat.errors import KeyframeError
from plat.keyframes import Keyframe, interpolate, standing
from plat.robots import G1
from plat.rotations import quat_slerp


def test_qpos_goes_there_and_back():
    qpos = np.random.default_rng(0).normal(size=36)
    keyframe = Keyframe.from_qpos(0.3, qpos, "any")
    assert np.array_equal(keyframe.qpos, qpos)
    qpos[:] = 0
    assert keyframe.qpos.any()


def test_interpolation_is_linear_and_takes_the_shorter_arc():
    rng = np.random.default_rng(1)
    for _ in range(50):
        quats = rng.normal(size=(2, 4))
        quats /= np.linalg.norm(quats, axis=1, keepdims=True)
        before = Keyframe(1.0, rng.normal(size=3), quats[0], rng.normal(size=29))
        after = Keyframe(3.0, rng.normal(size=3), quats[1], rng.normal(size=29))
        weight = rng.uniform()
        middle = interpolate(before, after, 1.0 + 2.0 * weight)
        expected = quat_slerp(*torch.from_numpy(quats), torch.tensor(weight, dtype=torch.float64)).numpy()
        # q and -q are one rotation
        assert abs(middle.root_quat @ expected) == pytest.approx(1, abs=1e-12)
        np.testing.assert_allclose(middle.joint_pos, before.joint_pos * (1 - weight) + after.joint_pos * weight)
        np.testing.assert_allclose(middle.root_pos, before.root_pos * (1 - weight) + after.root_pos * weight)


def test_equal_and_opposite_quaternions_interpolate_to_unit_length():
    pose = standing(G1)
    same = interpolate(pose, pose.at(1.0), 0.4)
    np.testing.assert_allclose(same.root_quat, pose.root_quat, atol=1e-15)
    turned = replace(pose.at(1.0), root_quat=np.array([0.0, 0.0, 0.0, 1.0]))
    half = interpolate(pose, turned, 0.5).root_quat
    np.testing.assert_allclose(half, [0.5**0.5, 0, 0, 0.5**0.5], atol=1e-12)


def test_checked_makes_the_quaternion_exactly_unit():
    pose = replace(standing(G1), root_quat=np.array([1.005, 0.0, 0.0, 0.0]))
    assert np.linalg.norm(pose.checked(G1).root_quat) == 1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"root_pos": np.zeros(2)}, r"root_pos has shape \(2,\), expected \(3,\)"),
        ({"root_pos": np.array([0, np.nan, 0])}, r"root_pos\[1\] is nan"),
        ({"root_pos": np.array([0, 1e9, 0.7])}, r"puts the root 1e\+09 m away from the origin, expected meters"),
        ({"root_pos": np.array([0, 0, 76.0])}, "puts the root at a height of 76 m, expected meters, at most 5"),
        ({"root_pos": "abc"}, "root_pos is 'abc', expected 3 numbers"),
        ({"root_quat": np.array([2.0, 0, 0, 0])}, "root_quat has length 2, expected 1"),
        ({"joint_pos": np.zeros(12)}, r"joint_pos has shape \(12,\), expected \(29,\)"),
        ({"joint_pos": np.full(29, 3.0)}, r"joint_pos: 'left_ankle_roll' is 3 rad, expected -0.2618 to .* range\)$"),
        ({"joint_pos": np.full(29, 30.0)}, r"'left_ankle_roll' is 30 rad, expected .* \(its range\): in degrees\?$"),
        ({"time": np.inf}, "time is inf"),
        ({"commands": ["height"]}, r"commands is \['height'\], expected plat.keyframes.Parts"),
        ({"name": 5}, "name is 5, expected a text"),
        ({"name": "\ud800"}, "name is .*, expected a text"),
        ({"time": 10**400}, "time is 1000.*000, expected a finite number"),
        ({"root_pos": [10**400, 0, 0]}, r"root_pos is \[1000.*000, 0, 0\], expected 3 numbers"),
    ],
)
def test_what_is_wrong_is_named(changes, message):
    with pytest.raises(KeyframeError, match=message):
        replace(standing(G1), **changes).checked(G1)


def test_a_root_that_is_merely_out_of_reach_is_a_keyframe():
    far = replace(standing(G1), root_pos=[900.0, -900.0, -1.0])
    assert far.checked(G1).root_pos.tolist() == [900, -900, -1]


@pytest.mark.parametrize("qpos", [[10**400] * 36, "pose", 1.0, [[1.0]]])
def test_what_is_no_pose_is_named(qpos):
    with pytest.raises(KeyframeError, match="qpos is .*, expected numbers: root position"):
        Keyframe.from_qpos(0.0, qpos)


@pytest.mark.parametrize("time", [10**400, np.nan, "soon", None])
def test_poses_are_between_times_only(time):
    with pytest.raises(KeyframeError, match="expected different times"):
        interpolate(standing(G1), standing(G1).at(time), 0.5)


def test_a_time_may_be_that_of_a_clock_that_runs_for_weeks() -> None:
    assert standing(G1).at(1e9).checked(G1).time == 1e9
    with pytest.raises(KeyframeError, match="time is nan, expected a finite number of seconds"):
        standing(G1).at(np.nan).checked(G1)


def test_poses_of_lists_and_times_of_arrays_are_between_too():
    stand = standing(G1)
    listed = Keyframe(0.0, *(part.tolist() for part in (stand.root_pos, stand.root_quat, stand.joint_pos)))
    for time in (0.25, np.array(0.25), torch.tensor(0.25)):
        between = interpolate(listed, replace(listed, time=1.0, root_pos=[1.0, 0.0, 0.76]), time)
        np.testing.assert_allclose(between.root_pos, [0.25, 0.0, 0.76])
        assert type(between.time) is float


def test_poses_of_different_sizes_have_none_between_them():
    stand = standing(G1)
    for joints in (stand.joint_pos[:1], stand.joint_pos[:28]):  # of one joint alone NumPy would make 29
        with pytest.raises(KeyframeError, match=r"joint_pos has shape .*, expected \(29,\)"):
            interpolate(stand, replace(stand, time=1.0, joint_pos=joints), 0.5)
