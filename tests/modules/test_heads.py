import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import ProbabilisticTensorDictSequential
from torchrl.envs.utils import ExplorationType, set_exploration_type

from plat.modules import GaussianNoise, ReferenceOffset, gaussian_action
from plat.robots import G1


def test_offset_commands_the_goals_angles():
    goal = G1.default_joint_pos + torch.randn(4, 29)
    action = ReferenceOffset(G1, ("residual", "goal"), "loc")(torch.zeros(4, 29), goal)
    torch.testing.assert_close(G1.default_joint_pos + G1.action_scale * action, goal)


def test_offset_adds_the_residual():
    residual = torch.randn(4, 29)
    offset = ReferenceOffset(G1, ("residual", "goal"), "loc")
    goal = torch.randn(4, 29)
    torch.testing.assert_close(offset(residual, goal) - offset(torch.zeros(4, 29), goal), residual)


def test_residual_is_bounded_and_the_goal_is_not():
    goal, wild = torch.full((29,), 3.0), torch.full((29,), 300.0)
    offset = ReferenceOffset(G1, ("residual", "goal"), "loc", limit=2.0)
    torch.testing.assert_close(offset(wild, goal) - offset(torch.zeros(29), goal), torch.full((29,), 2.0))
    torch.testing.assert_close(offset(-wild, goal) - offset(torch.zeros(29), goal), torch.full((29,), -2.0))


def test_noise_starts_where_it_is_told_and_keeps_its_floor():
    noise = GaussianNoise(3, init_std=0.4, min_std=0.05)
    loc, scale = noise(torch.zeros(2, 3))
    assert scale[0, 0].item() == pytest.approx(0.4)
    assert GaussianNoise(3, init_std=0.001, min_std=0.05)(loc)[1].min().item() == pytest.approx(0.05)


def test_action_comes_with_its_log_probability():
    actor = ProbabilisticTensorDictSequential(GaussianNoise(3, 0.5), gaussian_action())
    data = TensorDict({"loc": torch.randn(5, 3)}, [5])
    with set_exploration_type(ExplorationType.RANDOM):
        out = actor(data.clone())
    expected = torch.distributions.Normal(out["loc"], out["scale"]).log_prob(out["action"]).sum(-1)
    torch.testing.assert_close(out["action_log_prob"], expected)
    with set_exploration_type(ExplorationType.DETERMINISTIC):
        assert torch.equal(actor(data.clone())["action"], data["loc"])
