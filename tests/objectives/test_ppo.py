import copy
import math
from typing import Any

import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import (
    ProbabilisticTensorDictModule,
    ProbabilisticTensorDictSequential,
    TensorDictModule,
    TensorDictSequential,
)
from torch import nn
from torch.distributions import Independent, Normal, kl_divergence
from torchrl.envs.utils import ExplorationType
from torchrl.modules import TanhNormal, TruncatedNormal

from plat.envs import make_keyframe_env
from plat.errors import ActionError, ConfigError
from plat.modules import (
    STUDENT_KEYS,
    Critic,
    GaussianNoise,
    LatentNoisePolicy,
    LatentPolicy,
    RefinementConfig,
    ResidualActionPolicy,
    ResidualLatentPolicy,
    gaussian_action,
    mlp,
)
from plat.objectives import PPO, PPOConfig, autocast
from plat.robots import G1
from tests.modules.policies.test_student import SMALL


class Toy:
    """A state is a number, the best action is its negative, every step is worth what it earns."""

    def __init__(self, sample: ProbabilisticTensorDictModule | None = None, **settings: Any) -> None:
        mean = TensorDictModule(mlp(1, (16,), 1, out_scale=0.1), in_keys=["x"], out_keys=["loc"])
        self.actor = ProbabilisticTensorDictSequential(mean, GaussianNoise(1, 0.5), sample or gaussian_action())
        self.critic = TensorDictModule(mlp(1, (16,), 1), in_keys=["seen"], out_keys=["state_value"])
        self.observe = TensorDictModule(nn.Identity(), in_keys=["x"], out_keys=["seen"])
        self.ppo = PPO(
            self.actor,
            self.critic,
            TensorDictSequential(self.observe),
            PPOConfig(**{"lr": 3e-3, "entropy": 0.0, "precision": "float32", **settings}),
        )

    @torch.no_grad()
    def rollout(self, envs: int = 64, steps: int = 8) -> TensorDict:
        data = self.actor(TensorDict({"x": 2 * torch.rand(envs, steps, 1) - 1}, [envs, steps]))
        reward = -(data["action"] + data["x"]).square()
        done = torch.ones(envs, steps, 1, dtype=torch.bool)
        data["next"] = TensorDict(
            {"x": data["x"], "reward": reward, "done": done, "terminated": done, "truncated": ~done}, [envs, steps]
        )
        return data


def test_it_learns():
    toy = Toy(epochs=2, minibatches=2)
    first = toy.rollout()["next", "reward"].mean()
    for _ in range(40):
        toy.ppo.step(toy.rollout())
    x = torch.linspace(-1, 1, 9)[:, None]
    loc = toy.actor[0](TensorDict({"x": x}, [9]))["loc"]
    assert (loc + x).abs().max() < 0.25
    assert toy.rollout()["next", "reward"].mean() > 0.5 * first


@pytest.mark.parametrize("truncated", ["mean", "state"])
def test_values_against_the_definition(truncated):
    # two robots, three steps; the first is cut off after the second step, the second falls there
    toy = Toy(truncated=truncated)
    data = toy.rollout(2, 3)
    done = torch.zeros(2, 3, 1, dtype=torch.bool)
    done[:, 1] = True
    terminated = done.clone()
    terminated[0] = False
    after = torch.randn(2, 3, 1)
    data["next"].update({"x": after, "done": done, "terminated": terminated, "truncated": done & ~terminated})
    flat = toy.ppo.prepare(data).view(2, 3)
    now = toy.critic(TensorDict({"seen": data["x"]}, [2, 3]))["state_value"].detach()
    end = toy.critic(TensorDict({"seen": after}, [2, 3]))["state_value"].detach()
    reward, gamma, lmbda = data["next", "reward"], 0.99, 0.95
    delta_last = reward[:, 2] + gamma * end[:, 2] - now[:, 2]
    torch.testing.assert_close(flat["advantage"][:, 2], delta_last)
    bootstrap = torch.stack((end[0, 1] if truncated == "state" else now.mean()[None], torch.zeros(1)))
    delta_cut = reward[:, 1] + gamma * bootstrap - now[:, 1]
    torch.testing.assert_close(flat["advantage"][:, 1], delta_cut)
    delta_first = reward[:, 0] + gamma * now[:, 1] - now[:, 0]
    torch.testing.assert_close(flat["advantage"][:, 0], delta_first + gamma * lmbda * delta_cut)
    torch.testing.assert_close(flat["value_target"], flat["advantage"] + now)


