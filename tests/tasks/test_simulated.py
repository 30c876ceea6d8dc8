import torch
from tensordict import TensorDict
from torchrl.envs.utils import check_env_specs

from plat.envs import GeneralizedState
from plat.robots import G1
from plat.tasks import DenseTracking, SimulatedTask, Task, robot_entries


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


def test_specifications_hold(library):
    check_env_specs(SimulatedTask(DenseTracking(library), 3))
    check_env_specs(SimulatedTask(Stand(G1), 3))


def test_a_task_of_ones_own_runs_and_ends_by_falling():
    env = SimulatedTask(Stand(G1), 2)
    rollout = env.rollout(100, lambda td: td.set("action", torch.full((2, 29), 3.0)), break_when_any_done=False)
    assert rollout["next", "terminated"].any()
    first = rollout["next", "robot_state"][:, 0, 2]
    torch.testing.assert_close(rollout["next", "reward"][:, 0, 0], -(first - 0.6).abs())


def test_only_failed_robots_start_again(library):
    env = SimulatedTask(DenseTracking(library), 4)
    tensordict = env.reset()
    reset = torch.tensor([True, False, False, True])[:, None]
    before = tensordict["robot_state"].clone()
    after = env.reset(tensordict.set("_reset", reset))["robot_state"]
    assert after[1:3].equal(before[1:3])
    assert not after[0].equal(before[0])
