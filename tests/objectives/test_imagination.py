import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule, TensorDictSequential
from torch import nn

from plat.envs import GeneralizedState
from plat.errors import ConfigError, ObservationError, TaskError
from plat.modules import (
    DynamicsConfig,
    DynamicsModel,
    Expert,
    ExpertConfig,
    LatentPolicy,
    ObservationNormalizer,
    PlainPolicy,
    PlainPolicyConfig,
)
from plat.objectives import ImaginationLoss, LatentImaginationLoss, ReferenceLoss
from plat.robots import G1
from plat.spec.timing import Timing
from plat.tasks import DenseTracking, TimedKeyframes, TimedKeyframesConfig, TrackingCosts

SMALL = DynamicsConfig(hidden=(16,))


def starts(task, count=8):
    state, memory = task.start(count)
    return TensorDict({"robot_state": state.pack(), "memory": memory}, [count])


def learners(module):
    return {
        name for name, parameter in module.named_parameters() if parameter.grad is not None and parameter.grad.any()
    }


@pytest.fixture(scope="module")
def tracking(library):
    return DenseTracking(library)


def test_the_gradient_reaches_exactly_the_policy(tracking):
    expert, model = Expert(G1, ExpertConfig(hidden=(16,))), DynamicsModel(G1, SMALL)
    ImaginationLoss(expert.deployed(), model, tracking, steps=3)(starts(tracking))["loss_policy"].backward()
    assert learners(expert) == {f"network.{layer}.{kind}" for layer in (0, 2) for kind in ("weight", "bias")}
    assert not learners(model)
    assert all(parameter.requires_grad for parameter in model.parameters())


@pytest.mark.parametrize("layer", [0, 2])
def test_partly_frozen_networks_are_held_out_and_stay_frozen(tracking, layer):
    expert, model = Expert(G1, ExpertConfig(hidden=(16,))), DynamicsModel(G1, SMALL)
    head = nn.Sequential(nn.Linear(3, 8), nn.Tanh(), nn.Linear(8, 1))
    critic = TensorDictModule(head, [("robot", "gravity_b")], ["cost_to_go"])
    for network in (model.network, head):
        network[layer].requires_grad_(False)
    learning = {name for name, parameter in critic.named_parameters() if parameter.requires_grad}
    loss = ImaginationLoss(expert.deployed(), model, tracking, steps=2, critic=critic)

    def check_frozen():
        for network in (model.network, head):
            flags = {index: network[index].weight.requires_grad for index in (0, 2)}
            assert flags == {layer: False, 2 - layer: True}

    losses = loss(starts(tracking))
    losses["loss_policy"].backward()
    assert learners(expert)
    assert not any(learners(network) for network in (model, critic))
    check_frozen()
    losses["loss_critic"].backward()
    assert learners(critic) == learning

    def fail(*_):
        raise ArithmeticError

    for network in (model, head):  # an error in the context leaves it as well
        handle = network.register_forward_hook(fail)
        with pytest.raises(ArithmeticError):
            loss(starts(tracking))
        handle.remove()
        check_frozen()


def test_policy_model_and_task_are_of_one_timing(library):
    task = TimedKeyframes(library, TimedKeyframesConfig(chains=6))
    faster, farther = Timing(control_dt=0.01), Timing(max_steps=150)
    for policy, dt, message in (
        (PlainPolicy(G1), 0.01, "model at 0.01 s a control step, expected the task's 0.02 s"),
        (PlainPolicy(G1, PlainPolicyConfig(timing=faster)), 0.02, "policy at 0.01 s a control step, expected"),
        (
            PlainPolicy(G1, PlainPolicyConfig(timing=farther)),
            0.02,
            "max_steps=150.* of the policy, expected",
        ),
    ):
        with pytest.raises(ConfigError, match=f"imagination loss: .*{message}"):
            ImaginationLoss(policy.deployed(), DynamicsModel(G1, SMALL, dt=dt), task)


def test_students_learn_through_it(library):
    task = TimedKeyframes(library, TimedKeyframesConfig(chains=6))
    for student in (PlainPolicy(G1), LatentPolicy(G1)):
        ImaginationLoss(student.deployed(), DynamicsModel(G1, SMALL), task, steps=3)(starts(task))[
            "loss_policy"
        ].backward()
        assert any(name.startswith("backbone") for name in learners(student))
        assert any(name.startswith("decoder") for name in learners(student))


