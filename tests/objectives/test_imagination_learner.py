import copy
import os
import signal
from contextlib import contextmanager
from dataclasses import replace

import pytest
import torch
from torchrl.envs.utils import ExplorationType, set_exploration_type

from plat.collectors import RolloutReplay, rollouts
from plat.errors import ActionError, ConfigError, StateError
from plat.modules import DynamicsConfig, DynamicsModel, Expert, ExpertConfig, PlainPolicy
from plat.objectives import ImaginationConfig, ImaginationLearner, exploring, imagination_learner
from plat.robots import G1
from plat.tasks import DenseTracking, SimulatedTask, TimedKeyframes, TimedKeyframesConfig

CONFIG = ImaginationConfig(
    model_updates=2, model_batch=32, window=3, policy_updates=2, policy_batch=16, steps=3, recent=8, warmup=1, settle=2
)


@pytest.fixture(params=[(), (16,)], ids=["without critic", "with critic"])
def setting(library, request):
    """A learner, and a function that simulates a rollout into its replay."""
    config = replace(CONFIG, critic=request.param)
    expert = Expert(G1, ExpertConfig(hidden=(16,)))
    task, model = DenseTracking(library), DynamicsModel(G1, DynamicsConfig(hidden=(16, 16)))
    learner = ImaginationLearner(expert, expert.deployed(), model, task, config)
    replay = RolloutReplay(8, 16, ["robot_state", "memory", "action"])
    source = rollouts(SimulatedTask(task, 8), exploring(expert.deployed(), 0.25), 4)

    def simulate():
        rollout = next(source)
        replay.extend(rollout)
        learner.observe(rollout)
        return rollout

    return learner, replay, simulate


def weights(module):
    return {name: value.clone() for name, value in module.named_parameters()}


def modules(learner):
    return [module for module in (learner.policy, learner.model, learner.critic) if module is not None]


def test_first_the_model_learns_then_the_policy(setting):
    learner, replay, simulate = setting
    simulate()
    simulate()
    policy, model = weights(learner.policy), weights(learner.model)
    losses = learner.step(replay)
    assert "model/loss" in losses
    assert "loss_policy" not in losses
    assert not weights(learner.model)["network.0.weight"].equal(model["network.0.weight"])
    assert weights(learner.policy)["network.0.weight"].equal(policy["network.0.weight"])
    model = weights(learner.model)
    assert "imagined_cost" in learner.step(replay)
    assert not weights(learner.policy)["network.0.weight"].equal(policy["network.0.weight"])


def test_the_average_trails_the_policy(setting):
    learner, replay, simulate = setting
    simulate()
    simulate()
    start = weights(learner.policy)["network.0.weight"]
    for _ in range(3):
        learner.step(replay)
    now, average = (weights(module)["network.0.weight"].detach() for module in (learner.policy, learner.average))
    assert float((average - start.detach()).norm()) > 0
    assert float((average - now).norm()) > 0
    assert learner.average.normalizer.mean.equal(learner.policy.normalizer.mean)


@pytest.mark.parametrize(("before", "moved"), [(0, 0.9), (41, 9 / 51), (10_000, 0.01)])
def test_the_average_is_over_a_part_of_the_updates_so_far(setting, before, moved):
    learner, _, _ = setting
    with torch.no_grad():
        for module, value in ((learner.policy, 1.0), (learner.average, 0.0)):
            for parameter in module.parameters():
                parameter.fill_(value)
    learner.updates = before
    learner._move_average()
    weight = weights(learner.average)["network.0.weight"]
    torch.testing.assert_close(weight, torch.full_like(weight, moved))
    assert learner.updates == before + 1


def test_a_state_of_before_knows_its_updates(setting):
    learner, _, _ = setting
    state = learner.state_dict()
    assert state["updates"] == 0
    del state["updates"]
    state["iterations"] = learner.config.warmup + 5
    learner.load_state_dict(state)
    assert learner.updates == 5 * learner.config.policy_updates


def test_normalizers_settle(setting):
    learner, replay, simulate = setting
    for _ in range(2):
        simulate()
        learner.step(replay)
    policy, model = learner.policy.normalizer.mean.clone(), learner.model.mean.clone()
    assert policy.any()
    assert model.any()
    simulate()
    assert learner.policy.normalizer.mean.equal(policy)
    assert learner.model.mean.equal(model)


