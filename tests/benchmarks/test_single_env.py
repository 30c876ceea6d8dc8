import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env

from plat.envs import COMMAND_KEYS, ROBOT_KEYS, KeyframeTaskConfig, goal_keys, make_keyframe_env
from plat.motions import MotionLibrary

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from single_env import SingleG1

KEYS = ROBOT_KEYS + goal_keys() + COMMAND_KEYS


@pytest.mark.parametrize("noise", [0.05, 1.0])
def test_it_is_plats_task(library: MotionLibrary, noise: float):
    # small actions stay on the motion, large ones fall: both kinds of ends are seen
    env, single = make_keyframe_env(library, 1, KeyframeTaskConfig()), SingleG1(library)
    ends = set()
    for _ in range(6):
        current = env.reset()
        physics = env.base_env.physics
        qpos, qvel = (physics.batch.bind(name)[0].copy() for name in ("qpos", "qvel"))
        single.place(int(current["motion", "frame"]), int(current["command", "target_frame"]), qpos, qvel)
        for _ in range(80):
            observation = torch.cat([current[key] for key in KEYS], -1)[0].numpy()
            single.target_frame = int(current["command", "target_frame"])  # a command is drawn on arrival
            np.testing.assert_allclose(single.observe(), observation, atol=2e-4)
            goal, action = current["goal", "joint_pos"], noise * torch.randn(1, 29)
            current["action"] = action + (goal - library.robot.default_joint_pos) / library.robot.action_scale
            after = env.step(current)["next"]
            _, reward, terminated, truncated, _ = single.step(current["action"][0].numpy())
            assert reward == pytest.approx(float(after["reward"]), abs=1e-4)
            assert (terminated, truncated) == (bool(after["terminated"]), bool(after["truncated"]))
            current = after
            if terminated or truncated:
                ends.add("terminated" if terminated else "truncated")
                break
    assert ends


def test_it_is_a_gymnasium_environment(library: MotionLibrary):
    env = SingleG1(library)
    check_env(env, skip_render_check=True)
    first, _ = env.reset(seed=3)
    again, _ = env.reset(seed=3)
    assert np.array_equal(first, again)
    assert env.frame < env.target_frame
