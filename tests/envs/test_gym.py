import inspect
import os
import re
import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from tensordict import TensorDict
from torchrl.envs import GymWrapper

import plat.envs.gym
from plat.envs import KeyframeTaskConfig
from plat.envs.transforms import RandomizationRanges
from plat.errors import ActionError, PlatError, RenderingError, TaskError
from plat.robots import G1
from plat.spec.observation import observation_size, student_keys


@pytest.fixture(scope="module")
def env():
    env = gymnasium.make("plat/G1TimedKeyframe-v0", motions="generated:train@30")
    env.reset(seed=0)  # for whichever test comes first
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


def test_gymnasium_finds_it_without_an_import_of_plat():
    made = "gymnasium.make('plat:plat/G1TimedKeyframe-v0', max_episode_steps=5, motions='generated:val@8')"
    program = f"import gymnasium; print({made}.spec.id)"
    out = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "plat/G1TimedKeyframe-v0"


def test_info_says_how_the_command_went(env):
    env.reset(seed=3)
    arrivals, info = [], {}
    terminated = truncated = False
    while not (terminated or truncated):
        before = info.get("steps_left")
        _, _, terminated, truncated, info = env.step(np.zeros(29, np.float32))
        assert info["is_success"] is not terminated
        assert info["arrived"] is (before == 1) or before is None
        assert info["met"] is (info["arrived"] and not terminated)
        assert not info["reached"] or info["met"]
        assert 0 < info["joint_error"] < 3
        assert 0 < info["keypoint_error"] < 3
        arrivals.append(info["arrived"])
    assert terminated  # the default pose is no answer for long
    assert len(arrivals) > 1


def test_an_unknown_horizon_is_named():
    with pytest.raises(TaskError, match="horizon is 'far', expected one of: single, short"):
        gymnasium.make("plat/G1TimedKeyframe-v0", horizon="far")


