import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import plat  # noqa: F401  (registers the environment)

pytest.importorskip("stable_baselines3", reason="needs stable-baselines3")
sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from sb3_vec_env import BatchVecEnv


def test_it_steps_and_tells_ends_apart():
    env = BatchVecEnv(gymnasium.make_vec("plat/G1TimedKeyframe-v0", num_envs=8, motions="generated:val@8"))
    assert env.reset().shape == (8, 177)
    seen = set()
    for _ in range(250):
        observation, reward, done, infos = env.step(np.zeros((8, 29), np.float32))
        assert (observation.shape, reward.shape, reward.dtype) == ((8, 177), (8,), np.float32)
        for index, info in enumerate(infos):
            assert ("terminal_observation" in info) == done[index]
            if done[index]:
                # the episode's last observation, not the first one of the next
                assert not np.array_equal(info["terminal_observation"], observation[index])
                seen.add(info["TimeLimit.truncated"])
    env.close()
    assert seen == {True, False}