def test_rates_fall_in_the_second_half(setting):
    learner, replay, simulate = setting
    simulate()
    for fraction, share in ((0.2, 1.0), (0.5, 1.0), (0.75, 0.55), (1.0, 0.1)):
        learner.step(replay, fraction)
        muon, adam = learner.policy_optimizers
        assert muon.param_groups[0]["lr"] == pytest.approx(2e-2 * share)
        assert adam.param_groups[0]["lr"] == pytest.approx(2e-3 * share)
        assert learner.model_updates.optimizers[0].param_groups[0]["lr"] == pytest.approx(1.5e-2 * share)


ALONE = pytest.mark.parametrize("setting", [()], ids=["without critic"], indirect=True)


@pytest.fixture
def overlapped(setting):
    """A learner whose model learns in another process, and a function that makes another one of its state."""
    learner, replay, simulate = setting
    simulate()
    simulate()
    made = []

    def another(of):
        expert, model = copy.deepcopy(of.average), copy.deepcopy(of.model)
        config = replace(of.config, precision="float32")
        task = of.policy_loss.task
        made.append(ImaginationLearner(expert, expert.deployed(), model, task, config, overlap=True))
        made[-1].load_state_dict(copy.deepcopy(of.state_dict()))
        return made[-1]

    yield another(learner), another, replay
    for each in made:
        each.close()


@ALONE
def test_a_model_that_learns_beside_is_that_of_the_iteration_before(overlapped):
    learner, _, replay = overlapped
    start = weights(learner.model)["network.0.weight"]
    assert "model/loss" not in learner.step(replay)
    assert weights(learner.model)["network.0.weight"].equal(start)
    losses = learner.step(replay)
    assert losses["model/loss"] > 0
    assert losses["imagined_cost"] > 0
    assert not weights(learner.model)["network.0.weight"].equal(start)


@ALONE
def test_rates_of_a_model_that_learns_beside_fall(overlapped):
    learner, _, replay = overlapped
    for fraction, share in ((0.2, 1.0), (0.75, 0.55), (1.0, 0.1)):
        learner.step(replay, fraction)
        rates = [optimizer.param_groups[0]["lr"] for optimizer in learner.model_updates.optimizers]
        assert rates == pytest.approx([1.5e-2 * share, learner.config.model_lr * share])


@ALONE
def test_a_learner_whose_model_learns_beside_goes_on_from_its_state(overlapped):
    learner, another, replay = overlapped
    for _ in range(3):
        learner.step(replay)  # updates of the model are under way
    other, results = another(learner), []
    for each in (learner, other):
        torch.manual_seed(5)
        logged = [each.step(replay) for _ in range(2)]
        each.state_dict()
        results.append((logged, *(weights(module) for module in modules(each))))
    assert results[0][0] == results[1][0]
    assert all("model/loss" in losses for losses in results[0][0])  # of updates that were begun before as well
    for ours, theirs in zip(results[0][1:], results[1][1:], strict=True):
        assert all(ours[name].equal(theirs[name]) for name in ours)


@ALONE
def test_what_is_restored_is_not_overtaken_by_updates_under_way(overlapped):
    learner, _, replay = overlapped
    learner.step(replay)
    state = copy.deepcopy(learner.state_dict())
    kept = weights(learner.model)
    learner.step(replay)  # begins others
    learner.load_state_dict(state)
    learner.state_dict()
    assert all(weights(learner.model)[name].equal(kept[name]) for name in kept)


def test_it_goes_on_from_its_state(setting):
    learner, replay, simulate = setting
    simulate()
    simulate()
    learner.step(replay)
    learner.step(replay)
    other = ImaginationLearner(
        expert := copy.deepcopy(learner.average),
        expert.deployed(),
        copy.deepcopy(learner.model),
        learner.policy_loss.task,
        learner.config,
    )
    other.load_state_dict(copy.deepcopy(learner.state_dict()))
    results = []
    for each in (learner, other):
        torch.manual_seed(5)
        results.append((each.step(replay), *(weights(module) for module in modules(each))))
    assert results[0][0] == results[1][0]
    for ours, theirs in zip(results[0][1:], results[1][1:], strict=True):
        assert all(ours[name].equal(theirs[name]) for name in ours)


