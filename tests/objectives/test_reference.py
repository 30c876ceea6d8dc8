import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule

from plat.errors import TaskError
from plat.modules import LatentPolicy, PlainPolicy
from plat.objectives import ReferenceLoss
from plat.robots import G1
from plat.tasks import DenseTracking, TimedKeyframes, TimedKeyframesConfig


@pytest.fixture
def task(library):
    return TimedKeyframes(library, TimedKeyframesConfig(chains=6))


def batch(task, count=8):
    state, memory = task.start(count)
    return TensorDict({"robot_state": state.pack(), "memory": memory}, [count])


def test_it_is_zero_where_joint_targets_are_the_next_frame_of_motion_or_line(task):
    states = batch(task)
    wanted = task.reference(task.advance(states["memory"].clone(), states["memory", "last_action"]))
    action = (wanted - G1.default_joint_pos) / G1.action_scale
    acts = TensorDictModule(lambda _: action, [("command", "horizon")], ["action"])
    assert float(ReferenceLoss(acts, task)(states)["loss_reference"]) < 1e-10
    along = ~states["memory", "authored"]
    following = task.table.state(states["memory", "frame"][along] + 1).joint_pos
    assert bool(along.any())
    assert wanted[along].equal(following)


def test_a_policy_learns_it(task):
    torch.manual_seed(0)
    policy, states = PlainPolicy(G1), batch(task, 32)
    loss, optimizer = ReferenceLoss(policy.deployed(), task), torch.optim.Adam(policy.parameters(), lr=1e-3)
    errors = []
    for _ in range(60):
        value = loss(states)["loss_reference"]
        optimizer.zero_grad()
        value.backward()
        optimizer.step()
        errors.append(float(value.detach()))
    assert errors[-1] < 0.3 * errors[0]


def test_a_task_without_a_reference_is_refused(library):
    task = DenseTracking(library)
    acts = TensorDictModule(torch.zeros_like, [("robot", "last_action")], ["action"])
    with pytest.raises(TaskError, match=r"DenseTracking.reference\(\) returns None; expected \(8, 29\)"):
        ReferenceLoss(acts, task)(batch(task))


def test_a_posterior_is_shown_its_privileged_goals(task):
    policy = LatentPolicy(G1)
    loss = ReferenceLoss(policy.imagined(0.5), task)(batch(task))["loss_reference"]
    loss.backward()
    assert float(policy.posterior.module.network[0].weight.grad.abs().sum()) > 0
