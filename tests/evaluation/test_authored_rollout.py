import pytest
import torch

from plat.control.authored import author
from plat.evaluation.authored_rollout import AuthoredRollout
from plat.modules import PlainPolicy, PlainPolicyConfig
from plat.robots import G1


def chains():
    return [chain for family in ("steps", "reach", "waypoint") for chain in author(family, G1, 1, seed=0)]


@pytest.mark.parametrize("also", [(), ("parts",)])
def test_a_policy_that_sees_parts_is_shown_them_alone(also):
    policy = PlainPolicy(G1, PlainPolicyConfig(hidden_size=8, backbone=(8,), also=also)).deployed()
    rollout = AuthoredRollout(policy, G1, chains())
    first = next(iter(rollout)).before
    whole, hands, root = first["goal", "joint_pos"]
    assert bool(whole.any())
    assert bool(hands.any()) is not bool(also)
    assert bool(root.any()) is not bool(also)
    points = first["goal", "keypoint_pos_b"].view(3, 14, 3)
    shown = points.any(-1).sum(-1).tolist()
    assert shown == [14, 2, 0] if also else min(shown) >= 13  # the root of a standing pose is where it is


def test_the_masks_of_a_step_are_those_of_its_command():
    policy = PlainPolicy(G1, PlainPolicyConfig(hidden_size=8, backbone=(8,))).deployed()
    rollout = AuthoredRollout(policy, G1, chains())
    assert rollout.parts.shape == (3, 5, 46)
    for number in (1, int(rollout.arrivals[1, 0]), int(rollout.ends.max())):
        torch.testing.assert_close(rollout.commanded(number).sum(-1), torch.tensor([46.0, 2.0, 2.0]))
    rollout.parts[0, 1] = 0
    last_of_first = int(rollout.arrivals[0, 0])
    assert bool(rollout.commanded(last_of_first)[0].all())
    assert not bool(rollout.commanded(last_of_first + 1)[0].any())
