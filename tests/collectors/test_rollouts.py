import os
import subprocess
import sys
from contextlib import nullcontext
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest
import torch
from tensordict.nn import TensorDictModule
from torchrl.envs import RewardSum, SerialEnv, TransformedEnv

from plat.collectors import MixedPolicy, Rollouts, rollouts, simulation_threads
from plat.envs import TrackingTaskConfig, make_keyframe_env, make_tracking_env
from plat.envs.transforms import RandomizationRanges
from plat.errors import ConfigError, StateError
from plat.modules import Expert, PlainPolicy, PlainPolicyConfig
from plat.motions import MotionLibrary, generate_motions
from plat.objectives import autocast, exploring
from plat.robots import G1
from plat.spec.timing import Timing
from plat.tasks import SimulatedTask, TimedKeyframes, TimedKeyframesConfig


@cache
def motions() -> MotionLibrary:
    return MotionLibrary.from_clips(generate_motions("train", seconds=8))


def small_env(num_envs: int = 2):
    return make_tracking_env(motions(), num_envs)


def test_each_rollout_goes_on_where_the_last_ended():
    batches = rollouts(small_env(), Expert(G1).actor(), steps=3)
    first, second = next(batches), next(batches)
    ended, begun = first["next", "motion", "frame"][:, -1], second["motion", "frame"][:, 0]
    going = ~first["next", "done"][:, -1, 0]
    assert torch.equal(begun[going], ended[going])


LONG = Timing(max_steps=150)


@pytest.mark.parametrize(
    "make_env",
    [
        lambda timing: make_keyframe_env(motions(), 2, timing=timing),
        lambda timing: SimulatedTask(TimedKeyframes(motions(), TimedKeyframesConfig(chains=6), timing=timing), 2),
    ],
)
def test_a_policy_is_refused_where_the_same_number_is_another_time(make_env):
    policy = exploring(PlainPolicy(G1, PlainPolicyConfig(timing=LONG)).deployed(), 0.1)
    with pytest.raises(ConfigError, match=r"max_steps=150.* of the policy, expected the environment's .*max_steps=50"):
        rollouts(make_env(Timing()), policy, steps=2)
    assert next(rollouts(make_env(LONG), policy, steps=2)).shape == (2, 2)


def test_who_reads_no_command_may_be_made_for_others():
    env = make_keyframe_env(motions(), 2, timing=LONG)
    expert = Expert(G1).deployed("dense_goal")
    assert next(rollouts(env, expert, steps=2)).shape == (2, 2)
    # a mixture acts by its student
    student = PlainPolicy(G1, PlainPolicyConfig(timing=LONG))
    assert next(rollouts(env, MixedPolicy(student.sampled(), Expert(G1).labels(), 0.5), steps=2)).shape == (2, 2)


def test_transforms_around_transforms_are_gathered_and_resumed():
    def make():
        config = TrackingTaskConfig(randomization=RandomizationRanges())
        return TransformedEnv(make_tracking_env(motions(), 2, config), RewardSum(), auto_unwrap=False)

    policy = exploring(Expert(G1).deployed(), 0.3)
    source, other = rollouts(make(), policy, steps=5), rollouts(make(), policy, steps=5)
    next(source)
    assert "reward/anchor_pos" in source.statistics()
    state, random = source.state_dict(), torch.get_rng_state()
    wanted = next(source)
    other.load_state_dict(state)
    torch.set_rng_state(random)
    found = next(other)
    for key in (("robot", "joint_pos"), ("next", "reward"), ("next", "episode_reward")):
        assert torch.equal(found[key], wanted[key]), key


def test_one_transform_around_environments_side_by_side_gathers_nothing():
    with rollouts(TransformedEnv(SerialEnv(2, small_env), RewardSum()), Expert(G1).actor(), steps=2) as source:
        next(source)
        assert source.statistics() == {}


def test_environments_side_by_side_make_as_many_steps_and_have_no_state(monkeypatch):
    env = SerialEnv(2, lambda: small_env(3))
    source, limits = rollouts(env, Expert(G1).actor(), steps=4), []
    module = import_module("plat.collectors.rollouts")
    monkeypatch.setattr(module, "simulation_threads", lambda num_envs: limits.append(num_envs) or nullcontext())
    assert next(source).shape == next(source).shape == (2, 3, 4)
    assert limits == [6, 6]
    for going in (lambda: source.state_dict(), lambda: source.load_state_dict({"robots": {}, "observation": {}})):
        with pytest.raises(StateError, match="a SerialEnv has no state to go on from; simulate all robots in one"):
            going()
    source.close()
    assert env.is_closed
    source.close()


def test_robots_of_this_process_stay_open():
    env = small_env()
    with rollouts(env, Expert(G1).actor(), steps=2) as source:
        next(source)
    assert env.rollout(2).shape == (2, 2)