def test_later_steps_tell_the_first_action(tracking):
    """The gradient comes back through the model: one step's cost says something on an action three steps before."""
    model = DynamicsModel(G1, SMALL)

    class Once(nn.Module):
        def __init__(self):
            super().__init__()
            self.first = nn.Parameter(torch.zeros(29))
            self.calls = 0

        def forward(self, gravity):
            self.calls += 1
            return self.first.expand(len(gravity), -1) if self.calls == 1 else torch.zeros(len(gravity), 29)

    data = starts(tracking)
    gradients = []
    for steps in (1, 4):
        policy = TensorDictModule(Once(), in_keys=[("robot", "gravity_b")], out_keys=["action"])
        loss = ImaginationLoss(policy, model, tracking, steps=steps, discount=1.0, effort_weight=0, rate_weight=0)
        (steps * loss(data)["loss_policy"]).backward()
        gradients.append(policy.module.first.grad)
    assert not torch.allclose(gradients[0], gradients[1])


def test_one_step_costs_what_the_task_says(tracking):
    data, model = starts(tracking), DynamicsModel(G1, SMALL)
    zero = TensorDictModule(lambda gravity: gravity.new_zeros(len(gravity), 29), [("robot", "gravity_b")], ["action"])
    loss = ImaginationLoss(zero, model, tracking, steps=1)(data)
    state = model(GeneralizedState.unpack(data["robot_state"]), G1.default_joint_pos.expand(8, -1))
    memory = tracking.advance(data["memory"], torch.zeros(8, 29))
    cost, counted = tracking.cost(state, memory), ~tracking.lost(state, memory)
    torch.testing.assert_close(loss["loss_policy"], (cost * counted).mean())
    torch.testing.assert_close(loss["imagined_cost"], cost[counted].mean())


def test_the_lost_do_not_count(tracking):
    data = starts(tracking)
    data["robot_state"][:, 2] += 3.0
    expert = Expert(G1, ExpertConfig(hidden=(16,)))
    loss = ImaginationLoss(
        expert.deployed(), DynamicsModel(G1, SMALL), tracking, steps=2, effort_weight=0, rate_weight=0
    )
    losses = loss(data)
    assert float(losses["loss_policy"].detach()) == 0
    assert float(losses["imagined_alive"]) == 0


def test_a_residual_is_kept_small_not_the_reference(tracking):
    expert = Expert(G1, ExpertConfig(hidden=(16,)))
    with torch.no_grad():
        for parameter in expert.network.parameters():
            parameter.zero_()
    policy = expert.deployed().reset_out_keys()
    data = starts(tracking)
    names = {"effort_weight": 1.0, "rate_weight": 1.0, "steps": 2}
    loss = ImaginationLoss(policy, DynamicsModel(G1, SMALL), tracking, **names)
    whole = float(loss(data)["loss_policy"].detach())
    loss.set_keys(effort="residual")
    plain = ImaginationLoss(policy, DynamicsModel(G1, SMALL), tracking, effort_weight=0, rate_weight=0, steps=2)
    plain.model = loss.model
    assert float(loss(data)["loss_policy"].detach()) == pytest.approx(float(plain(data)["loss_policy"].detach()))
    assert whole > float(plain(data)["loss_policy"].detach()) + 0.1


def test_a_critic_speaks_for_what_is_not_imagined(tracking):
    expert = Expert(G1, ExpertConfig(hidden=(16,)))
    normalizer = ObservationNormalizer(expert.normalizer.in_keys, len(expert.normalizer.mean))
    head = nn.Linear(len(normalizer.mean), 1)
    critic = TensorDictSequential(normalizer.using(), TensorDictModule(head, ["observation"], ["cost_to_go"]))
    model, data = DynamicsModel(G1, SMALL), starts(tracking)
    without = ImaginationLoss(expert.deployed(), model, tracking, steps=2)
    loss = ImaginationLoss(expert.deployed(), model, tracking, steps=2, critic=critic)
    losses = loss(data)
    assert loss.out_keys == ["loss_policy", "loss_critic", "imagined_cost", "imagined_alive"]
    assert losses["loss_policy"] != without(data)["loss_policy"]
    losses["loss_policy"].backward()
    assert head.weight.grad is None
    assert expert.network[0].weight.grad.any()
    expert.zero_grad(set_to_none=True)
    losses["loss_critic"].backward()
    assert head.weight.grad.any()
    assert expert.network[0].weight.grad is None


