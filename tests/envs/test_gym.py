import subprocess
import sys

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode


@pytest.fixture(scope="module")
def env():
    env = gymnasium.make("plat/G1TimedKeyframe-v0")
    yield env
    env.close()


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_gymnasiums_own_checks(env):
    check_env(env.unwrapped, skip_render_check=True)


def test_importing_plat_registers_it_and_does_not_import_torch():
    program = (
        "import gymnasium, plat, sys\n"
        "assert 'torch' not in sys.modules\n"
        "print(gymnasium.spec('plat/G1TimedKeyframe-v0').id)\n"
    )
    out = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "plat/G1TimedKeyframe-v0"


def test_seeds_fix_the_episode(env):
    runs = []
    for _ in range(2):
        observation, _ = env.reset(seed=7)
        steps = [observation]
        for index in range(5):
            steps.append(env.step(np.full(29, 0.1 * index, np.float32))[0])
        runs.append(np.stack(steps))
    np.testing.assert_array_equal(runs[0], runs[1])
    assert not np.array_equal(env.reset(seed=8)[0], runs[0][0])


def test_users_random_numbers_are_left_alone(env):
    torch.manual_seed(5)
    expected = torch.rand(3)
    torch.manual_seed(5)
    env.reset(seed=1)
    env.step(np.zeros(29, np.float32))
    assert torch.equal(torch.rand(3), expected)


def test_vector_form():
    env = gymnasium.make_vec("plat/G1TimedKeyframe-v0", num_envs=3)
    assert env.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    observation, _ = env.reset(seed=0)
    assert observation.shape == (3, 177)
    ended = False
    for _ in range(200):
        observation, reward, terminated, truncated, info = env.step(5 * np.random.default_rng(0).normal(size=(3, 29)))
        assert observation.shape == (3, 177)
        assert reward.shape == terminated.shape == truncated.shape == (3,)
        if (terminated | truncated).any():
            index = (terminated | truncated).nonzero()[0][0]
            assert info["final_obs"][index].shape == (177,)
            assert not np.array_equal(info["final_obs"][index], observation[index])
            ended = True
            break
    assert ended
    env.close()
