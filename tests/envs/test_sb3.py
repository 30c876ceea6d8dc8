import gymnasium
import numpy as np
import pytest

import plat  # noqa: F401  (registers the environment)

pytest.importorskip("stable_baselines3", reason="needs stable-baselines3")
from plat.envs.sb3 import BatchVecEnv
from plat.errors import PlatError


def test_it_steps_and_tells_ends_apart():
    env = BatchVecEnv(gymnasium.make_vec("plat/G1TimedKeyframe-v0", num_envs=8, motions="generated:val@8"))
    assert env.reset().shape == (8, 177)
    seen = set()
    for _ in range(250):
        observation, reward, done, infos = env.step(np.zeros((8, 29), np.float32))
        assert (observation.shape, reward.shape, reward.dtype) == ((8, 177), (8,), np.float32)
        for index, info in enumerate(infos):
            assert ("terminal_observation" in info) == done[index]
            assert isinstance(info["joint_error"], float)
            if done[index]:
                # the episode's last observation, not the first one of the next
                assert not np.array_equal(info["terminal_observation"], observation[index])
                assert info["is_success"] is info["TimeLimit.truncated"]
                seen.add(info["TimeLimit.truncated"])
    env.close()
    assert seen == {True, False}


def test_a_seed_fixes_the_first_observations():
    env = BatchVecEnv(gymnasium.make_vec("plat/G1TimedKeyframe-v0", num_envs=2, motions="generated:val@8"))
    first = [None, None]
    for index in range(2):
        env.seed(3)
        first[index] = env.reset()
    np.testing.assert_array_equal(*first)
    assert not np.array_equal(env.reset(), first[0])


def test_it_must_reset_within_the_step():
    with pytest.raises(PlatError, match=r"autoreset_mode is AutoresetMode\.NEXT_STEP, expected AutoresetMode\.SAME"):
        BatchVecEnv(gymnasium.make_vec("CartPole-v1", num_envs=2, vectorization_mode="sync"))


def test_attributes_are_those_of_the_robots_that_are_asked_for():
    env = BatchVecEnv(gymnasium.make_vec("plat/G1TimedKeyframe-v0", num_envs=3, motions="generated:val@8"))
    assert env.get_attr("num_envs") == [3, 3, 3]
    assert env.get_attr("num_envs", indices=1) == [3]
    assert env.env_is_wrapped(gymnasium.Wrapper, indices=[0, 2]) == [False, False]
    env.close()