@pytest.mark.parametrize("lost", [True, False])
def test_a_lost_robot_costs_the_critic_for_good(library, lost):
    """Known by hand: all robots are lost at once, or none ever is and the critic says 1."""

    class Task(DenseTracking):
        def lost(self, state, memory):
            return torch.full(memory.shape, lost)

        def cost(self, state, memory):
            return torch.full(memory.shape, 0.5)

        def finished(self, memory):
            return torch.zeros(memory.shape, dtype=torch.bool)

    task, expert = Task(library), Expert(G1, ExpertConfig(hidden=(16,)))

    class One(nn.Module):
        def __init__(self):
            super().__init__()
            self.value = nn.Parameter(torch.ones(1))

        def forward(self, gravity):
            return self.value.expand(len(gravity), 1)

    critic = TensorDictModule(One(), [("robot", "gravity_b")], ["cost_to_go"])
    options = {"steps": 2, "discount": 0.9, "critic": critic, "lost_cost": 2.0}
    loss = ImaginationLoss(expert.deployed(), DynamicsModel(G1, SMALL), task, **options)(starts(task))["loss_critic"]
    expected = 2.0 if lost else 0.1 * (0.5 + 0.9 * 0.5) + 0.81 * 1.0
    assert float(loss.detach()) == pytest.approx((1.0 - expected) ** 2, rel=1e-4)


def test_a_critic_needs_a_discount(tracking):
    expert = Expert(G1, ExpertConfig(hidden=(16,)))
    with pytest.raises(ConfigError, match="less than 1"):
        ImaginationLoss(expert.deployed(), DynamicsModel(G1, SMALL), tracking, discount=1.0, critic=expert.deployed())


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"discount": 2.0}, "imagination loss: discount is 2.0, expected a number from 0 to 1"),
        ({"discount": float("nan")}, "imagination loss: discount is nan"),
        ({"effort_weight": -1.0}, "imagination loss: effort_weight is -1.0, expected a number of at least 0"),
        ({"rate_weight": -1.0}, "imagination loss: rate_weight is -1.0"),
        ({"lost_cost": float("inf")}, "imagination loss: lost_cost is inf"),
    ],
)
def test_settings_out_of_range_are_refused(tracking, setting, message):
    expert = Expert(G1, ExpertConfig(hidden=(16,)))
    with pytest.raises(ConfigError, match=message):
        ImaginationLoss(expert.deployed(), DynamicsModel(G1, SMALL), tracking, **setting)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda data: data.select("memory"), "no entry 'robot_state'"),
        (lambda data: data.select("robot_state"), r"no entry \('memory', 'last_action'\)"),
        (
            lambda data: data.set("robot_state", data["robot_state"][:, :60]),
            r"'robot_state' has shape \(8, 60\), expected \[\*B, 71\]",
        ),
        (
            lambda data: TensorDict({"robot_state": data["robot_state"], "memory": data["memory"][:4]}),
            r"\('memory', 'last_action'\) has batch \(4,\), expected \(8,\) as of 'robot_state'",
        ),
        (lambda data: data.reshape(2, 4), r"states \(2, 4\), expected \[B\], as of reshape\(-1\)$"),
        (lambda data: data[0], r"states \(\), expected \[B\], as of reshape\(-1\)$"),
    ],
)
def test_starts_that_are_none_are_refused_by_name(tracking, spoil, message):
    expert = Expert(G1, ExpertConfig(hidden=(16,)))
    loss = ImaginationLoss(expert.deployed(), DynamicsModel(G1, SMALL), tracking, steps=1)
    with pytest.raises(ObservationError, match=f"^imagination loss: .*{message}"):
        loss(spoil(starts(tracking)))


def test_what_policy_and_critic_do_not_write_is_named(tracking, keyframes):
    expert, model = Expert(G1, ExpertConfig(hidden=(16,))), DynamicsModel(G1, SMALL)
    loss = ImaginationLoss(expert.deployed(), model, tracking, steps=1)
    loss.set_keys(effort="residual")
    with pytest.raises(ObservationError, match="imagination loss: policy: no entry 'residual'"):
        loss(starts(tracking))
    stray = TensorDictModule(nn.Linear(3, 2), [("robot", "gravity_b")], ["act"])
    shape = r"'act' has shape \(8, 2\), expected \[\*B, 29\]"
    for action, message in (("action", "no entry 'action'"), ("act", shape)):
        loss = ImaginationLoss(stray, model, tracking, steps=1)
        loss.set_keys(effort="act", action=action)
        with pytest.raises(ObservationError, match=f"imagination loss: policy: .*{message}"):
            loss(starts(tracking))
    loss = ImaginationLoss(expert.deployed(), model, tracking, steps=1, critic=stray)
    with pytest.raises(ObservationError, match="imagination loss: critic: no entry 'cost_to_go'"):
        loss(starts(tracking))
    loss = LatentImaginationLoss(LatentPolicy(G1).deployed(), model, keyframes, steps=1)
    with pytest.raises(ObservationError, match=r"imagination loss: policy: no entry \('posterior', 'loc'\)"):
        loss(starts(keyframes))