@pytest.mark.parametrize(("before", "after"), [(0.0, 5.0), (5.0, 0.0)])
def test_optimizers_of_the_policy_begin_anew_where_they_were_others(setting, before, after):
    learner, replay, simulate = setting
    simulate()
    simulate()

    def learner_of(policy_muon):
        expert, model = copy.deepcopy(learner.policy), copy.deepcopy(learner.model)
        config = replace(learner.config, policy_muon=policy_muon)
        return ImaginationLearner(expert, expert.deployed(), model, learner.policy_loss.task, config)

    old, new = learner_of(before), learner_of(after)
    for _ in range(2):
        old.step(replay)
    new.load_state_dict(copy.deepcopy(old.state_dict()))
    assert [type(each) is torch.optim.Muon for each in new.policy_optimizers] == ([True, False] if after else [False])
    assert not any(optimizer.state for optimizer in new.policy_optimizers)
    ours, theirs = ([*each.model_updates.optimizers, *each.critic_optimizers] for each in (new, old))
    assert len(ours) == 2 + bool(learner.config.critic)
    for one, other in zip(ours, theirs, strict=True):
        torch.testing.assert_close(one.state_dict(), other.state_dict())
    assert new.step(replay)["policy_skipped"] == 0


def test_a_state_with_a_critic_is_of_a_learner_with_one(setting):
    learner, *_ = setting
    has, had = ("with", "without") if learner.critic else ("without", "with")
    state = learner.state_dict()
    state = (
        {key: value for key, value in state.items() if key != "critic"} if learner.critic else {**state, "critic": {}}
    )
    with pytest.raises(StateError, match=f"imagination: a state {had} a critic, expected one {has}"):
        learner.load_state_dict(state)


@ALONE
def test_threads_are_left_to_the_process_of_the_model_while_there_is_one(overlapped, monkeypatch):
    learner, _, replay = overlapped
    left = []

    @contextmanager
    def seen():
        left.append(True)
        yield

    monkeypatch.setattr(imagination_learner, "half_the_threads", seen)
    learner.step(replay)
    assert left == [True]
    os.kill(learner._beside._helper._process.pid, signal.SIGKILL)
    learner.step(replay)  # in which that is noticed
    learner.step(replay)
    assert left == [True]


def test_a_critic_learns_what_is_to_come(library):
    torch.manual_seed(0)
    expert, task = Expert(G1, ExpertConfig(hidden=(16,))), DenseTracking(library)
    model = DynamicsModel(G1, DynamicsConfig(hidden=(16, 16)))
    # of a short horizon: its own estimates, which it begins with, hardly count
    still = {"model_lr": 1e-9, "muon_lr": 1e-9, "warmup": 0, "discount": 0.3}
    learner = ImaginationLearner(
        expert, expert.deployed(), model, task, replace(CONFIG, critic=(32,), lr=3e-3, **still)
    )
    replay = RolloutReplay(8, 16, ["robot_state", "memory", "action"])
    source = rollouts(SimulatedTask(task, 8), exploring(expert.deployed(), 0.25), 4)
    for _ in range(4):
        replay.extend(rollout := next(source))
        learner.observe(rollout)
    losses = [learner.step(replay)["loss_critic"] for _ in range(30)]
    assert sum(losses[-10:]) < 0.5 * sum(losses[:5])
    assert set(learner.critic.normalizer.in_keys) == set(expert.deployed().in_keys)


def test_an_actor_on_other_weights_is_refused(library):
    task, model = DenseTracking(library), DynamicsModel(G1, DynamicsConfig(hidden=(16,)))
    expert, other = (Expert(G1, ExpertConfig(hidden=(16,))) for _ in range(2))
    frozen = Expert(G1, ExpertConfig(hidden=(16,))).requires_grad_(False)
    ImaginationLearner(expert, exploring(expert.deployed(), 0.1), model, task, CONFIG)
    for policy, actor in ((expert, other), (expert, copy.deepcopy(expert)), (frozen, frozen)):
        with pytest.raises(ConfigError, match=r"actor has none of the weights .* such as its deployed\(\)"):
            ImaginationLearner(policy, actor.deployed(), model, task, CONFIG)