@pytest.mark.parametrize("whose", ["actor", "critic"])
def test_networks_that_end_in_half_precision_learn(whose):
    torch.manual_seed(0)
    toy = Toy(precision="bfloat16", epochs=2, minibatches=2)
    module = toy.critic if whose == "critic" else toy.actor[0]
    module.module = nn.Sequential(nn.Linear(1, 16), nn.ELU(), nn.Linear(16, 1))
    ppo = PPO(toy.actor, toy.critic, toy.ppo.observe, toy.ppo.config)
    for _ in range(30):
        with autocast("cpu", "bfloat16"):
            rollout = toy.rollout()
        ppo.step(rollout)
    assert ppo.prepare(rollout)["state_value"].dtype == torch.float32
    assert rollout["next", "reward"].mean() > -0.1


def test_one_state_is_learned_from():
    losses = Toy(minibatches=1).ppo.step(Toy().rollout(1, 1))
    assert losses["explained_variance"] == 0.0
    assert all(map(math.isfinite, losses.values()))


def test_critic_can_learn_alone():
    toy = Toy()
    actor = {name: weight.clone() for name, weight in toy.actor.state_dict().items()}
    critic = {name: weight.clone() for name, weight in toy.critic.state_dict().items()}
    toy.ppo.step(toy.rollout(), learn_policy=False)
    assert all(torch.equal(weight, actor[name]) for name, weight in toy.actor.state_dict().items())
    assert not all(torch.equal(weight, critic[name]) for name, weight in toy.critic.state_dict().items())


def test_learning_rate_stays_within_its_bounds():
    toy = Toy()
    toy.ppo._schedule.target_kl = 1e-9
    for _ in range(10):
        metrics = toy.ppo.step(toy.rollout())
    assert metrics["lr"] == pytest.approx(PPOConfig().min_lr)


def test_kl_is_what_the_updates_before_the_last_changed():
    toys = Toy(epochs=1, minibatches=1), Toy(epochs=2, minibatches=1)
    toys[1].actor.load_state_dict(toys[0].actor.state_dict())
    toys[1].critic.load_state_dict(toys[0].critic.state_dict())
    rollout = toys[0].rollout()
    assert toys[0].ppo.step(rollout.clone())["kl"] == pytest.approx(0.0, abs=1e-6)
    moved = toys[0].actor.get_dist(rollout.clone())
    before = Independent(Normal(rollout["loc"], rollout["scale"]), 1)
    expected = kl_divergence(before, moved).mean().item()
    assert expected > 1e-4
    # nothing before the first update, and this before the second
    assert toys[1].ppo.step(rollout.clone())["kl"] == pytest.approx(expected / 2, rel=1e-3)


@pytest.mark.parametrize("variant", [ResidualLatentPolicy, LatentNoisePolicy, ResidualActionPolicy])
def test_frozen_parts_stay_bit_identical(library, variant):
    policy = variant(LatentPolicy(G1, SMALL))
    student = {name: value.clone() for name, value in policy.student.state_dict().items()}
    residual = {name: value.clone() for name, value in policy.residual.state_dict().items()}
    critic = Critic(G1, STUDENT_KEYS, hidden=(16,))
    ppo = PPO(policy.head(), critic.head(), critic.observe(), action_key=policy.sample_key)
    env = make_keyframe_env(library, 8)
    for _ in range(3):
        with torch.no_grad():
            rollout = env.rollout(6, policy.actor(), break_when_any_done=False)
        metrics = ppo.step(rollout)
        critic.normalizer.update(rollout)
    assert all(torch.equal(value, student[name]) for name, value in policy.student.state_dict().items())
    assert not all(torch.equal(value, residual[name]) for name, value in policy.residual.state_dict().items())
    assert set(metrics) >= {"policy_loss", "value_loss", "entropy", "kl", "clip_fraction", "explained_variance", "lr"}