PROGRAM = """
from torchrl.envs import ParallelEnv

from plat.collectors import rollouts
from plat.modules import Expert
from plat.robots import G1
from tests.collectors.test_rollouts import small_env

if __name__ == "__main__":
    with rollouts(ParallelEnv(2, small_env), Expert(G1).actor(), steps=3) as source:
        print(tuple(next(source).shape))
"""


@pytest.mark.slow
def test_a_program_with_environments_in_processes_ends(tmp_path):
    (tmp_path / "program.py").write_text(PROGRAM)
    root = Path(__file__).parents[2]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    command = [sys.executable, str(tmp_path / "program.py")]
    ended = subprocess.run(command, env=environment, cwd=root, capture_output=True, text=True, timeout=240, check=True)
    assert ended.stdout.splitlines()[-1] == "(2, 2, 3)"


def flailing() -> TensorDictModule:
    """Actions so wild that robots fall within a second."""
    return TensorDictModule(lambda x: 3 * torch.randn(len(x), 29), [("robot", "joint_pos")], ["action"])


def randomized_env(num_envs: int = 4):
    config = TrackingTaskConfig(randomization=RandomizationRanges(push_interval=(0.04, 0.1), control_delay=0.5))
    return make_tracking_env(motions(), num_envs, config)


def simulated(num_envs: int = 4):
    task = TimedKeyframes(motions(), TimedKeyframesConfig(chains=6))
    ranges = RandomizationRanges(push_interval=(0.04, 0.1), control_delay=0.5)
    return SimulatedTask(task, num_envs, randomization=ranges)


@pytest.mark.parametrize("make", [small_env, randomized_env, simulated])
def test_a_state_stays_what_it_was_while_robots_go_on(make):
    source = Rollouts(make(), flailing(), steps=40)
    next(source)
    state, generator = source.state_dict(), torch.get_rng_state()
    wanted = next(source).clone()
    for _ in range(2):
        next(source)
        source.load_state_dict(state)
        torch.set_rng_state(generator)
        found = next(source)
        assert found["next", "done"].any()
        for key, value in wanted.items(True, True):
            assert torch.equal(found[key], value), key


@pytest.mark.parametrize("make", [randomized_env, simulated])
def test_what_is_restored_goes_on_with_the_very_next_step(make, tmp_path):
    policy = flailing()
    first, second = Rollouts(make(), policy, steps=40), Rollouts(make(), policy, steps=40)
    assert next(first)["next", "done"].any()
    torch.save(first.state_dict(), tmp_path / "state")
    generator = torch.get_rng_state()
    wanted = next(first)
    next(second)
    second.load_state_dict(torch.load(tmp_path / "state", weights_only=True))
    torch.set_rng_state(generator)
    found = next(second)
    assert set(found.keys(True, True)) == set(wanted.keys(True, True))
    assert found["next", "done"].any()
    for key, value in wanted.items(True, True):
        assert torch.equal(found[key], value), key


def test_a_state_of_other_robots_is_refused():
    state = Rollouts(simulated(3), flailing(), steps=1).state_dict()
    with pytest.raises(StateError, match="a state of 3 simulations"):
        Rollouts(simulated(4), flailing(), steps=1).load_state_dict(state)


def test_a_state_of_another_version_is_refused_by_what_it_lacks():
    source = Rollouts(small_env(), flailing(), steps=1)
    without_drift, without_estimate = source.state_dict(), source.state_dict()
    without_drift["robots"]["_extra_state"].pop("drift")
    with pytest.raises(StateError, match="a state without drift, by another version of plat"):
        source.load_state_dict(without_drift)
    without_estimate["observation"].pop("estimate")
    with pytest.raises(StateError, match=r"without estimate\.root_pos_w, estimate\.root_quat_w, by another version"):
        source.load_state_dict(without_estimate)


def test_the_loss_sees_the_probabilities_of_the_policy_that_acted():
    expert = Expert(G1)
    rollout = next(rollouts(small_env(), expert.actor(), steps=4, precision="bfloat16"))
    with torch.no_grad(), autocast("cpu", "bfloat16"):
        again = expert.head().get_dist(rollout.select("observation", ("goal", "joint_pos")))
    torch.testing.assert_close(again.log_prob(rollout["action"]), rollout["action_log_prob"], atol=1e-3, rtol=0)
    with torch.no_grad():
        exact = expert.head().get_dist(rollout.select("observation", ("goal", "joint_pos")))
    assert (exact.base_dist.loc - rollout["loc"]).abs().max() > 1e-5  # so half precision was in use


def test_the_caller_keeps_its_threads():
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        next(rollouts(small_env(), Expert(G1).actor(), steps=1))
        assert torch.get_num_threads() == 2
        with simulation_threads(64):
            assert torch.get_num_threads() == 1
        with simulation_threads(64 * 1024):
            assert torch.get_num_threads() == 2
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)
