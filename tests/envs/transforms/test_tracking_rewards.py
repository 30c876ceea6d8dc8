import math
from dataclasses import replace

import pytest
import torch
from tensordict import TensorDict

from plat.envs import KeyframeTaskConfig, TrackingTaskConfig
from plat.envs.transforms import (
    DenseRewards,
    KeyframeRewards,
    Regularization,
    RewardGroup,
    Rewards,
    TrackingTerm,
)
from plat.keyframes.partial import hands_of
from plat.robots import G1
from plat.rotations import quat_angle, quat_from_rotvec
from plat.spec.parts import Parts

DT = 0.02
N, K = 3, 14


def perfect() -> TensorDict:
    """A step on the reference, standing still."""
    upright = torch.tensor([1.0, 0, 0, 0]).expand(N, K, 4)
    state = {
        "joint_pos": G1.default_joint_pos.expand(N, 29).clone(),
        "joint_torque": torch.zeros(N, 29),
        "keypoint_pos_w": torch.randn(N, K, 3),
        "keypoint_quat_w": upright.clone(),
        "keypoint_lin_vel_w": torch.zeros(N, K, 3),
        "keypoint_ang_vel_w": torch.zeros(N, K, 3),
        "foot_force": torch.full((N, 2), 160.0),
        "stray_contacts": torch.zeros(N, 1),
    }
    reference = {key: state[key].clone() for key in ("joint_pos", "keypoint_pos_w", "keypoint_quat_w")}
    reference["keypoint_lin_vel_w"] = torch.zeros(N, K, 3)
    reference["keypoint_ang_vel_w"] = torch.zeros(N, K, 3)
    reference["keypoint_pos_aligned_w"] = state["keypoint_pos_w"].clone()
    reference["keypoint_quat_aligned_w"] = upright.clone()
    command = {"in_window": torch.ones(N, 1, dtype=torch.bool)}
    return TensorDict({"state": state, "reference": reference, "command": command, "reward": torch.zeros(N, 1)}, [N])


def before(action: float = 0.0) -> TensorDict:
    return TensorDict({"action": torch.full((N, 29), action), "robot": {"last_action": torch.zeros(N, 29)}}, [N])


def paying(terms: DenseRewards | KeyframeRewards | Regularization) -> Rewards:
    return Rewards([RewardGroup(1.0, terms.rewards(G1), getattr(terms, "floor", None))], DT)


def reward(transform, after: TensorDict, action: float = 0.0) -> float:
    return float(transform._step(before(action), after)["reward"][0]) / DT


def test_perfect_tracking_earns_every_weight():
    assert reward(paying(DenseRewards()), perfect()) == pytest.approx(1 + 0.5 + 1 + 1 + 1 + 1 + 1.5)
    assert reward(paying(KeyframeRewards()), perfect()) == pytest.approx(2.5)
    assert reward(paying(Regularization()), perfect()) == pytest.approx(0)


@pytest.mark.parametrize(
    ("term", "key", "error", "weight", "scale"),
    [
        ("anchor_pos", "keypoint_pos_w", [0.3, 0, 0], 1.0, 0.3),
        ("keypoint_pos", "keypoint_pos_aligned_w", [0, 0.15, 0], 1.0, 0.3),
        ("keypoint_lin_vel", "keypoint_lin_vel_w", [0, 0, 2.0], 1.0, 1.0),
        ("keypoint_ang_vel", "keypoint_ang_vel_w", [3.14, 0, 0], 1.0, 3.14),
    ],
)
def test_terms_are_gaussians_of_their_error(term, key, error, weight, scale):
    off = TrackingTerm(0.0, 1.0)
    only = DenseRewards(**{name: off for name in DenseRewards.__dataclass_fields__ if name != term})
    after = perfect()
    after["reference", key] = after["reference", key] + torch.tensor(error)
    squared = sum(part**2 for part in error)
    expected = weight * math.exp(-squared / scale**2)
    assert reward(paying(only), after) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize(
    ("term", "key"), [("anchor_rot", "keypoint_quat_w"), ("keypoint_rot", "keypoint_quat_aligned_w")]
)
def test_rotation_terms_measure_the_angle(term, key):
    off = TrackingTerm(0.0, 1.0)
    only = DenseRewards(**{name: off for name in DenseRewards.__dataclass_fields__ if name != term})
    after = perfect()
    after["reference", key] = quat_from_rotvec(torch.tensor([0.0, 0.4, 0.0])).expand(N, K, 4).clone()
    weight = getattr(DenseRewards(), term).weight
    assert reward(paying(only), after) == pytest.approx(weight * math.exp(-1), rel=1e-4)


