import math

import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torchrl.envs.utils import check_env_specs

from plat.envs import GeneralizedState
from plat.errors import ConfigError, TaskError
from plat.modules import DynamicsModel
from plat.objectives import ImaginationLoss
from plat.robots import G1
from plat.tasks import DenseTracking, SimulatedTask, Task, TrackingCosts, robot_entries


class Stand(Task):
    """Stand at a height: a task of one's own."""

    def start(self, count):
        qpos = torch.as_tensor(self.robot.default_qpos, dtype=torch.float32).expand(count, -1)
        state = GeneralizedState.unpack(torch.cat((qpos, torch.zeros(count, 35)), -1))
        return state, TensorDict({"last_action": torch.zeros(count, 29)}, [count])

    def observe(self, state, memory):
        return TensorDict({"robot": robot_entries(state, memory["last_action"], self.robot)}, memory.batch_size)

    def cost(self, state, memory):
        return (state.root_pos_w[:, 2] - 0.6).abs()


class Squat(Stand):
    """Go to a height that changes every third step."""

    in_place = False

    def start(self, count):
        state, memory = super().start(count)
        return state, memory.update({"height": torch.full((count, 1), 0.6), "steps": torch.zeros(count, 1)})

    def observe(self, state, memory):
        return super().observe(state, memory).update({"seen": memory["height"], "age": memory["steps"] + 0})

    def cost(self, state, memory):
        return ((1 + memory["height"]) * state.root_pos_w[:, 2:])[:, 0]  # its gradient needs the height later on

    def advance(self, memory, action):
        memory = memory if self.in_place else memory.clone()
        memory["steps"] += 1
        memory["last_action"].copy_(action)
        return memory

    def renew(self, memory, state):
        memory = memory if self.in_place else memory.clone()
        due = memory["steps"] % 3 == 0
        memory["height"][due] += 0.01
        memory["last_action"][due[:, 0]] = 0.0
        return memory


class SquatInPlace(Squat):
    in_place = True


def test_specifications_hold(library):
    check_env_specs(SimulatedTask(DenseTracking(library), 3))
    check_env_specs(SimulatedTask(Stand(G1), 3))


def test_a_task_of_ones_own_runs_and_ends_by_falling():
    env = SimulatedTask(Stand(G1), 2)
    rollout = env.rollout(100, lambda td: td.set("action", torch.full((2, 29), 3.0)), break_when_any_done=False)
    assert rollout["next", "terminated"].any()
    first = rollout["next", "robot_state"][:, 0, 2]
    torch.testing.assert_close(rollout["next", "reward"][:, 0, 0], -(first - 0.6).abs())


def test_a_task_may_write_to_the_memory_that_it_advances_and_renews():
    def act(joint_pos):
        return 0.1 * joint_pos

    policy = TensorDictModule(act, [("robot", "joint_pos")], ["action"])
    rollouts = [SimulatedTask(kind(G1), 2).rollout(7, policy) for kind in (Squat, SquatInPlace)]
    assert (rollouts[0] == rollouts[1]).all()
    assert rollouts[1]["seen"][0, :, 0].tolist() == pytest.approx([0.6, 0.6, 0.6, 0.61, 0.61, 0.61, 0.62])
    torch.testing.assert_close(rollouts[1]["seen"], rollouts[1]["memory", "height"])
    torch.testing.assert_close(rollouts[1]["age"], rollouts[1]["memory", "steps"])
    weights = torch.nn.Linear(29, 29)
    policy = TensorDictModule(weights, [("robot", "joint_pos")], ["action"])
    model, found = DynamicsModel(G1), []
    for kind in (Squat, SquatInPlace):
        task = kind(G1)
        state, memory = task.start(4)
        begin = TensorDict({"robot_state": state.pack(), "memory": memory}, [4])
        before = begin.clone()
        loss = ImaginationLoss(policy, model, task, steps=4)(begin)["loss_policy"]
        assert (begin == before).all()
        found.append((loss.detach(), *torch.autograd.grad(loss, list(weights.parameters()))))
    torch.testing.assert_close(*found, rtol=0, atol=0)


WRONG = {
    "cost": (
        lambda self, state, memory: state.root_pos_w[:, 2:],
        r"cost\(\) returns \(2, 1\), torch.float32; expected costs",
    ),
    "failed": (lambda self, state, memory: state.root_pos_w[:, 2:] < 0.4, r"\(2, 1\), torch.bool; expected a mask"),
    "finished": (lambda self, memory: torch.zeros(2), r"finished\(\) returns \(2,\), torch.float32; expected a mask"),
}


def refused_everywhere(task, simulated, imagined):
    with pytest.raises(TaskError, match=simulated):
        SimulatedTask(task, 2).rollout(2)
    state, memory = task.start(2)
    actor = TensorDictModule(torch.nn.Linear(29, 29), in_keys=[("robot", "joint_pos")], out_keys=["action"])
    loss = ImaginationLoss(actor, DynamicsModel(G1), task, steps=2)
    with pytest.raises(TaskError, match=imagined):
        loss(TensorDict({"robot_state": state.pack(), "memory": memory}, [2]))


