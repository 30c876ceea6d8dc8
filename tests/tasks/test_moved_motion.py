import pytest
import torch
from tensordict import TensorDict

from plat.envs import GeneralizedState
from plat.rotations import quat_from_rotvec, quat_multiply, quat_rotate, quat_yaw
from plat.tasks.moved_motion import on_motion
from tests.tasks.keyframe_tasks import command, partial_task


@pytest.fixture(scope="module")
def task(library):
    return partial_task(library)


def turned_away(state: GeneralizedState) -> GeneralizedState:
    turn = quat_from_rotvec(torch.tensor([[0.0, 0.0, 1.0]]))
    return state._replace(
        root_pos_w=state.root_pos_w + torch.tensor([1.0, -2.0, 0.0]),
        root_quat_w=quat_multiply(turn, state.root_quat_w),
        root_lin_vel_w=quat_rotate(turn, state.root_lin_vel_w),
    )


def test_a_motion_goes_on_where_the_robot_was_free_to_go(task):
    state, memory = command(task, joints=["left_elbow"])
    memory["steps_left"] = torch.tensor([0])
    new = task.renew(memory, turned_away(state))
    new["parts"] = torch.zeros(1, dtype=torch.int64)
    # on the moved motion nothing is off: the same cost and the same view as on the motion itself
    unmoved = new.clone()
    unmoved["anchor_pos"], unmoved["anchor_quat"] = memory["anchor_pos"], memory["anchor_quat"]
    moved = turned_away(state)
    torch.testing.assert_close(task.cost(moved, new), task.cost(state, unmoved), atol=1e-3, rtol=0)
    for key in ("goal", "robot"):
        seen, wanted = task.observe(moved, new)[key], task.observe(state, unmoved)[key]
        for name, value in wanted.items():
            torch.testing.assert_close(seen[name], value, atol=1e-4, rtol=0)
    assert not task.failed(moved, new).any()


def test_a_motion_stays_where_the_command_said_so(task):
    state, memory = command(task, root=["horizontal", "orientation"])
    memory["steps_left"] = torch.tensor([0])
    new = task.renew(memory, turned_away(state))
    assert (new["anchor_pos"] == 0).all()
    assert quat_yaw(new["anchor_quat"])[0].tolist() == [1, 0, 0, 0]


def test_without_an_anchor_nothing_was_moved(task):
    state = task.table.state(torch.tensor([5]))
    assert on_motion(state, TensorDict(batch_size=[1])) is state