def test_keyframes_pay_in_their_window_only():
    after = perfect()
    after["command", "in_window"] = torch.tensor([[True], [False], [True]])
    paid = paying(KeyframeRewards())._step(before(), after)["reward"][:, 0] / DT
    torch.testing.assert_close(paid, torch.tensor([2.5, 0.0, 2.5]))


def test_keyframe_joint_term():
    only = KeyframeRewards(keypoint_pos=TrackingTerm(0, 1), anchor_rot=TrackingTerm(0, 1))
    after = perfect()
    after["reference", "joint_pos"] = after["reference", "joint_pos"] + 0.2
    assert reward(paying(only), after) == pytest.approx(math.exp(-1), rel=1e-4)


def only_penalty(**weight: float) -> Rewards:
    zero = dict.fromkeys(("action_rate", "joint_limit", "stray_contact", "torque", "foot_slip", "impact"), 0.0)
    return paying(replace(Regularization(floor=None), **{**zero, **weight}))


def test_penalties():
    assert reward(only_penalty(action_rate=-0.1), perfect(), action=0.5) == pytest.approx(-0.1 * 29 * 0.25)

    after = perfect()
    after["state", "joint_pos"][:, 3] = G1.joint_range[3, 1] + 0.1
    low, high = G1.joint_range[3].tolist()
    excess = 0.1 + 0.05 * 0.5 * (high - low)  # the soft limit leaves 2.5 % of the range free at each end
    assert reward(only_penalty(joint_limit=-10), after) == pytest.approx(-10 * excess, rel=1e-4)

    after = perfect()
    after["state", "stray_contacts"] += 2
    assert reward(only_penalty(stray_contact=-0.1), after) == pytest.approx(-0.2)

    after = perfect()
    after["state", "joint_torque"] = 0.5 * G1.effort_limit.expand(N, 29)
    assert reward(only_penalty(torque=-1), after) == pytest.approx(-29 * 0.25)

    after = perfect()
    after["state", "keypoint_lin_vel_w"][..., 0] = 0.3
    after["state", "foot_force"] = torch.tensor([[200.0, 0.0]]).expand(N, 2)
    assert reward(only_penalty(foot_slip=-1), after) == pytest.approx(-0.09)

    after = perfect()
    after["state", "foot_force"] = torch.tensor([[3 * 9.81 * 33.341142, 0.0]]).expand(N, 2)
    assert reward(only_penalty(impact=-1), after) == pytest.approx(-1.0, rel=1e-4)


def test_penalties_together_have_a_floor():
    after = perfect()
    after["state", "stray_contacts"] += 2  # -0.2
    transform = paying(Regularization(floor=-5.0))
    assert reward(transform, after.clone(), action=0.1) == pytest.approx(-0.2 - 0.1 * 29 * 0.01)
    assert reward(transform, after.clone(), action=100.0) == pytest.approx(-5.0)
    terms = transform.groups[0].terms(before(100.0), after)
    assert terms["action_rate"][0] / terms["stray_contact"][0] == pytest.approx(0.1 * 29 * 1e4 / 0.2)
    assert reward(paying(Regularization(floor=None)), after, action=100.0) < -1e4


def test_factor_scales_all_terms_and_rewards_add_up():
    after = perfect()
    groups = RewardGroup(2.0, DenseRewards().rewards(G1)), RewardGroup(3.0, KeyframeRewards().rewards(G1))
    Rewards(groups, DT)._step(before(), after)
    assert float(after["reward"][0]) / DT == pytest.approx(2 * 7.0 + 3 * 2.5)