RENDER = """
import mujoco  # chooses its renderer now
import gymnasium, plat
from plat.errors import RenderingError

env = gymnasium.make("plat/G1TimedKeyframe-v0", motions="generated:train@8", render_mode="rgb_array").unwrapped
env.reset(seed=0)
for _ in range(2):
    try:
        env.render()
    except RenderingError as error:
        print(error)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="displays are the system's own elsewhere")
def test_rendering_twice_without_a_display_is_an_error_and_no_crash():
    hidden = ("DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL", "PYOPENGL_PLATFORM")
    environment = {name: value for name, value in os.environ.items() if name not in hidden}
    out = subprocess.run([sys.executable, "-c", RENDER], capture_output=True, text=True, env=environment, check=True)
    assert out.stdout.count("no display, and MuJoCo was imported with a renderer that needs one") == 2


def test_pictures_show_robot_and_ghost():
    env = gymnasium.make("plat/G1TimedKeyframe-v0", motions="generated:train@8", render_mode="rgb_array").unwrapped
    env.reset(seed=0)
    try:
        picture = env.render()
    except RenderingError as error:
        pytest.skip(str(error))
    assert picture.shape == (480, 640, 3)
    assert picture.std() > 5
    env.close()


def test_seeds_fix_the_episode(env):
    runs = []
    env.reset()
    for _ in range(2):
        for _ in range(60):  # failures, which starts are drawn by later
            if any(env.step(np.full(29, 3.0, np.float32))[2:4]):
                env.reset()
        observation, _ = env.reset(seed=7)
        steps = [observation]
        for index in range(5):
            steps.append(env.step(np.full(29, 0.1 * index, np.float32))[0])
        runs.append(np.stack(steps))
    np.testing.assert_array_equal(runs[0], runs[1])
    assert not np.array_equal(env.reset(seed=8)[0], runs[0][0])


def test_a_seed_may_be_of_any_size(env):
    observations = [env.reset(seed=seed)[0] for seed in (2**70 + 3, 2**70 + 3, 4)]
    np.testing.assert_array_equal(observations[0], observations[1])
    assert not np.array_equal(observations[0], observations[2])


@pytest.mark.parametrize(
    ("action", "message"),
    [
        (np.zeros(28), r"action: shape \(28,\) and type float64, expected numbers of shape \(29,\) for each robot$"),
        (None, r"action: shape \(\) and type object, expected numbers"),
        ([0.0] * 28 + [np.nan], "action: NaN for joint 'right_wrist_yaw'$"),
    ],
)
def test_what_is_no_action_is_named(env, action, message):
    env.reset()
    with pytest.raises(ActionError, match=message):
        env.unwrapped.step(action)


def test_users_random_numbers_are_left_alone(env):
    torch.manual_seed(5)
    expected = torch.rand(3)
    torch.manual_seed(5)
    env.reset(seed=1)
    env.step(np.zeros(29, np.float32))
    assert torch.equal(torch.rand(3), expected)


def test_environments_without_a_seed_are_not_alike():
    observations = []
    for _ in range(2):
        torch.manual_seed(5)  # as in processes that were forked to run in parallel
        expected = torch.random.get_rng_state()
        task = KeyframeTaskConfig(randomization=RandomizationRanges())
        env = gymnasium.make("plat/G1TimedKeyframe-v0", motions="generated:train@8", task=task)
        observations.append(env.reset()[0])
        assert torch.equal(torch.random.get_rng_state(), expected)
    assert not np.array_equal(*observations)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
@pytest.mark.parametrize("device", ["cpu", "cuda"])
def test_users_random_numbers_on_a_gpu_are_left_alone(device):
    env = gymnasium.make("plat/G1TimedKeyframe-v0", motions="generated:train@8", device=device)
    torch.manual_seed(5)
    expected = torch.rand(3, device="cuda")
    torch.manual_seed(5)
    first, _ = env.reset(seed=1)
    assert torch.equal(torch.rand(3, device="cuda"), expected)
    np.testing.assert_array_equal(env.reset(seed=1)[0], first)


def test_torchrl_wraps_the_vector_form():
    env = GymWrapper(gymnasium.make_vec("plat/G1TimedKeyframe-v0", num_envs=2, motions="generated:val@8"))
    rollout = env.rollout(60, lambda td: td.set("action", torch.full((2, 29), 5.0)), break_when_any_done=False)
    done, after = rollout["next", "done"][:, :-1, 0], rollout["next", "observation"][:, :-1]
    same = (after == rollout["observation"][:, 1:]).all(-1)
    assert done.any()
    assert torch.equal(same, ~done)  # where an episode ended, what it ended with is recorded
    env.close()


def test_vector_form():
    env = gymnasium.make_vec("plat/G1TimedKeyframe-v0", num_envs=3, motions="generated:train@8")
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
            np.testing.assert_array_equal(info["is_success"], ~terminated)
            assert info["joint_error"].shape == info["steps_left"].shape == info["_joint_error"].shape == (3,)
            ended = True
            break
    assert ended
    env.close()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"device": "nope"}, "device 'nope': not on this machine"),
        ({"task": KeyframeTaskConfig(partial=0.5)}, "task.partial: .* expected also="),
        ({"task": 0.5}, "config is 0.5, expected a KeyframeTaskConfig or a DistillationTaskConfig"),
        ({"timing": 0.02}, "timing is 0.02, expected a Timing"),
        ({"horizon": ["short"]}, r"horizon is \['short'\], expected one of: single"),
        ({"also": 5}, r"also is 5, expected some of \('parts', 'clock'\)"),
        ({"also": (5,)}, "observation group 5: expected some of"),
        ({"task": KeyframeTaskConfig(partial=0.5), "also": None}, "also is None, expected some of"),
        ({"also": "parts clock"}, "observation group 'parts clock': expected some of"),
    ],
)
def test_an_argument_that_does_not_fit_is_named(arguments, message):
    with pytest.raises(PlatError, match=message):
        gymnasium.make("plat/G1TimedKeyframe-v0", motions="generated:val@8", **arguments)


def test_one_group_is_named_without_a_tuple():
    env = gymnasium.make("plat/G1TimedKeyframe-v0", motions="generated:val@8", also="clock")
    assert env.observation_space.shape == (observation_size(student_keys(("clock",)), G1),)


def test_an_episode_that_is_over_does_not_go_on():
    env = gymnasium.make("plat/G1TimedKeyframe-v0", motions="generated:val@8")
    for _ in range(2):
        env.reset(seed=0)
        while True:
            _, _, terminated, truncated, _ = env.step(np.full(29, 5.0, np.float32))
            if terminated or truncated:
                break
        with pytest.raises(ActionError, match=r"the episode is over, expected reset\(\)"):
            env.step(np.zeros(29, np.float32))


def test_partial_keyframes_are_seen():
    task = KeyframeTaskConfig(partial=0.5)
    env = gymnasium.make("plat/G1TimedKeyframe-v0", motions="generated:val@8", task=task, also=("parts", "clock"))
    observation, _ = env.reset(seed=3)
    assert observation.shape == (225,)
    masks = []
    for _ in range(80):
        observation, reward, terminated, truncated, _ = env.step(np.zeros(29, np.float32))
        masks.append(observation[177:223])
        assert np.isfinite(reward)
        if terminated or truncated:
            observation, _ = env.reset()
    assert set(np.unique(masks)) == {0.0, 1.0}


@pytest.mark.parametrize(("off", "reached"), [(0.1, True), (0.3, False)])
def test_reached_is_near_and_not_only_within_the_thresholds(env, monkeypatch, off, reached):
    """0.3 m off is within the thresholds of TKS@3."""
    env.reset(seed=3)
    real = plat.envs.gym.distances

    def moved(state, reference, parts):
        there = TensorDict({key: reference[key].clone() for key in KEYPOINT_STATE}, [1])
        there["keypoint_pos_w"] += torch.tensor([off, 0.0, 0.0])
        return real(there, reference, parts)

    monkeypatch.setattr("plat.envs.gym.distances", moved)
    info, over = {"met": False}, False
    while not info["met"]:
        if over:
            env.reset()
        _, _, terminated, truncated, info = env.step(np.zeros(29, np.float32))
        over = terminated or truncated
    assert info["reached"] is reached


KEYPOINT_STATE = ("keypoint_pos_w", "keypoint_quat_w", "joint_pos")


def test_an_unknown_argument_of_make_vec_is_named():
    with pytest.raises(TaskError, match="make_vec: unknown argument 'motion', expected some of num_envs, motions"):
        gymnasium.make_vec("plat/G1TimedKeyframe-v0", num_envs=2, motion="nonsense", horizn="short")


def test_the_arguments_that_make_vec_names_are_those_it_takes():
    taken = list(inspect.signature(plat.envs.gym.G1TimedKeyframeVectorEnv.__init__).parameters)
    assert taken[1:-1] == list(plat.envs.gym._VECTOR_ARGUMENTS)


def test_the_page_names_every_argument():
    page = (Path(__file__).parents[2] / "docs" / "gymnasium.md").read_text()
    table = page.partition("## Arguments")[2].partition("\n## ")[0]
    arguments = list(inspect.signature(plat.envs.gym.G1TimedKeyframeEnv.__init__).parameters)[1:]
    assert sorted(re.findall(r"(?m)^\| `(\w+)` \|", table)) == sorted(arguments)


@pytest.mark.parametrize(
    ("task", "fails"), [(KeyframeTaskConfig(), True), (KeyframeTaskConfig(max_displacement=None), False)]
)
def test_a_robot_beside_the_motion_fails_in_training_alone(task, fails):
    """TKS@3 does not measure where on the floor a robot is."""
    env = gymnasium.make("plat/G1TimedKeyframe-v0", motions="generated:train@30", task=task).unwrapped
    env.reset(seed=0)
    base = env._task.env.base_env
    qpos, qvel = base.physics.state()
    qpos[:, 0] += 0.6
    base.physics.set_state(torch.arange(1), qpos, qvel)
    _, _, terminated, _, info = env.step(np.zeros(29, np.float32))
    assert (terminated, info["is_success"]) == (fails, not fails)
    env.close()