def test_half_precision_is_for_networks(tracking):
    seen, action = [], nn.Parameter(torch.zeros(29))

    def act(root_pos):
        seen.append(root_pos)
        return action.expand(len(root_pos), -1)

    policy = TensorDictModule(act, [("goal", "root_pos_b")], ["action"])
    loss = ImaginationLoss(policy, DynamicsModel(G1, SMALL), tracking, steps=2)
    with torch.autocast("cpu", torch.bfloat16):
        loss(starts(tracking))
    assert seen[1].requires_grad
    assert seen[1].dtype == torch.float32


class Multiplying(DenseTracking):
    """A task whose every method multiplies matrices, which half precision would round."""

    def _product(self, state):
        return state.joint_pos @ torch.linspace(0.5, 1.5, 29)

    def observe(self, state, memory):
        return super().observe(state, memory).set("product", self._product(state)[:, None])

    def cost(self, state, memory):
        return self._product(state).square() + 1e-3 * memory["sum"]

    def start(self, count):
        state, memory = super().start(count)
        return state, memory.set("sum", torch.zeros(count))

    def advance(self, memory, action):
        return super().advance(memory, action).set("sum", memory["sum"] + action @ torch.linspace(0.5, 1.5, 29))

    def reference(self, memory):
        return torch.linspace(0.5, 1.5, 29) * memory["sum"][:, None]


def test_a_tasks_own_products_are_in_full_precision(library):
    task = Multiplying(library)
    policy = TensorDictModule(lambda last: 0.1 + 0.5 * last, [("robot", "last_action")], ["action"])
    model, begin = DynamicsModel(G1, SMALL), starts(task)
    nn.init.zeros_(model.network[-1].weight)  # a robot that no layer moves
    nn.init.zeros_(model.network[-1].bias)
    for loss, name in (
        (ImaginationLoss(policy, model, task, steps=3), "imagined_cost"),
        (ReferenceLoss(policy, task), "loss_reference"),
    ):
        exact = loss(begin)[name]
        with torch.autocast("cpu", torch.bfloat16):
            assert float(loss(begin)[name]) == float(exact)


def test_a_policy_that_ends_in_half_precision_moves_imagined_robots_as_simulated_ones(library):
    torch.manual_seed(0)
    task, targets = DenseTracking(library), []
    policy = TensorDictModule(nn.Linear(29, 29), [("robot", "joint_pos")], ["action"])

    class Model(DynamicsModel):
        def forward(self, state, target, parameters=None):
            targets.append(target)
            return super().forward(state, target, parameters)

    begin = starts(task)
    with torch.autocast("cpu", torch.bfloat16):
        ImaginationLoss(policy, Model(G1, SMALL), task, steps=1)(begin)["loss_policy"].backward()
        action = policy(task.observe(GeneralizedState.unpack(begin["robot_state"]), begin["memory"]))["action"]
    assert action.dtype == torch.bfloat16
    assert policy.module.weight.grad.abs().sum() > 0
    # an environment takes actions as float32
    assert targets[0].equal(G1.default_joint_pos + G1.action_scale * action.float())


@pytest.fixture(scope="module")
def keyframes(library):
    return TimedKeyframes(library, TimedKeyframesConfig(chains=6))


def test_double_precision_is_kept(library):
    costs = TrackingCosts(bodies=12, end_effectors=6, miss=2)
    task = TimedKeyframes(library, TimedKeyframesConfig(chains=6, authored=1.0, partial=0.5, tracking=costs))
    policy, model, losses = PlainPolicy(G1, PlainPolicyConfig(also=("parts",))), DynamicsModel(G1, SMALL), []
    begin = starts(task)
    for _ in range(2):
        losses.append(ImaginationLoss(policy.deployed(), model, task, steps=2)(begin)["loss_policy"].detach())
        for module in (policy, model, task):
            module.double()
        begin = begin.apply(lambda value: value.double() if value.is_floating_point() else value)
    assert losses[1].dtype == torch.float64
    assert losses[1].item() == pytest.approx(losses[0].item(), rel=1e-3)


