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


@pytest.mark.parametrize("axis", ["x", "y", "yaw"])
def test_a_moved_motion_has_the_gradient_of_the_robots_place(task, axis):
    state, memory = command(task, joints=["left_elbow"])
    memory["steps_left"] = torch.tensor([0])
    along, turning = torch.tensor([axis == "x", axis == "y", False]), torch.tensor([False, False, axis == "yaw"])

    def cost_off_the_motion(shift: torch.Tensor) -> torch.Tensor:
        """The cost a little off a motion, of a robot that stood or faced elsewhere when the motion was moved to it."""
        place, facing = state.root_pos_w + shift * along, quat_from_rotvec(shift * turning)
        there = state._replace(root_pos_w=place, root_quat_w=quat_multiply(facing, state.root_quat_w))
        torch.manual_seed(0)
        new = task.renew(memory.clone(), there)
        new["parts"] = torch.zeros(1, dtype=torch.int64)
        turn = quat_from_rotvec(torch.tensor([[0.0, 0.0, 0.3]]))
        off = GeneralizedState(
            place + torch.tensor([[-0.05, 0.08, 0.0]]), quat_multiply(turn, there.root_quat_w), *there[2:]
        )
        cost: torch.Tensor = task.cost(off, new).sum()
        return cost

    shift = torch.tensor(1e-4, requires_grad=True)  # no turn at all has no gradient
    (gradient,) = torch.autograd.grad(cost_off_the_motion(shift), shift)
    with torch.no_grad():
        slope = (cost_off_the_motion(torch.tensor(5e-3)) - cost_off_the_motion(torch.tensor(-5e-3))) / 1e-2
    torch.testing.assert_close(gradient, slope, atol=0.05, rtol=0.02)


def test_who_lies_down_has_a_gradient(task):
    state, memory = command(task, root=["horizontal", "orientation"])
    memory["steps_left"] = torch.tensor([0])
    lying = torch.tensor([[0.5**0.5, 0.0, 0.5**0.5, 0.0]], requires_grad=True)
    new = task.renew(memory, state._replace(root_quat_w=lying))
    (gradient,) = torch.autograd.grad(new["anchor_pos"].sum() + new["anchor_quat"].sum(), lying)
    assert gradient.isfinite().all()


def test_a_motion_stays_where_the_command_said_so(task):
    state, memory = command(task, root=["horizontal", "orientation"])
    memory["steps_left"] = torch.tensor([0])
    new = task.renew(memory, turned_away(state))
    assert (new["anchor_pos"] == 0).all()
    assert quat_yaw(new["anchor_quat"])[0].tolist() == [1, 0, 0, 0]


def test_without_an_anchor_nothing_was_moved(task):
    state = task.table.state(torch.tensor([5]))
    assert on_motion(state, TensorDict(batch_size=[1])) is state
