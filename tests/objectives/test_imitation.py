import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torchrl.envs.utils import ExplorationType, set_exploration_type

from plat.collectors import ExpertLabels, PrivilegedGoals
from plat.envs import make_keyframe_env
from plat.errors import ActionError, ObservationError
from plat.modules import STUDENT_KEYS, Expert, LatentPolicy, PlainPolicy
from plat.objectives import ImitationLoss, LatentImitationLoss, gaussian_kl
from plat.robots import G1
from tests.modules.policies.test_student import SMALL


@pytest.fixture(scope="module")
def batch(library) -> TensorDict:
    env = make_keyframe_env(library, 64)
    rollout = env.rollout(3, break_when_any_done=False)
    states = ExpertLabels(Expert(G1).deployed("dense_goal", out_key="expert_action"), STUDENT_KEYS)(rollout)
    return PrivilegedGoals(library, stride=5)(states)


@pytest.fixture
def policy() -> LatentPolicy:
    return LatentPolicy(G1, SMALL)


def parts_with_gradient(policy: torch.nn.Module, loss: torch.Tensor) -> set[str]:
    policy.zero_grad()
    loss.backward(retain_graph=True)
    return {
        name.split(".")[0]
        for name, weight in policy.named_parameters()
        if weight.grad is not None and weight.grad.abs().sum() > 0
    }


def test_each_term_teaches_exactly_its_parts(batch, policy):
    losses = LatentImitationLoss(policy.training_graph())(batch)
    assert parts_with_gradient(policy, losses["loss_posterior"]) == {"backbone", "encoder", "posterior", "decoder"}
    assert parts_with_gradient(policy, losses["loss_prior"]) == {"backbone", "prior", "decoder"}
    assert parts_with_gradient(policy, losses["loss_kl"]) == {"backbone", "encoder", "posterior", "prior"}


def test_terms_are_the_equation(batch, policy):
    torch.manual_seed(1)
    losses = LatentImitationLoss(policy.training_graph(), prior_weight=0.7, beta=0.03)(batch)
    torch.manual_seed(1)
    with set_exploration_type(ExplorationType.RANDOM):
        out = policy.training_graph()(batch.clone())
    label = batch["expert_action"]
    expected = (out["posterior", "action"] - label).square().sum(-1).mean()
    torch.testing.assert_close(losses["loss_posterior"], expected)
    expected = 0.7 * (out["prior", "action"] - label).square().sum(-1).mean()
    torch.testing.assert_close(losses["loss_prior"], expected)
    kl = (
        gaussian_kl(out["posterior", "loc"], out["posterior", "scale"], out["prior", "loc"], out["prior", "scale"])
        .sum(-1)
        .mean()
    )
    torch.testing.assert_close(losses["loss_kl"], 0.03 * kl)
    torch.testing.assert_close(losses["kl"], kl)


@pytest.mark.parametrize("exploration", [ExplorationType.RANDOM, ExplorationType.DETERMINISTIC, ExplorationType.MEAN])
def test_latents_are_sampled_whatever_the_exploration_type(batch, policy, exploration):
    loss = LatentImitationLoss(policy.training_graph())
    with set_exploration_type(exploration):
        first, second = loss(batch), loss(batch)
    assert first["loss_posterior"] != second["loss_posterior"]
    assert first["loss_prior"] != second["loss_prior"]
    assert first["loss_kl"] == second["loss_kl"]


def test_samples_have_the_posteriors_spread(batch, policy):
    latents = []
    for _ in range(200):
        with set_exploration_type(ExplorationType.RANDOM):
            out = policy.training_graph()(batch[:8].clone())
        latents.append(out["posterior", "latent"].detach())
    spread = torch.stack(latents).std(0)
    torch.testing.assert_close(spread, out["posterior", "scale"].detach(), rtol=0.35, atol=0)


def test_free_bits_leave_small_divergences_alone(batch, policy):
    plenty = LatentImitationLoss(policy.training_graph(), beta=1.0, free_bits=100.0)(batch)
    assert plenty["loss_kl"].item() == pytest.approx(100.0 * SMALL.latent_size)
    assert parts_with_gradient(policy, plenty["loss_kl"]) == set()


def test_free_bits_are_those_of_a_batch(batch, policy):
    """One sample may be far from the prior where others are near: what is free is the mean of a dimension."""
    kl = torch.arange(len(batch), dtype=torch.float32)[:, None].expand(-1, 2) * torch.tensor([1.0, 10.0])
    mean = (len(batch) - 1) / 2
    loss = LatentImitationLoss(
        policy.training_graph(), beta=1.0, free_bits=2 * mean, divergence=lambda *_: kl, parameters=("loc",)
    )
    assert loss(batch)["loss_kl"].item() == pytest.approx(2 * mean + 10 * mean)


def test_beta_can_be_annealed(batch, policy):
    loss = LatentImitationLoss(policy.training_graph(), beta=0.5)
    full = loss(batch)["loss_kl"]
    loss.beta.fill_(0.25)
    torch.testing.assert_close(loss(batch)["loss_kl"], 0.5 * full)


def test_keys_can_be_set(batch, policy):
    loss = LatentImitationLoss(policy.training_graph())
    loss.set_keys(expert_action="label")
    assert "label" in loss.in_keys
    renamed = batch.clone().rename_key_("expert_action", "label")
    assert loss(renamed)["loss_prior"].isfinite()