def test_a_latent_residual_learns(library):
    # the reward is for the actions of another place in the latent: the residual must go there
    torch.manual_seed(0)
    policy = ResidualLatentPolicy(LatentPolicy(G1, SMALL), RefinementConfig(alpha=1.0, init_std=0.1))
    critic = Critic(G1, STUDENT_KEYS, hidden=(16,))
    ppo = PPO(
        policy.head(), critic.head(), critic.observe(), PPOConfig(lr=3e-3, min_lr=1e-3, critic_lr=3e-3, entropy=0.0)
    )
    env = make_keyframe_env(library, 64)

    @torch.no_grad()
    def wanted(states: TensorDict) -> torch.Tensor:
        return policy.student.decoder(states["hidden"], states["prior", "loc"] + 3.0)

    distances = []
    for _ in range(16):
        with torch.no_grad():
            rollout = env.rollout(8, policy.actor(), break_when_any_done=False)
        distances.append(float((rollout["loc"] - wanted(rollout)).square().sum(-1).mean()))
        rollout["next", "reward"] = -(rollout["action"] - wanted(rollout)).square().sum(-1, keepdim=True)
        for key in ("done", "terminated"):
            rollout["next", key] = torch.ones_like(rollout["next", key])
        ppo.step(rollout)
    assert distances[-1] < 0.6 * distances[0]


def test_the_critic_learns_however_slow_the_policy():
    losses = []
    for rate, steps in ((3e-2, 60), (1e-7, 20)):
        torch.manual_seed(4)  # a critic that begins far off: what is left at the end is noise of the rewards
        toy = Toy(lr=1e-7, min_lr=1e-7, max_lr=1e-7, critic_lr=rate, epochs=1, minibatches=1)
        losses.append([toy.ppo.step(toy.rollout())["value_loss"] for _ in range(steps)])
    assert losses[0][-1] < 0.5 * losses[0][0]
    assert losses[1][-1] > 0.8 * losses[1][0]


def test_an_outside_gradient_moves_the_mean_against_it():
    toys = Toy(), Toy()
    toys[1].actor.load_state_dict(toys[0].actor.state_dict())
    rollout = toys[0].rollout()
    before = rollout["loc"].mean()
    toys[0].ppo.step(rollout.clone(), gradient=torch.full_like(rollout["loc"], 5.0))
    toys[1].ppo.step(rollout.clone(), gradient=torch.full_like(rollout["loc"], -5.0))
    down, up = (toy.actor[0](rollout.clone())["loc"].mean() for toy in toys)
    assert down < before - 0.01
    assert up > before + 0.01


def test_an_outside_gradient_is_what_the_mean_gets():
    toy = Toy()
    data = toy.ppo.prepare(toy.rollout())
    losses = toy.ppo.loss(data)
    mean = toy.ppo.loss.take_distribution().mean
    torch.testing.assert_close(mean, toy.actor.get_dist(data).mean)
    (along,) = torch.autograd.grad(mean.sum(), toy.actor[0].module[-1].bias, retain_graph=True)
    torch.testing.assert_close(along, torch.tensor([float(len(data))]))
    assert losses["loss_objective"].requires_grad


def bounded(distribution):
    return ProbabilisticTensorDictModule(
        in_keys=["loc", "scale"],
        out_keys=["action"],
        distribution_class=distribution,
        distribution_kwargs={"low": -2.0, "high": 2.0},
        return_log_prob=True,
        default_interaction_type=ExplorationType.RANDOM,
    )


