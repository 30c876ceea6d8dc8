import torch

from plat.motions.generation.whole_body import WholeBody
from plat.robots import G1, ForwardKinematics
from plat.rotations import quat_angle, quat_from_rotvec


def solve(feet_shift, tilt=(0.0, 0.0, 0.0), weight=1.0):
    default = torch.as_tensor(G1.default_qpos)[None]
    root_pos, root_quat, joint_pos = default.split((3, 4, 29), -1)
    kinematics = ForwardKinematics(G1, G1.feet)
    feet_pos, _ = kinematics(root_pos, root_quat, joint_pos)
    feet_pos = feet_pos + torch.tensor(feet_shift, dtype=torch.float64)
    feet_quat = quat_from_rotvec(torch.tensor(tilt, dtype=torch.float64)).expand(1, 2, 4)
    weights = torch.full((1, 2), weight, dtype=torch.float64)
    solved, pos_off, rot_off = WholeBody(G1).solve_legs(root_pos, root_quat, feet_pos, feet_quat, weights, joint_pos)
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
