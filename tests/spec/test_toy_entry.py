"""An entry that is added to the goal: the table and the functions that compute it change, and everything follows."""

import numpy as np
import pytest
import torch

import plat.deploy.goals
import plat.envs.goals
from plat.collectors import PrivilegedGoals
from plat.deploy import ObservationBuilder
from plat.envs import make_keyframe_env, make_tracking_env
from plat.envs.gym import G1TimedKeyframeEnv
from plat.errors import ObservationError
from plat.export.network import JointTargetNetwork
from plat.modules import Expert, ExpertConfig, LatentPolicy
from plat.robots import G1
from plat.spec.observation import OBSERVATION, Entry, observing, student_keys
from tests.deploy.robots import SomePose, describe_g1, random_qpos, state_at
from tests.modules.policies.test_student import SMALL

WIDE = 177 + 1
TOY = Entry("root_height", "dm", "height of the target's root over the robot's", size=1, scale=10.0)


@pytest.fixture
def toy(monkeypatch):
    """Everything that a person changes who adds the entry."""
    monkeypatch.setitem(
        plat.envs.goals.GOAL_ENTRIES,
        "root_height",
        lambda view: view.target["keypoint_pos"][..., 0, 2:] - _last_but(view.root_pos_w[..., 2:], view.target.ndim),
    )
    monkeypatch.setitem(
        plat.deploy.goals.GOAL_ENTRIES,
        "root_height",
        lambda view: (view.root_to_world @ view.keypoint_pos_b[0])[2:],
    )
    with observing(OBSERVATION.with_entry("goal", TOY)):
        yield


def _last_but(height: torch.Tensor, dims: int) -> torch.Tensor:
    """Room for the frames of a sequence."""
    return height if height.ndim == dims + 1 else height[:, None]


def test_the_environment_has_it(toy, library):
    env = make_keyframe_env(library, num_envs=3)
    assert env.observation_spec["goal", "root_height"].shape == (3, 1)
    assert env.observation_spec["dense_goal", "root_height"].shape == (3, 1)
    state = env.reset()
    pose = library.poses(state["command", "target_frame"])
    expected = 10 * (pose["keypoint_pos"][:, 0, 2:] - state["state", "root_pos_w"][:, 2:])
    torch.testing.assert_close(state["goal", "root_height"], expected)


def test_the_networks_see_it(toy, library):
    student, expert = LatentPolicy(G1, SMALL), Expert(G1, ExpertConfig(hidden=(8,)))
    assert student.normalizer.mean.shape == (WIDE,)
    assert student.goal_normalizer.mean.shape == (81,)
    state = make_keyframe_env(library, num_envs=3).reset()
    assert student.deployed()(state)["action"].shape == (3, 29)
    assert expert.deployed()(make_tracking_env(library, num_envs=3).reset())["action"].shape == (3, 29)
    frames = PrivilegedGoals(library)(state)["privileged_goal", "frames"]
    assert frames.shape[-1] == 81


def test_gymnasium_has_it(toy, monkeypatch):
    env = G1TimedKeyframeEnv()
    assert env.observation_space.shape == env.reset(seed=0)[0].shape == (WIDE,)


def test_robots_make_it_as_the_environment_does(toy):
    build = ObservationBuilder(describe_g1(), max_steps=50)
    (term,) = (term for term in build.terms if term.name == "goal.root_height")
    assert (term.start, term.stop, build.size) == (176, 177, WIDE)
    now, target = random_qpos(2)
    values = build(state_at(now), SomePose(target), 10, np.zeros(29))
    np.testing.assert_allclose(values[term.start], 10 * (target[2] - now[2]), rtol=1e-5)


def test_exports_take_it(toy):
    network = JointTargetNetwork(LatentPolicy(G1, SMALL))
    assert network.num_features == WIDE
    assert network(torch.zeros(2, WIDE)).shape == (2, 29)


def test_an_entry_that_is_in_the_table_alone_is_named(library):
    with observing(OBSERVATION.with_entry("goal", TOY)):
        message = "nothing computes 'root_height' of observation group 'goal'"
        with pytest.raises(ObservationError, match=message):
            make_keyframe_env(library, num_envs=2).reset()
        now, target = random_qpos(2)
        with pytest.raises(ObservationError, match=message):
            ObservationBuilder(describe_g1(), max_steps=50)(state_at(now), SomePose(target), 10, np.zeros(29))
    assert ("goal", "root_height") not in student_keys()