def noisy_step(count: int = 64) -> tuple[TensorDict, TensorDict]:
    """A step with every error that is rewarded."""

    def quats() -> torch.Tensor:
        return quat_from_rotvec(0.3 * torch.randn(count, K, 3))

    state = {
        "joint_pos": torch.randn(count, 29),
        "joint_torque": 30 * torch.randn(count, 29),
        "keypoint_pos_w": 0.3 * torch.randn(count, K, 3),
        "keypoint_quat_w": quats(),
        "keypoint_lin_vel_w": torch.randn(count, K, 3),
        "keypoint_ang_vel_w": torch.randn(count, K, 3),
        "foot_force": 1000 * torch.rand(count, 2),
        "stray_contacts": torch.randint(0, 3, (count, 1)).float(),
    }
    reference = {
        "joint_pos": torch.randn(count, 29),
        "keypoint_pos_w": 0.3 * torch.randn(count, K, 3),
        "keypoint_pos_aligned_w": 0.3 * torch.randn(count, K, 3),
        "keypoint_quat_w": quats(),
        "keypoint_quat_aligned_w": quats(),
        "keypoint_lin_vel_w": torch.randn(count, K, 3),
        "keypoint_ang_vel_w": torch.randn(count, K, 3),
    }
    command = {"in_window": torch.rand(count, 1) < 0.5}
    after = {"state": state, "reference": reference, "command": command, "reward": torch.zeros(count, 1)}
    act = {"action": 0.1 * torch.randn(count, 29), "robot": {"last_action": 0.1 * torch.randn(count, 29)}}
    return TensorDict(act, [count]), TensorDict(after, [count])


def expected_reward(config: KeyframeTaskConfig, before: TensorDict, after: TensorDict) -> torch.Tensor:
    """Rewards of stage 3 written out, in the order in which version 0.1 added them up."""
    state, reference, anchor = after["state"], after["reference"], G1.anchor_index

    def kernel(term: TrackingTerm, squared_error: torch.Tensor) -> torch.Tensor:
        return term.weight * torch.exp(squared_error / -(term.scale**2))

    def distance(entry: str, reference_entry: str) -> torch.Tensor:
        return (state[entry] - reference[reference_entry]).square().flatten(1).sum(-1) / K

    joint = (state["joint_pos"] - reference["joint_pos"]).square().mean(-1)
    anchor_pos = (state["keypoint_pos_w"][:, anchor] - reference["keypoint_pos_w"][:, anchor]).square().sum(-1)
    anchor_rot = quat_angle(state["keypoint_quat_w"][:, anchor], reference["keypoint_quat_w"][:, anchor]).square()
    rot = quat_angle(state["keypoint_quat_w"], reference["keypoint_quat_aligned_w"]).square().mean(-1)
    dense = [
        kernel(config.dense.anchor_pos, anchor_pos),
        kernel(config.dense.anchor_rot, anchor_rot),
        kernel(config.dense.keypoint_pos, distance("keypoint_pos_w", "keypoint_pos_aligned_w")),
        kernel(config.dense.keypoint_rot, rot),
        kernel(config.dense.keypoint_lin_vel, distance("keypoint_lin_vel_w", "keypoint_lin_vel_w")),
        kernel(config.dense.keypoint_ang_vel, distance("keypoint_ang_vel_w", "keypoint_ang_vel_w")),
        kernel(config.dense.joint_pos, joint),
    ]
    in_window = after["command", "in_window"][:, 0]
    sparse = [
        kernel(config.sparse.joint_pos, joint) * in_window,
        kernel(config.sparse.keypoint_pos, distance("keypoint_pos_w", "keypoint_pos_w")) * in_window,
        kernel(config.sparse.anchor_rot, anchor_rot) * in_window,
    ]
    low, high = G1.joint_range.unbind(-1)
    middle, half = G1.joint_range.mean(-1), 0.5 * (high - low)
    soft = config.regularization.soft_limit * half
    excess = ((middle - soft) - state["joint_pos"]).clamp_min(0) + (state["joint_pos"] - (middle + soft)).clamp_min(0)
    weights = config.regularization
    penalties = [
        weights.action_rate * (before["action"] - before["robot", "last_action"]).square().sum(-1),
        weights.joint_limit * excess.sum(-1),
        weights.stray_contact * state["stray_contacts"][:, 0],
    ]
    total = torch.stack(penalties).sum(0)
    penalties = [penalty * (weights.floor / total.clamp_max(weights.floor)) for penalty in penalties]
    reward = torch.zeros_like(joint)
    for weight, terms in (
        (config.dense_weight, dense),
        (config.sparse_weight, sparse),
        (config.regularization_weight, penalties),
    ):
        reward = reward + (weight * DT) * torch.stack(terms).sum(0)
    return reward


