import torch

from plat.robots import G1, ForwardKinematics
from plat.rotations import quat_rotate


def test_keypoints_come_in_the_robots_order():
    kinematics = ForwardKinematics(G1)
    pos, _ = kinematics(torch.tensor([1.0, 2.0, 0.8]), torch.tensor([1.0, 0, 0, 0]), G1.default_joint_pos)
    torch.testing.assert_close(pos[0], torch.tensor([1.0, 2.0, 0.8]))
    left, right = (G1.keypoints.index(f"{side}_ankle_roll_link") for side in ("left", "right"))
    assert pos[left, 1] > pos[right, 1]


def test_points_on_bodies_are_where_their_poses_say():
    bodies = (*G1.keypoints, *G1.feet)
    kinematics = ForwardKinematics(G1, bodies)
    root_pos = torch.randn(2, 3, 3, dtype=torch.float64)
    root_quat = torch.nn.functional.normalize(torch.randn(2, 3, 4, dtype=torch.float64), dim=-1)
    joint_pos = torch.randn(2, 3, G1.num_joints, dtype=torch.float64)
    offset = torch.randn(len(bodies), 3)
    pos, quat = kinematics(root_pos, root_quat, joint_pos)
    torch.testing.assert_close(kinematics.positions(root_pos, root_quat, joint_pos), pos, rtol=0, atol=1e-6)
    found = kinematics.positions(root_pos, root_quat, joint_pos, offset)
    torch.testing.assert_close(found, pos + quat_rotate(quat, offset.double().expand_as(pos)), rtol=0, atol=1e-6)


def test_positions_have_the_gradient_of_poses():
    kinematics, twice = ForwardKinematics(G1), []
    root_quat = torch.randn(5, 4, dtype=torch.float64)
    pull = torch.randn(5, len(G1.keypoints), 3, dtype=torch.float64)
    root_pos = torch.randn(5, 3)
    for positions in (kinematics.positions, lambda *pose: kinematics(*pose)[0]):
        pose = (root_pos, root_quat, torch.linspace(-1, 1, 145, dtype=torch.float64).view(5, 29))
        pose = tuple(part.double().requires_grad_() for part in pose)
        unit = torch.nn.functional.normalize(pose[1], dim=-1)
        twice.append(torch.autograd.grad((pull * positions(pose[0], unit, pose[2])).sum(), pose))
    for found, wanted in zip(*twice, strict=True):
        torch.testing.assert_close(found, wanted, rtol=0, atol=1e-6)


def test_batches_broadcast():
    kinematics = ForwardKinematics(G1)
    pos, quat = kinematics(torch.zeros(2, 5, 3), torch.tensor([1.0, 0, 0, 0]).expand(2, 5, 4), torch.zeros(2, 5, 29))
    assert pos.shape == (2, 5, 14, 3)
    assert quat.shape == (2, 5, 14, 4)


def test_gradients_match_finite_differences():
    kinematics = ForwardKinematics(G1, ("left_wrist_yaw_link",))
    joint_pos = G1.default_joint_pos.double().requires_grad_()
    root = (torch.zeros(3, dtype=torch.float64), torch.tensor([1.0, 0, 0, 0], dtype=torch.float64))
    assert torch.autograd.gradcheck(lambda q: kinematics(*root, q)[0], (joint_pos,), atol=1e-6)