def test_actions_may_be_bounded():
    toy = Toy(bounded(TanhNormal), epochs=2, minibatches=1)
    rollout = toy.rollout()
    before = Normal(rollout["loc"], rollout["scale"])
    toys = toy, Toy(bounded(TanhNormal), epochs=1, minibatches=1)
    toys[1].actor.load_state_dict(toy.actor.state_dict())
    toys[1].critic.load_state_dict(toy.critic.state_dict())
    found = [each.ppo.step(rollout.clone())["kl"] for each in toys]
    moved = toys[1].actor.get_dist(rollout.clone())
    # a divergence does not change when both distributions are squashed in the same way
    expected = kl_divergence(before, Normal(moved.loc, moved.scale)).sum(-1).mean().item()
    assert expected > 1e-4
    assert found == pytest.approx([expected / 2, 0.0], rel=1e-3, abs=1e-6)
    for _ in range(40):
        toy.ppo.step(toy.rollout())
    x = torch.linspace(-1, 1, 9)[:, None]
    action = toy.actor.get_dist(TensorDict({"x": x}, [9])).deterministic_sample
    assert (action + x).abs().max() < 0.25


def test_the_policy_that_collects_is_not_the_head_that_learns():
    policy, critic = ResidualLatentPolicy(LatentPolicy(G1, SMALL)), Critic(G1, STUDENT_KEYS, (8,))
    with pytest.raises(ConfigError, match=r"PPO: actor is a TensorDictSequential, .*, as a policy's head\(\) is"):
        PPO(policy.actor(), critic.head(), critic.observe())


def test_a_distribution_that_is_no_gaussian_is_refused_before_an_update():
    toy = Toy(bounded(TruncatedNormal))
    before = [parameter.clone() for parameter in toy.actor.parameters()]
    with pytest.raises(ConfigError, match="PPO: the actor's distribution is a TruncatedNormal, expected a Normal or"):
        toy.ppo.step(toy.rollout())
    assert all(torch.equal(old, new) for old, new in zip(before, toy.actor.parameters(), strict=True))


def test_ppo_can_be_copied_after_a_step():
    toy = Toy()
    toy.ppo.step(toy.rollout())
    twin, rollout = copy.deepcopy(toy.ppo), toy.rollout()
    steps = []
    for ppo in (toy.ppo, twin):
        torch.manual_seed(0)
        steps.append(ppo.step(rollout.clone()))
    assert steps[0] == steps[1]


def test_the_spread_is_that_of_all_samples():
    toy = Toy()
    rollout = toy.rollout()
    rollout["scale"] = 0.5 + torch.rand_like(rollout["scale"])
    mean = rollout["scale"].mean().item()
    assert toy.ppo.step(rollout)["std"] == pytest.approx(mean)


@pytest.mark.parametrize("entry", ["x", "action", ("next", "reward"), "action_log_prob"])
@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_a_rollout_that_is_not_finite_teaches_nothing(entry, value):
    toy = Toy()
    rollout = toy.rollout()
    rollout[entry].view(-1)[5] = value
    before = [parameter.clone() for parameter in (*toy.actor.parameters(), *toy.critic.parameters())]
    with pytest.raises(ActionError, match=r"PPO: .* of the rollout holds NaN or infinity; nothing was learned"):
        toy.ppo.step(rollout)
    after = [*toy.actor.parameters(), *toy.critic.parameters()]
    assert all(torch.equal(old, new) for old, new in zip(before, after, strict=True))


def test_a_gradient_that_is_not_finite_is_not_followed():
    toy = Toy()
    rollout = toy.rollout()
    before = [parameter.clone() for parameter in (*toy.actor.parameters(), *toy.critic.parameters())]
    gradient = torch.zeros(64, 8, 1)
    gradient[3, 2] = float("inf")
    with pytest.raises(ActionError, match=r"PPO: norm of the gradient: (nan|inf), expected a finite number"):
        toy.ppo.step(rollout, gradient=gradient)
    after = [*toy.actor.parameters(), *toy.critic.parameters()]
    assert sum(not torch.equal(old, new) for old, new in zip(before, after, strict=True)) in (0, len(before))
    assert all(parameter.isfinite().all() for parameter in after)
