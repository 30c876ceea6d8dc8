import pytest
import torch

from plat.robots import G1
from plat.rotations import quat_rotate
from plat.tasks.partial_costs import partial_pose_cost
from tests.tasks.keyframe_tasks import command, partial_task

LEFT_HAND = G1.keypoints.index("left_wrist_yaw_link")


@pytest.fixture(scope="module")
def task(library):
    return partial_task(library)


def test_what_is_not_commanded_is_not_shown(task):
    state, memory = command(task, bodies=["left_wrist_yaw_link"], joints=["right_knee"], root=["height"])
    goal = task.observe(state, memory)["goal"]
    whole = task.observe(state, memory.clone().set("parts", torch.zeros(1, dtype=torch.int64)))["goal"]
    points, whole_points = goal["keypoint_pos_b"].view(14, 3), whole["keypoint_pos_b"].view(14, 3)
    assert points[LEFT_HAND].equal(whole_points[LEFT_HAND])
    assert (points.abs().sum(-1) > 0).nonzero()[:, 0].tolist() == [LEFT_HAND]
    knee = G1.joint_names.index("right_knee")
    assert (goal["joint_pos"][0] != 0).nonzero()[:, 0].tolist() == [knee]
    assert (goal["root_rot6d_b"] == 0).all()
    # the commanded height is a vertical line in the world, whatever the tilt of the root
    height = task.table.state(memory["goal"]).root_pos_w[0, 2] - state.root_pos_w[0, 2]
    torch.testing.assert_close(quat_rotate(state.root_quat_w, goal["root_pos_b"])[0], torch.tensor([0.0, 0.0, height]))


def test_masks_are_shown(task):
    state, memory = command(task, bodies=["left_wrist_yaw_link"], root=["orientation"])
    parts = task.observe(state, memory)["parts"]
    assert parts["bodies"][0].nonzero()[:, 0].tolist() == [LEFT_HAND]
    assert parts["root"][0].tolist() == [0, 0, 1]
    assert (parts["joints"] == 0).all()


def test_only_what_is_commanded_costs(task):
    _, memory = command(task, joints=["left_elbow"])
    goal = task.table.state(memory["goal"])
    elsewhere = goal._replace(root_pos_w=goal.root_pos_w + 1.0, joint_pos=goal.joint_pos.clone())
    elbow = G1.joint_names.index("left_elbow")
    elsewhere.joint_pos[:, :elbow] += 1.0
    parts, weights = task.masks.table[memory["parts"]], task.config.tracking
    at_goal = partial_pose_cost(goal, goal, parts, weights)
    torch.testing.assert_close(partial_pose_cost(elsewhere, goal, parts, weights), at_goal)
    elsewhere.joint_pos[:, elbow] += 0.5
    torch.testing.assert_close(partial_pose_cost(elsewhere, goal, parts, weights), at_goal + 1.5)


def test_a_commanded_hand_costs_its_distance_in_the_window(task):
    state, memory = command(task, steps_left=2, bodies=["left_wrist_yaw_link"])
    memory["goal"] = memory["frame"].clone()
    there = task.cost(state, memory)
    raised = state._replace(root_pos_w=state.root_pos_w + torch.tensor([0.0, 0.0, 0.3]))
    # half of the tracking cost of 2 a meter, and the hand's own 2 a meter
    torch.testing.assert_close(
        task.cost(raised, memory) - there, torch.tensor([0.5 * 2 * 0.3 + 2 * 0.3]), atol=0.03, rtol=0
    )