def test_dispatch_without_a_tensordict(batch, policy):
    loss = LatentImitationLoss(policy.training_graph())
    values = {"_".join(key) if isinstance(key, tuple) else key: batch[key] for key in loss.in_keys}
    losses = loss(**values)
    assert len(losses) == len(loss.out_keys)


@pytest.mark.parametrize("kind", ["latent", "plain"])
def test_loss_does_not_write_into_the_batch(batch, policy, kind):
    before = batch.clone()
    loss = LatentImitationLoss(policy.training_graph()) if kind == "latent" else None
    (loss or ImitationLoss(PlainPolicy(G1, SMALL).training_graph()))(batch)
    assert set(batch.keys(True, True)) == set(before.keys(True, True))
    assert (batch == before).all()


def test_divergence_is_the_callers(batch, policy):
    def distance(posterior: torch.Tensor, prior: torch.Tensor) -> torch.Tensor:
        return (posterior - prior).square()

    loss = LatentImitationLoss(policy.training_graph(), beta=1.0, divergence=distance, parameters=("loc",))
    torch.manual_seed(1)
    out = policy.training_graph()(batch.clone())
    expected = (out["posterior", "loc"] - out["prior", "loc"]).square().sum(-1).mean()
    torch.testing.assert_close(loss(batch)["loss_kl"], expected)


def test_the_plain_losses_keys_can_be_set(batch):
    plain = PlainPolicy(G1, SMALL)
    loss = ImitationLoss(plain.training_graph())
    loss.set_keys(expert_action="label")
    renamed = batch.clone().rename_key_("expert_action", "label")
    torch.testing.assert_close(loss(renamed), ImitationLoss(plain.training_graph())(batch))
    values = {"_".join(key) if isinstance(key, tuple) else key: renamed[key] for key in loss.in_keys}
    assert len(loss(**values)) == len(loss.out_keys)


def test_plain_loss_is_the_squared_distance(batch):
    plain = PlainPolicy(G1, SMALL)
    loss = ImitationLoss(plain.training_graph())
    action = plain.deployed()(batch.select(*STUDENT_KEYS))["action"]
    expected = (action - batch["expert_action"]).square().sum(-1).mean()
    torch.testing.assert_close(loss(batch)["loss_imitation"], expected)


@pytest.mark.parametrize("kind", ["latent", "plain"])
def test_the_student_learns(batch, kind):
    if kind == "latent":
        student = LatentPolicy(G1, SMALL)
        loss = LatentImitationLoss(student.training_graph())
    else:
        student = PlainPolicy(G1, SMALL)
        loss = ImitationLoss(student.training_graph())
    student.update_normalizers(batch)
    optimizer = torch.optim.Adam(student.parameters(), lr=3e-3)

    @torch.no_grad()
    def error() -> float:
        action = student.deployed()(batch.select(*STUDENT_KEYS))["action"]
        return float((action - batch["expert_action"]).square().sum(-1).mean())

    before = error()
    for _ in range(150):
        total = sum(value for name, value in loss(batch).items() if name.startswith("loss_"))
        optimizer.zero_grad()
        total.backward()
        optimizer.step()
    assert error() < 0.3 * before


@pytest.mark.parametrize("entry", [("robot", "joint_vel"), "expert_action"])
@pytest.mark.parametrize("kind", [LatentPolicy, PlainPolicy])
def test_a_batch_that_is_not_finite_is_refused(batch, kind, entry):
    loss_class = LatentImitationLoss if kind is LatentPolicy else ImitationLoss
    loss = loss_class(kind(G1).training_graph())
    spoiled = batch.clone()
    spoiled[entry][7, 2] = float("nan")
    with pytest.raises(ActionError, match="imitation loss: nan, expected a finite number; nothing was learned"):
        loss(spoiled)
    loss(batch)


def test_a_policy_without_a_posterior_is_named(batch):
    loss = LatentImitationLoss(PlainPolicy(G1).training_graph())
    with pytest.raises(ObservationError, match=r"the policy writes no \('posterior', 'action'\)"):
        loss(batch)


def test_a_policy_that_writes_another_entry_is_named(batch):
    policy = TensorDictModule(torch.nn.Linear(29, 29), [("robot", "joint_pos")], ["loc"])
    with pytest.raises(ObservationError, match="imitation loss: policy: no entry 'action'"):
        ImitationLoss(policy)(batch)


def test_parameters_that_a_posterior_does_not_write_are_named(batch, policy):
    loss = LatentImitationLoss(policy.training_graph(), parameters=("logits",))
    with pytest.raises(ObservationError, match=r"the policy writes no \('posterior', 'logits'\)"):
        loss(batch)


def test_one_sample_is_a_batch_of_one(batch, policy):
    found = []
    for one in (batch[0], batch[:1]):
        torch.manual_seed(0)
        found.append(LatentImitationLoss(policy.training_graph())(one))
    torch.testing.assert_close(*found)


@pytest.mark.parametrize("count", [None, 5])
def test_a_divergence_without_dimensions_is_refused(batch, policy, count):
    def total(*parameters):
        return gaussian_kl(*parameters).sum(-1)

    loss = LatentImitationLoss(policy.training_graph(), divergence=total)
    expected = r"\(\), expected \[m\]" if count is None else r"\(5,\), expected \[5, m\]"
    with pytest.raises(ObservationError, match=f"imitation loss: divergence has shape {expected}"):
        loss(batch[0] if count is None else batch[:count])
