import pytest
import torch

from plat.control.authored import author
from plat.errors import KeyframeError
from plat.evaluation.authored_rollout import AuthoredRollout, Pushes
from plat.modules import PlainPolicy, PlainPolicyConfig
from plat.robots import G1
from plat.spec.timing import Timing

STAND = G1.default_qpos


def chains():
    return [chain for family in ("steps", "reach", "waypoint") for chain in author(family, G1, 1, seed=0)]


def test_pushes_of_a_chain_are_the_same_beside_any_others() -> None:
    policy = PlainPolicy(G1, PlainPolicyConfig(hidden_size=8, backbone=(8,))).deployed()
    pushes = Pushes(0.3, every=0.5, seed=4)
    every = [chain for family in ("far", "steps", "hold") for chain in author(family, G1, 2, 0, resting=STAND[None])]
    drawn = AuthoredRollout(policy, G1, every)._draw_pushes(pushes)
    assert drawn.keys() > {25, 50, 75}
    for rows in ([2], [3, 1], [3, 2]):  # some families, in another order, and holds that end earlier
        some = AuthoredRollout(policy, G1, [every[row] for row in rows])._draw_pushes(pushes)
        assert len(some) < len(drawn)
        for number, velocities in some.items():
            assert torch.equal(velocities, drawn[number][rows])
    first = torch.stack([drawn[25], drawn[50]])
    assert torch.allclose(first[..., :2].norm(dim=-1), torch.tensor(0.3).double())
    assert not first[..., 2:].any()
    assert len(first[..., 0].unique()) == 12  # each chain and time has its own
    other = AuthoredRollout(policy, G1, every)._draw_pushes(Pushes(0.3, every=0.5, seed=5))
    assert not (other[25] == drawn[25])[:, 0].any()


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


def test_chains_that_cannot_go_side_by_side_are_one_line() -> None:
    short = Timing(max_steps=30)  # 0.6 s, and the intervals of a chain are up to 1 s
    policy = PlainPolicy(G1, PlainPolicyConfig(hidden_size=8, backbone=(8,), timing=short)).deployed()
    split = author("arms", G1, 4, seed=0, timing=short)
    with pytest.raises(
        KeyframeError, match=r"authored keyframes: chains of \d+ to \d+ keyframes, expected as many in each"
    ):
        AuthoredRollout(policy, G1, split)
    with pytest.raises(KeyframeError, match="authored keyframes: no chains"):
        AuthoredRollout(policy, G1, [])
    with pytest.raises(KeyframeError, match="authored keyframes: chains is"):
        AuthoredRollout(policy, G1, split[0])
