import math

import pytest
import torch
from tensordict.nn import TensorDictModule

from plat.envs import MotionTrackingEnv, make_keyframe_env, make_tracking_env
from plat.envs.broken import ABSURD_ACTION
from plat.envs.transforms import pop_statistics
from plat.errors import ActionError
from plat.motions import MotionLibrary


def step(env: MotionTrackingEnv, actions: torch.Tensor):
    tensordict = env.reset()
    tensordict["action"] = actions
    return env.step(tensordict)["next"]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e30, 2 * ABSURD_ACTION])
def test_a_robot_with_an_absurd_action_is_terminated_and_its_siblings_are_untouched(
    library: MotionLibrary, value: float
) -> None:
    after = []
    for broken in (False, True):
        torch.manual_seed(0)
        env = MotionTrackingEnv(library, 3)
        actions = torch.zeros(3, 29)
        if broken:
            actions[1, 7] = value
        after.append(step(env, actions))
        assert env.broken.count == int(broken)
    assert after[0]["terminated"][:, 0].tolist() == [False, False, False]
    assert after[1]["terminated"][:, 0].tolist() == [False, True, False]
    assert after[1]["done"][:, 0].tolist() == [False, True, False]
    for key in ("joint_pos", "joint_vel", "gravity_b"):
        torch.testing.assert_close(after[1]["robot", key][[0, 2]], after[0]["robot", key][[0, 2]], rtol=0, atol=0)
    assert all(torch.isfinite(entry).all() for entry in after[1].values(True, True) if entry.is_floating_point())


def test_large_actions_of_falling_robots_are_no_fault(library: MotionLibrary) -> None:
    env = MotionTrackingEnv(library, 2)
    assert not step(env, torch.full((2, 29), 300.0))["terminated"].any()


def test_a_simulation_that_diverges_is_terminated(library: MotionLibrary) -> None:
    env = MotionTrackingEnv(library, 2)
    tensordict = env.reset()
    qpos, qvel = env.physics.state()
    qvel[1, 10] = 1e12  # MuJoCo resets it in the next step, upright at the origin
    env.physics.set_state(torch.arange(2), qpos.double(), qvel.double())
    tensordict["action"] = torch.zeros(2, 29)
    assert env.step(tensordict)["next", "terminated"][:, 0].tolist() == [False, True]
    assert env.physics.diverged().tolist() == [False, True]


def test_tasks_keep_the_termination(library: MotionLibrary) -> None:
    env = make_keyframe_env(library, 2)
    tensordict = env.reset()
    tensordict["action"] = torch.tensor([0.0, math.nan])[:, None].expand(2, 29).clone()
    assert bool(env.step(tensordict)["next", "terminated"][1])
    assert pop_statistics(env)["broken"] == 1.0
    assert "broken" not in pop_statistics(env)


@pytest.mark.parametrize("make", [make_tracking_env, make_keyframe_env])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e30, 2 * ABSURD_ACTION])
def test_a_step_with_an_absurd_action_is_paid_nothing(library: MotionLibrary, make, value: float) -> None:
    env = make(library, 2)
    actions = torch.zeros(2, 29)
    actions[1, 7] = value
    after = step(env, actions)
    assert after["terminated"][1, 0]
    assert after["reward"][1, 0] == 0.0
    assert after["reward"][0, 0] != 0.0
    assert all(math.isfinite(mean) for mean in pop_statistics(env).values())


def test_a_policy_that_goes_on_like_that_is_stopped_by_one_line(library: MotionLibrary) -> None:
    env = MotionTrackingEnv(library, 2)
    broken = TensorDictModule(lambda pos: torch.full_like(pos, math.nan), [("robot", "joint_pos")], ["action"])
    with pytest.raises(ActionError, match=r"2 of 2 robots had actions that are not finite") as raised:
        env.rollout(60, broken, break_when_any_done=False)
    assert "\n" not in str(raised.value)
