from dataclasses import replace

import pytest
import torch

from plat.motions.generation.whole_body import WholeBody, has_six_joint_legs
from plat.robots import G1, ForwardKinematics, Robot
from plat.rotations import quat_angle, quat_from_rotvec


def solve(feet_shift, tilt=(0.0, 0.0, 0.0), weight=1.0, robot=G1):
    default = torch.as_tensor(robot.default_qpos)[None]
    root_pos, root_quat, joint_pos = default.split((3, 4, 29), -1)
    kinematics = ForwardKinematics(robot, robot.feet)
    feet_pos, _ = kinematics(root_pos, root_quat, joint_pos)
    feet_pos = feet_pos + torch.tensor(feet_shift, dtype=torch.float64)
    feet_quat = quat_from_rotvec(torch.tensor(tilt, dtype=torch.float64)).expand(1, 2, 4)
    weights = torch.full((1, 2), weight, dtype=torch.float64)
    solved, pos_off, rot_off = WholeBody(robot).solve_legs(root_pos, root_quat, feet_pos, feet_quat, weights, joint_pos)
    reached = kinematics(root_pos, root_quat, solved)
    return solved, pos_off, rot_off, (reached[0] - feet_pos).norm(dim=-1), quat_angle(reached[1], feet_quat)


def test_feet_get_where_they_are_wanted():
    solved, pos_off, rot_off, distance, angle = solve([[[0.1, 0.02, 0.05], [-0.1, 0.0, 0.03]]], tilt=(0.0, 0.2, 0.1))
    assert distance.max() < 1e-5
    assert angle.max() < 1e-5
    assert max(pos_off.max(), rot_off.max()) < 1e-5
    assert (solved[:, 12:] == torch.as_tensor(G1.default_qpos)[None, 19:]).all()


def test_what_is_reported_is_how_far_they_stay_off():
    _, pos_off, rot_off, distance, angle = solve([[[0.0, 0.0, 0.0], [0.9, 0.0, 0.0]]])
    torch.testing.assert_close(pos_off, distance)
    torch.testing.assert_close(rot_off, angle)
    assert pos_off[0, 0] < 1e-5
    assert pos_off[0, 1] > 0.1


def test_a_foot_that_may_tilt_gets_its_position():
    # the ankle rolls by 0.26 rad at most
    shift, tilt = [[[0.0, 0.15, 0.1], [0.0, -0.15, 0.1]]], (0.0, 0.0, 0.0)
    stiff = solve(shift, tilt, weight=1.0)
    loose = solve(shift, tilt, weight=0.03)
    assert stiff[1].max() > 5e-3
    assert loose[1].max() < 0.1 * stiff[1].max()
    low, high = G1.joint_range.double().T
    assert ((loose[0] >= low - 1e-6) & (loose[0] <= high + 1e-6)).all()


@pytest.fixture
def other_ankles(tmp_path) -> Robot:
    """The G1, called as if its ankles rolled first, on feet that are links of their own below."""
    spec = G1.spec()
    spec.delete(spec.geom("floor"))
    for foot in G1.feet:
        spec.body(foot).add_body(name=f"{foot}_sole", pos=[0.03, 0.0, -0.03])
    spec.compile()
    text = spec.to_xml()
    for one, other in (
        ("_ankle_pitch_joint", "_first"),
        ("_ankle_roll_joint", "_ankle_pitch_joint"),
        ("_first", "_ankle_roll_joint"),
    ):
        text = text.replace(one, other)
    (tmp_path / "robot.xml").write_text(text)
    soles = {foot: f"{foot}_sole" for foot in G1.feet}
    pose = {name.replace("ankle_pitch", "ankle_roll"): angle for name, angle in G1.default_pose.items()}
    named = {
        field: tuple(soles.get(body, body) for body in getattr(G1, field))
        for field in ("keypoints", "end_effectors", "feet")
    }
    return replace(G1, name="other-ankles", asset=str(tmp_path / "robot.xml"), default_pose=pose, **named)


def test_legs_end_in_the_robots_own_feet_in_any_order_of_their_joints(other_ankles):
    assert has_six_joint_legs(other_ankles)
    shift, tilt = [[[0.1, 0.02, 0.05], [-0.1, 0.0, 0.03]]], (0.0, 0.2, 0.1)
    _, pos_off, rot_off, distance, angle = solve(shift, tilt, robot=other_ankles)
    assert max(distance.max(), angle.max(), pos_off.max(), rot_off.max()) < 1e-5