def test_posterior_and_prior_learn_from_what_follows(keyframes):
    policy = LatentPolicy(G1)
    loss = LatentImaginationLoss(policy.imagined(), DynamicsModel(G1, SMALL), keyframes, steps=3, beta=0.0)
    loss(starts(keyframes))["loss_policy"].backward()
    parts = {name.split(".")[0] for name in learners(policy)}
    assert parts == {"backbone", "prior", "encoder", "posterior", "decoder"}


@pytest.mark.parametrize(("share", "silent"), [(0.0, {"encoder", "posterior"}), (1.0, {"prior"})])
def test_who_acts_through_what(keyframes, share, silent):
    policy = LatentPolicy(G1)
    loss = LatentImaginationLoss(policy.imagined(share), DynamicsModel(G1, SMALL), keyframes, steps=2, beta=0.0)
    loss(starts(keyframes))["loss_policy"].backward()
    assert not silent & {name.split(".")[0] for name in learners(policy)}


def test_the_divergence_is_a_loss_of_its_own(keyframes):
    policy, model, begin = LatentPolicy(G1), DynamicsModel(G1, SMALL), starts(keyframes)
    losses = {}
    for beta in (0.5, 0.0):
        torch.manual_seed(0)
        losses[beta] = LatentImaginationLoss(policy.imagined(), model, keyframes, steps=2, beta=beta)(begin)
    assert losses[0.5]["kl"] > 0
    torch.testing.assert_close(losses[0.5]["loss_kl"], 0.5 * losses[0.5]["kl"])
    torch.testing.assert_close(losses[0.5]["loss_policy"], losses[0.0]["loss_policy"])
    assert losses[0.0]["loss_kl"] == 0


def test_a_latent_of_another_kind_is_imagined(keyframes):
    def latent(in_keys, group):
        return TensorDictModule(lambda *parts: torch.cat(parts, -1)[..., :32].tanh(), in_keys, [(group, "code")])

    policy = LatentPolicy(
        G1,
        prior=latent(["hidden"], "prior"),
        posterior=latent(["goal_code", "hidden"], "posterior"),
        sample=lambda group: TensorDictModule(nn.Identity(), [(group, "code")], [(group, "latent")]),
        mode=("prior", "code"),
    )
    parts = {"divergence": nn.MSELoss(reduction="none"), "parameters": ("code",)}
    model, begin = DynamicsModel(G1, SMALL), starts(keyframes)
    losses = LatentImaginationLoss(policy.imagined(), model, keyframes, steps=2, **parts)(begin)
    (losses["loss_policy"] + losses["loss_kl"]).backward()
    assert losses["kl"] > 0
    assert {name.split(".")[0] for name in learners(policy)} == {"backbone", "encoder", "decoder"}
    parts["divergence"] = nn.MSELoss()
    with pytest.raises(ObservationError, match=r"imagination loss: divergence has shape \(\), expected \[8, m\]"):
        LatentImaginationLoss(policy.imagined(), model, keyframes, steps=1, **parts)(begin)


def test_a_cost_without_a_gradient_is_refused(library):
    class Constant(DenseTracking):
        def cost(self, state, memory):
            return super().cost(state, memory).detach()

    task, expert = Constant(library), Expert(G1, ExpertConfig(hidden=(16,)))
    loss = ImaginationLoss(expert.deployed(), DynamicsModel(G1, SMALL), task, steps=2)
    with pytest.raises(TaskError, match=r"^Constant.cost\(\) has no gradient, expected a differentiable cost"):
        loss(starts(task))
    with torch.no_grad():
        assert loss(starts(task))["imagined_cost"] >= 0


def test_latents_are_sampled(keyframes):
    loss = LatentImaginationLoss(LatentPolicy(G1).imagined(), DynamicsModel(G1, SMALL), keyframes, steps=1)
    begin = starts(keyframes)
    assert loss(begin)["loss_policy"] != loss(begin)["loss_policy"]


def test_a_task_without_privileged_goals_says_so(tracking):
    loss = LatentImaginationLoss(LatentPolicy(G1).imagined(), DynamicsModel(G1, SMALL), tracking, steps=1)
    with pytest.raises(TaskError, match="DenseTracking has no privileged goals"):
        loss(starts(tracking))