@pytest.mark.parametrize("method", WRONG)
def test_what_would_be_broadcast_is_refused(method):
    wrong, message = WRONG[method]
    task = type("Mine", (Stand,), {method: wrong})(G1)
    refused_everywhere(task, rf"^Mine\..*{message}", message)


@pytest.mark.parametrize(
    ("method", "wrong", "message"),
    [
        ("start", lambda self, count: Stand.start(self, count + 1), r"Mine.start\(2\): expected .* of 2 robots"),
        ("start", lambda self, count: None, r"Mine.start\(2\): expected a GeneralizedState"),
        (
            "start",
            lambda self, count: tuple(
                part.set("last_action", torch.zeros(2, 12)) if index else part
                for index, part in enumerate(Stand.start(self, count))
            ),
            r"expected .* a TensorDict \[2\] with their 'last_action' \[2, 29\]",
        ),
        ("observe", lambda self, state, memory: {}, r"Mine.observe\(\) returns dict, expected a TensorDict \[2\]"),
    ],
)
def test_a_start_and_an_observation_are_of_these_robots(method, wrong, message):
    with pytest.raises(TaskError, match=message):
        SimulatedTask(type("Mine", (Stand,), {method: wrong})(G1), 2)


@pytest.mark.parametrize(
    ("method", "wrong", "found"),
    [
        ("advance", lambda self, memory, action: None, "NoneType"),
        ("renew", lambda self, memory, state: None, "NoneType"),
        ("renew", lambda self, memory, state: memory[:1], r"\[1\]"),
    ],
)
def test_a_method_that_returns_no_memory_is_named(method, wrong, found):
    task = type("Mine", (Stand,), {method: wrong})(G1)
    message = rf"^Mine\.{method}\(\) returns {found}, expected the memory \[2\]$"
    refused_everywhere(task, message, message)


def test_only_failed_robots_start_again(library):
    env = SimulatedTask(DenseTracking(library), 4)
    tensordict = env.reset()
    reset = torch.tensor([True, False, False, True])[:, None]
    before = tensordict["robot_state"].clone()
    after = env.reset(tensordict.set("_reset", reset))["robot_state"]
    assert after[1:3].equal(before[1:3])
    assert not after[0].equal(before[0])


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e30])
def test_a_robot_with_an_absurd_action_is_terminated_and_its_siblings_are_untouched(library, value):
    after = []
    for broken in (False, True):
        torch.manual_seed(0)
        env = SimulatedTask(Stand(G1), 3)
        tensordict = env.reset()
        tensordict["action"] = torch.zeros(3, 29)
        if broken:
            tensordict["action"][1, 7] = value
        after.append(env.step(tensordict)["next"])
        assert env.broken.count == int(broken)
    assert after[1]["terminated"][:, 0].tolist() == [False, True, False]
    same = [step["robot_state"][[0, 2]] for step in after]
    torch.testing.assert_close(*same, rtol=0, atol=0)
    assert all(entry.isfinite().all() for entry in after[1].values(True, True) if entry.is_floating_point())


def test_a_simulation_that_diverges_is_terminated(library):
    env = SimulatedTask(Stand(G1), 2)
    tensordict = env.reset()
    qpos, qvel = env.physics.state()
    qvel[1, 10] = 1e12  # MuJoCo resets it in the next step, upright at the origin
    env.physics.set_state(torch.arange(2), qpos.double(), qvel.double())
    tensordict["action"] = torch.zeros(2, 29)
    assert env.step(tensordict)["next", "terminated"][:, 0].tolist() == [False, True]


def test_a_dense_reference_has_no_costs_of_partial_keyframes(library):
    with pytest.raises(ConfigError, match=r"DenseTracking: costs.bodies is 3, expected 2: it is of partial keyframes"):
        DenseTracking(library, costs=TrackingCosts(bodies=3.0))


@pytest.mark.parametrize(("name", "per_meter"), [("end_effectors", 1.0), ("miss", 5 / 0.25)])
def test_end_effectors_and_near_misses_cost_along_a_dense_reference(library, name, per_meter):
    plain, costly = (DenseTracking(library, costs=TrackingCosts(**weights)) for weights in ({}, {name: 1.0}))
    reference, memory = plain.at(torch.tensor([0, 20]))
    reference = plain.table.state(memory["frame"])
    lifted = [
        reference._replace(root_pos_w=reference.root_pos_w + torch.tensor([0.0, 0.0, height])) for height in (0.2, 0.3)
    ]
    near, far = (costly.cost(state, memory) - plain.cost(state, memory) for state in lifted)
    # of anchor and four end effectors each; the reference itself costs nothing
    torch.testing.assert_close(far - near, torch.full((2,), 0.1 * per_meter), rtol=0.01, atol=1e-3)
    same = costly.cost(reference, memory) - plain.cost(reference, memory)
    assert float(same.abs().max()) < 0.02
