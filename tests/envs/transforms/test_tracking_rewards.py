import math
from dataclasses import replace

import pytest
import torch
from tensordict import TensorDict

from plat.envs.transforms import (
    DenseRewards,
    KeyframeRewards,
    Regularization,
    RewardGroup,
    Rewards,
    TrackingTerm,
)
from plat.robots import G1
from plat.rotations import quat_from_rotvec

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
