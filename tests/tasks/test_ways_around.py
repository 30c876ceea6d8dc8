from dataclasses import replace

import mujoco
import numpy as np
import pytest
import torch

from plat.keyframes.chain_families import INSIDE
from plat.motions.checks.collision import self_penetration
from plat.robots import G1
from plat.tasks import draw_chains
from plat.tasks.ways_around import WaysAround

STANDING = torch.as_tensor(G1.default_qpos, dtype=torch.float32)


def depth(poses):
    """How deep links are in each other in the worst of some poses (m)."""
    data = mujoco.MjData(G1.shared_model)
    return max(self_penetration(G1.shared_model, pose, data) for pose in poses.numpy())


def straight(before, after, parts):
    """Poses between two that share a root's orientation."""
    return before.lerp(after, torch.linspace(0, 1, parts + 1)[1:-1, None])


def with_joints(**angles):
    pose = STANDING.clone()
    for name, angle in angles.items():
        pose[7 + G1.joint_names.index(name)] = angle
    return pose


@pytest.fixture(scope="module")
def pairs(library):
    """Successive poses of reaching chains, with the pose midway or None."""
    chains = draw_chains(library, 40, ["reach"], seed=5)
    rows = chains.steps.nonzero()[:, 0].tolist()
    middles = [None if chains.middle_row[row] < 0 else chains.middle[chains.middle_row[row]] for row in rows]
    return [(chains.qpos[row - 1], chains.qpos[row], middle) for row, middle in zip(rows, middles, strict=True)]


def test_a_straight_line_that_is_clear_stays_straight(pairs):
    clear = [pair[:2] for pair in pairs if pair[2] is None and depth(torch.stack(pair[:2])) < INSIDE]
    assert len(clear) > 150
    # between the poses that are looked at, links may touch
    assert np.mean([depth(straight(*pair, 48)) < INSIDE + 0.005 for pair in clear]) > 0.97


def test_a_way_leads_around_what_the_straight_line_leads_through(pairs):
    bent = [pair for pair in pairs if pair[2] is not None]
    assert len(bent) >= 5
    for before, after, middle in bent:
        assert depth(straight(before, after, 12)) >= INSIDE
        assert depth(torch.cat((straight(before, middle, 6), middle[None], straight(middle, after, 6)))) < INSIDE


def test_the_pose_midway_is_within_the_limits_and_on_its_feet(pairs):
    low, high = G1.joint_range.unbind(-1)
    legs = [7 + joint for joint in G1.leg_joints]
    for middle in (pair[2] for pair in pairs if pair[2] is not None):
        assert (middle[7:] >= low).all()
        assert (middle[7:] <= high).all()
        assert torch.allclose(middle[legs], STANDING[legs])
        assert torch.allclose(middle[:7], STANDING[:7])


def test_same_poses_have_the_same_way(pairs):
    before, after, middle = next(pair for pair in pairs if pair[2] is not None)
    ways = WaysAround(G1)
    assert ways.between(before, after).equal(middle)
    # turned about the vertical, with the robot: the way is the robot's own
    turn = torch.tensor([0.0, 0.0, 0.0, 1.0])
    turned = [torch.cat((pose[:3], turn, pose[7:])) for pose in (before, after)]
    assert torch.allclose(ways.between(*turned)[7:], middle[7:], atol=1e-5)


def test_no_way_leads_out_of_a_pose_that_is_in_itself():
    folded = with_joints(left_shoulder_roll=-1.2)
    assert depth(folded[None]) > INSIDE
    assert WaysAround(G1).between(STANDING, folded) is None
    assert WaysAround(G1).between(folded, folded) is None


def test_a_robot_without_two_hands_goes_straight(pairs):
    before, after, _ = next(pair for pair in pairs if pair[2] is not None)
    one_handed = replace(G1, end_effectors=G1.end_effectors[:-1])
    assert WaysAround(one_handed).between(before, after) is None


def test_a_chain_with_a_bent_line_leads_to_and_fro_on_it(library):
    chains = draw_chains(library, 40, ["reach"], seed=5)
    bent = [chain for chain in range(40) if (chains.middle_row[chains.chain == chain] >= 0).any()]
    assert 5 <= len(bent) < 30
    for chain in bent:
        rows = (chains.chain == chain).nonzero()[:, 0]
        poses, passed = chains.qpos[rows], chains.middle_row[rows]
        assert poses[0].equal(STANDING)
        assert poses[1:4:2].equal(poses[3:6:2])
        assert poses[2].equal(poses[4])
        assert (passed[2:] >= 0).all()
        assert all(chains.middle[row].equal(chains.middle[passed[2]]) for row in passed[2:].tolist())
