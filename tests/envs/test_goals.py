import pytest
import torch
from tensordict import TensorDict

from plat.envs import entry_shapes, robot_centric_goal
from plat.robots import G1
from plat.rotations import matrix_to_sixd, quat_from_rotvec, quat_multiply, quat_rotate, quat_to_matrix


def random_pose(count: int) -> TensorDict:
    quat = torch.nn.functional.normalize(torch.randn(count, 14, 4), dim=-1)
    fields = {"joint_pos": torch.randn(count, 29), "keypoint_pos": torch.randn(count, 14, 3), "keypoint_quat": quat}
    return TensorDict(fields, [count])


@pytest.fixture
def scene() -> tuple[TensorDict, torch.Tensor, torch.Tensor]:
    return random_pose(16), torch.randn(16, 3), torch.nn.functional.normalize(torch.randn(16, 4), dim=-1)


def test_moving_and_turning_the_world_changes_nothing(scene):
    target, root_pos, root_quat = scene
    turn = quat_from_rotvec(torch.tensor([0.4, -1.2, 2.0]))
    shift = torch.tensor([3.0, -7.0, 0.5])
    moved = target.clone()
    moved["keypoint_pos"] = quat_rotate(turn, target["keypoint_pos"]) + shift
    moved["keypoint_quat"] = quat_multiply(turn.expand(16, 14, 4), target["keypoint_quat"])
    before = robot_centric_goal(target, root_pos, root_quat)
    after = robot_centric_goal(moved, quat_rotate(turn, root_pos) + shift, quat_multiply(turn.expand(16, 4), root_quat))
    for key, value in before.items():
        torch.testing.assert_close(after[key], value, atol=1e-4, rtol=1e-4)


def test_a_robot_at_its_goal_sees_no_offset(scene):
    target, _, _ = scene
    goal = robot_centric_goal(target, target["keypoint_pos"][:, 0], target["keypoint_quat"][:, 0])
    torch.testing.assert_close(goal["root_pos_b"], torch.zeros(16, 3), atol=1e-5, rtol=0)
    torch.testing.assert_close(
        goal["root_rot6d_b"], torch.tensor([1.0, 0, 0, 0, 1, 0]).expand(16, 6), atol=1e-5, rtol=0
    )


def test_goal_ahead_is_along_x():
    target = random_pose(1)
    heading = quat_from_rotvec(torch.tensor([[0.0, 0.0, 1.0]]))
    target["keypoint_pos"][:, 0] = quat_rotate(heading, torch.tensor([[2.0, 0.0, 0.0]]))
    goal = robot_centric_goal(target, torch.zeros(1, 3), heading)
    torch.testing.assert_close(goal["root_pos_b"], torch.tensor([[2.0, 0.0, 0.0]]))


def test_entries_against_matrices(scene):
    target, root_pos, root_quat = scene
    goal = robot_centric_goal(target, root_pos, root_quat)
    inverse = quat_to_matrix(root_quat).transpose(-1, -2)
    keypoints = torch.einsum("nij,nkj->nki", inverse, target["keypoint_pos"] - root_pos[:, None])
    torch.testing.assert_close(goal["keypoint_pos_b"], keypoints.flatten(1))
    relative = inverse @ quat_to_matrix(target["keypoint_quat"][:, 0])
    torch.testing.assert_close(goal["root_rot6d_b"], matrix_to_sixd(relative))


def test_sequences_equal_their_frames(library):
    frame = torch.tensor([[0, 3, 9], [5, 6, 7]])
    root_pos, root_quat = torch.randn(2, 3), torch.nn.functional.normalize(torch.randn(2, 4), dim=-1)
    together = robot_centric_goal(library.poses(frame), root_pos, root_quat)
    for index in range(3):
        alone = robot_centric_goal(library.poses(frame[:, index]), root_pos, root_quat)
        for key, value in alone.items():
            torch.testing.assert_close(together[key][:, index], value)


def test_shapes_are_the_declared_ones(scene):
    goal = robot_centric_goal(*scene)
    assert {key: tuple(value.shape[1:]) for key, value in goal.items()} == entry_shapes("goal", G1)