# the settings of recipes/refine.py, and the defaults
REFINE = KeyframeTaskConfig(
    dense_weight=0.3,
    sparse_weight=20.0,
    dense=DenseRewards(anchor_pos=TrackingTerm(2.0, 0.3)),
    sparse=KeyframeRewards(joint_pos=TrackingTerm(1.0, 0.1), keypoint_pos=TrackingTerm(1.0, 0.1)),
)


@pytest.mark.parametrize("config", [KeyframeTaskConfig(), REFINE], ids=["default", "refine"])
def test_the_default_rewards_are_bit_for_bit_those_of_the_shipped_policies(config):
    action_and_state, after = noisy_step()
    expected = expected_reward(config, action_and_state, after)
    paid = Rewards(config.rewards(G1), DT)._step(action_and_state, after)["reward"][:, 0]
    assert torch.equal(paid, expected)
    assert paid.std() > 0


def test_the_rewards_of_stage_one_are_those_of_stage_three_without_keyframes():
    action_and_state, after = noisy_step()
    dense = DenseRewards(anchor_pos=TrackingTerm(3.0, 0.4))  # as in recipes/expert.py
    expected = expected_reward(KeyframeTaskConfig(dense=dense, sparse_weight=0), action_and_state, after)
    paid = Rewards(TrackingTaskConfig(dense=dense).rewards(G1), DT)._step(action_and_state, after)["reward"][:, 0]
    assert torch.equal(paid, expected)


def paid(after, parts=None):
    """All rewards of a step but the penalties, of commands with masks."""
    act, _ = noisy_step(1)
    after = after.clone()
    if parts is not None:
        after["command", "parts"] = torch.tensor(parts, dtype=torch.float32).expand(len(after), -1)
    config = replace(REFINE, regularization_weight=0.0)
    return Rewards(config.rewards(G1), DT)._step(act.expand(len(after)), after)["reward"][:, 0]


def test_whole_keyframes_among_partial_ones_are_paid_as_ever():
    _, after = noisy_step()
    assert paid(after).equal(paid(after, Parts.all(G1).values()))


@pytest.mark.parametrize(
    ("commanded", "told"),
    [
        ({"bodies": hands_of(G1)}, ["keypoint_pos_w", "keypoint_pos_aligned_w", "keypoint_lin_vel_w"]),
        ({"joints": ("left_knee",)}, ["joint_pos"]),
        ({"root": ("horizontal",)}, ["keypoint_pos_w", "keypoint_pos_aligned_w", "keypoint_lin_vel_w"]),
        ({"root": ("orientation",)}, ["keypoint_quat_w", "keypoint_ang_vel_w"]),
    ],
    ids=["hands", "knee", "waypoint", "turned"],
)
def test_of_partial_keyframes_the_commanded_part_alone_is_paid(commanded, told):
    _, after = noisy_step()
    parts = Parts.only(G1, **commanded)
    before = paid(after, parts.values())
    bodies, joints = torch.tensor(parts.bodies), torch.tensor(parts.joints)
    bodies[0] |= any(parts.root)
    moved = noisy_step()[1]["reference"]
    for entry in list(after["reference"].keys()):
        mask = joints if entry == "joint_pos" else bodies[:, None]
        kept, drawn = after["reference", entry], moved[entry]
        other = after.clone()
        other["reference", entry] = torch.where(mask, kept, drawn)
        assert paid(other, parts.values()).equal(before), f"what is not commanded of {entry} is paid"
        other["reference", entry] = torch.where(mask, drawn, kept)
        assert (entry in told) == (not paid(other, parts.values()).equal(before)), entry
