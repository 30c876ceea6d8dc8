import dataclasses

import pytest
import torch
from tensordict import TensorDict

from plat.export import JointTargetNetwork
from plat.modules import (
    KeyframeReach,
    LatentPolicy,
    LatentPolicyConfig,
    PlainPolicy,
    PlainPolicyConfig,
    RefinementConfig,
    ResidualLatentPolicy,
    WalkingReach,
)
from plat.robots import G1
from plat.spec.observation import observation_widths, student_keys
from plat.spec.timing import Timing

REACH = WalkingReach(acceleration=2.0, speed=1.5, margin=0.1)


def shown(way, seconds, velocity=(0.0, 0.0, 0.0), bodies=None, commanded=(1.0, 1.0, 1.0)):
    """Where a keyframe is shown whose two keypoints are on its root and a meter above."""
    root, up = torch.tensor([way]), torch.tensor([[0.0, 0.0, 1.0]])
    entries = {
        "goal": {"root_pos_b": root, "keypoint_pos_b": torch.cat((root, root + up), -1)},
        "command": {"horizon": torch.tensor([[seconds / 3.0]])},
        "robot": {"root_lin_vel_b": torch.tensor([velocity])},
    }
    if bodies is not None:
        entries["parts"] = {"bodies": torch.tensor([bodies]), "root": torch.tensor([commanded])}
    near = KeyframeReach(REACH, horizon=3.0, parts=bodies is not None)(TensorDict(entries, [1]))["near_goal"]
    return near["root_pos_b"][0].tolist(), near["keypoint_pos_b"][0].tolist()


@pytest.mark.parametrize(
    ("seconds", "velocity", "farthest"),
    [
        (0.4, 0.0, 0.1 + 0.16),
        (1.0, 0.0, 0.1 + 1.0),
        (3.0, 0.0, 0.1 + 4.5),  # at 1.5 m/s, not at 3
        (0.5, 1.0, 0.1 + 0.5 + 0.25),
        (1.0, 4.0, 0.1 + 4.0),  # who runs is shown as far as it runs
        (1.0, -2.0, 0.1 + 1.0),
        (0.0, 0.0, 0.1),
    ],
)
def test_a_keyframe_is_shown_as_far_as_a_robot_gets(seconds, velocity, farthest):
    root, keypoints = shown([0.0, 10.0, 0.3], seconds, (0.5, velocity, 0.0))
    assert root == pytest.approx([0.0, farthest, 0.3], abs=1e-5)
    assert keypoints == pytest.approx([0.0, farthest, 0.3, 0.0, farthest, 1.3], abs=1e-5)


def test_a_keyframe_within_reach_is_where_it_is():
    root, keypoints = shown([0.3, -0.4, 0.1], 1.0)
    assert root == pytest.approx([0.3, -0.4, 0.1])
    assert keypoints == pytest.approx([0.3, -0.4, 0.1, 0.3, -0.4, 1.1])
    assert shown([0.0, 0.0, 0.2], 1.0)[0] == pytest.approx([0.0, 0.0, 0.2])


def test_what_is_not_commanded_is_not_moved():
    root, keypoints = shown([4.0, 0.0, 0.3], 1.0, bodies=[1.0, 0.0])
    assert root == pytest.approx([1.1, 0.0, 0.3], abs=1e-5)
    assert keypoints == pytest.approx([1.1, 0.0, 0.3, 4.0, 0.0, 1.3], abs=1e-5)


def test_a_height_alone_is_where_it_is_however_the_robot_leans():
    """In the frame of a root that leans by 1.2 rad, 0.46 m down are 0.43 m to the side."""
    way = [-0.43, 0.0, -0.167]
    root, keypoints = shown(way, 0.1, bodies=[1.0, 1.0], commanded=(0.0, 1.0, 0.0))
    assert root == pytest.approx(way)
    assert keypoints == pytest.approx([*way, *way[:2], way[2] + 1])


def test_the_gradient_is_finite_on_the_spot():
    way = torch.zeros(1, 3, requires_grad=True)
    entries = {
        ("goal", "root_pos_b"): way,
        ("goal", "keypoint_pos_b"): way.repeat(1, 2),
        ("command", "horizon"): torch.zeros(1, 1),
        ("robot", "root_lin_vel_b"): torch.ones(1, 3, requires_grad=True),
    }
    near = KeyframeReach(REACH, horizon=1.0)(TensorDict(entries, [1]))
    near["near_goal", "root_pos_b"].sum().backward()
    assert way.grad.isfinite().all()


def observation(far, also=()):
    widths = observation_widths(student_keys(also), G1)
    seen = TensorDict({key: torch.zeros(1, n) for key, n in zip(student_keys(also), widths, strict=True)}, [1])
    seen["command", "horizon"] += 0.2
    seen["goal", "root_pos_b"][:, 0] = far
    if also:  # no body is commanded
        seen["parts", "root"] += 1.0
    else:
        seen["goal", "keypoint_pos_b"][:, ::3] = far
    return seen


LATENT = LatentPolicyConfig(reach=REACH)
PLAIN = PlainPolicyConfig(reach=REACH, also=("parts", "clock"), timing=Timing(max_steps=150))


@pytest.mark.parametrize(
    "policy",
    [
        lambda: PlainPolicy(G1, PLAIN),
        lambda: LatentPolicy(G1, LATENT),
        lambda: ResidualLatentPolicy(LatentPolicy(G1, LATENT)),
        lambda: ResidualLatentPolicy(LatentPolicy(G1, LATENT), RefinementConfig(lead=0.05)),
    ],
    ids=["plain", "latent", "refined", "refined with lead"],
)
def test_policies_see_it_nearer_also_exported(policy):
    torch.manual_seed(0)
    policy = policy()
    also = policy.config.also if hasattr(policy.config, "also") else ()
    act, network = policy.deployed(), JointTargetNetwork(policy)
    keys = student_keys(also)
    actions, targets = [], []
    with torch.no_grad():
        for far in (0.3, 5.0, 9.0):
            seen = observation(far, also)
            targets.append(network(torch.cat([seen[key] for key in keys], -1)))
            actions.append(act(seen)["action"])
    assert not torch.equal(actions[0], actions[1])
    torch.testing.assert_close(actions[1], actions[2])
    torch.testing.assert_close(targets[1], targets[2])
    assert not torch.equal(targets[0], targets[1])


def test_without_it_a_keyframe_is_where_it_is():
    torch.manual_seed(0)
    policy = PlainPolicy(G1, dataclasses.replace(PLAIN, reach=None))
    five, nine = (policy.deployed()(observation(far, PLAIN.also))["action"] for far in (5.0, 9.0))
    assert not torch.equal(five, nine)