def test_weights_without_a_shape_are_refused(library):
    task, model = DenseTracking(library), DynamicsModel(G1, DynamicsConfig(hidden=(16,)))
    expert = Expert(G1, ExpertConfig(hidden=(16,)))
    expert.network[0] = torch.nn.LazyLinear(16)
    with pytest.raises(ConfigError, match=r"policy's 'network.0.weight' has no shape yet, expected .* called before"):
        ImaginationLearner(expert, expert.deployed(), model, task, CONFIG)


def test_noise_is_for_exploration(library):
    expert, task = Expert(G1, ExpertConfig(hidden=(16,))), DenseTracking(library)
    observed = task.observe(*task.start(500))
    mean = expert.deployed()(observed.copy())["action"]
    noisy = exploring(expert.deployed(), 0.25)(observed.copy())["action"]
    assert (noisy - mean).std().item() == pytest.approx(0.25, rel=0.05)
    with set_exploration_type(ExplorationType.DETERMINISTIC):
        assert exploring(expert.deployed(), 0.25)(observed.copy())["action"].equal(mean)


def test_a_model_that_has_settled_elsewhere_keeps_its_statistics(library):
    expert, task, model = Expert(G1, ExpertConfig(hidden=(16,))), DenseTracking(library), DynamicsModel(G1)
    model.batches.fill_(CONFIG.settle)
    learner = ImaginationLearner(expert, expert.deployed(), model, task, CONFIG)
    rollout = next(rollouts(SimulatedTask(task, 8), exploring(expert.deployed(), 0.25), 4))
    learner.observe(rollout)
    assert not model.mean.any()
    assert expert.normalizer.mean.any()


def test_updates_whose_gradient_is_not_finite_are_counted_and_end_training(setting):
    learner, replay, simulate = setting
    simulate()
    simulate()
    learner.step(replay)
    assert learner.step(replay)["policy_skipped"] == 0
    before = weights(learner.policy)
    for parameter in learner.model.parameters():
        parameter.data.fill_(torch.nan)
    losses = learner.step(replay)
    assert losses["policy_skipped"] == losses["model/skipped"] == 1
    assert all(weights(learner.policy)[name].equal(value) for name, value in before.items())
    for _ in range(23):
        learner.step(replay)
    with pytest.raises(ActionError, match="model: the gradients of 50 updates in a row were not finite"):
        learner.step(replay)


def test_what_exploits_the_model_is_part_of_the_state(setting):
    learner, *_ = setting
    learner.watch.add(1.0, 2.0)
    state = copy.deepcopy(learner.state_dict())
    learner.watch.add(3.0, 4.0)
    learner.load_state_dict(state)
    assert learner.watch.state_dict() == {"costs": [[1.0, 2.0]]}
    del state["watch"]  # of an older plat
    learner.load_state_dict(state)
    assert learner.watch.state_dict() == {"costs": []}


def test_a_new_policy_learns_the_reference_while_the_model_is_new(library):
    torch.manual_seed(0)
    task, policy = TimedKeyframes(library, TimedKeyframesConfig(chains=6)), PlainPolicy(G1)
    model = DynamicsModel(G1, DynamicsConfig(hidden=(16, 16)))
    learner = ImaginationLearner(policy, policy.deployed(), model, task, CONFIG, reference_updates=3)
    replay = RolloutReplay(8, 16, ["robot_state", "memory", "action"])
    rollout = next(rollouts(SimulatedTask(task, 8), exploring(policy.deployed(), 0.25), 8))
    replay.extend(rollout)
    learner.observe(rollout)
    before, critic = weights(policy), learner.critic
    losses = learner.step(replay)
    assert "loss_reference" in losses
    assert "loss_policy" not in losses
    assert learner.updates == 3
    assert any(not value.equal(before[name]) for name, value in weights(policy).items())
    losses = learner.step(replay)
    assert "loss_policy" in losses
    assert "loss_reference" not in losses
    assert critic is None
