"""Cost of near misses: where it begins, where it ends, and what it looks at."""

import pytest
import torch

from plat.envs.state import GeneralizedState
from plat.motions import MotionLibrary, generate_motions
from plat.robots import G1, ForwardKinematics
from plat.rotations import quat_from_rotvec, quat_multiply
from plat.spec.parts import Parts
from plat.tasks import TimedKeyframes, TimedKeyframesConfig
from plat.tasks.near_miss import NearMiss, excess
from plat.tasks.settings import TrackingCosts

JOINTS = G1.num_joints
ENDS = torch.tensor([float(name in G1.end_effectors) for name in G1.keypoints])


def standing(count=1):
    qpos = torch.tensor(G1.default_qpos, dtype=torch.float32).repeat(count, 1)
    return GeneralizedState.unpack(torch.cat((qpos, torch.zeros(count, 6 + JOINTS)), -1))


def cost(state, parts=None, arrives=False, within=0.2):
    pose, kinematics = standing(len(state.root_pos_w)), ForwardKinematics(G1)
    points, wanted = (kinematics(where.root_pos_w, where.root_quat_w, where.joint_pos)[0] for where in (state, pose))
    return NearMiss(G1.anchor_index, ENDS, 3)(
        state,
        pose,
        points,
        wanted,
        parts,
        reached_within=torch.full((len(points),), within),
        arrives=torch.full((len(points),), arrives),
    )


def moved(*offset):
    state = standing()
    return state._replace(root_pos_w=state.root_pos_w + torch.tensor(offset))


def hands():
    parts = torch.zeros(1, JOINTS + len(G1.keypoints) + 3)
    for name in ("left_wrist_yaw_link", "right_wrist_yaw_link"):
        parts[:, JOINTS + G1.keypoints.index(name)] = 1.0
    return parts


def test_errors_count_between_two_shares_of_their_threshold():
    assert excess(torch.tensor([0.0, 0.6, 1.0, 2.5, 50.0]), 1.0).tolist() == pytest.approx([0, 0, 0.4, 1.9, 1.9])


def test_who_is_well_within_the_thresholds_pays_nothing():
    assert float(cost(standing(), arrives=True)) == 0.0
    assert float(cost(moved(0.08, 0.0, 0.08), arrives=True)) == 0.0


def test_along_a_motion_heights_count_and_the_place_does_not():
    # anchor and four end effectors are 0.2 m too high, of 0.25
    assert float(cost(moved(0.0, 0.0, 0.2))) == pytest.approx(5 * (0.8 - 0.6), abs=1e-4)
    assert float(cost(moved(0.3, 0.0, 0.0))) == 0.0


def test_an_authored_keyframe_has_a_place_at_its_arrival():
    assert float(cost(moved(0.2, 0.0, 0.0), arrives=True)) == pytest.approx(3 * 0.4, abs=0.01)
    assert float(cost(moved(0.2, 0.0, 0.0))) == 0.0


def test_nobody_is_drawn_to_what_is_out_of_reach():
    offset = torch.tensor([[2.0, 0.0, 0.0]], requires_grad=True)
    state = standing()
    cost(state._replace(root_pos_w=state.root_pos_w + offset), arrives=True).sum().backward()
    assert offset.grad.abs().max() == 0.0


def test_hands_are_near_within_the_distance_of_their_family():
    state, elbow = standing(), torch.zeros(1, JOINTS)
    elbow[0, G1.joint_names.index("left_elbow")] = 0.4
    bent = state._replace(joint_pos=state.joint_pos + elbow)
    near, strict = (float(cost(bent, hands(), arrives=True, within=within)) for within in (0.2, 0.05))
    assert near == 0.0
    assert strict > 1.0
    assert float(cost(moved(0.0, 1.0, 0.0)._replace(joint_pos=state.joint_pos), hands() * 0, arrives=True)) == 0.0


@pytest.mark.parametrize("partial", [0.0, 0.5])
def test_the_task_adds_it_in_the_arrival_window(partial):
    library = MotionLibrary.from_clips(generate_motions("train", seconds=8))
    costs = []
    for weight in (0.0, 2.0):
        config = TimedKeyframesConfig(chains=6, partial=partial, tracking=TrackingCosts(miss=weight))
        task = TimedKeyframes(library, config)
        _, memory = task.along(torch.tensor([5]))
        arrival = memory.copy().set("goal", memory["frame"])
        if partial:
            arrival["parts"] = torch.tensor([0])
        reference = task.table.state(memory["frame"])
        high = reference._replace(root_pos_w=reference.root_pos_w + torch.tensor([0.0, 0.0, 0.2]))
        costs.append([float(task.cost(high, arrival.set("steps_left", torch.tensor([left])))) for left in (3, 2)])
    assert costs[1][0] == costs[0][0]
    assert costs[1][1] - costs[0][1] == pytest.approx(2.0 * 5 * 0.2, abs=1e-3)


@pytest.mark.parametrize(
    ("commanded", "authored", "missed"),
    [
        # turned by 2 of 1 rad in the window; at an authored arrival by 2 of 0.2 rad, and 0.4 of 0.2 m away
        ({"root": ["horizontal", "height", "orientation"]}, False, 1.4),
        ({"root": ["horizontal", "height", "orientation"]}, True, 1.4 + 3 * (1.4 + 1.9)),
        ({"root": ["horizontal"]}, True, 3 * 1.4),
        ({"joints": ["left_elbow"]}, False, 0.0),
        ({"joints": ["left_elbow"]}, True, 3 * 1.9),
    ],
)
def test_keyframes_that_command_no_body_have_near_misses(library, commanded, authored, missed):
    costs = []
    for weight in (0.0, 2.0):
        config = TimedKeyframesConfig(chains=6, partial=1.0, tracking=TrackingCosts(miss=weight))
        task = TimedKeyframes(library, config, reset_noise=None)
        task.masks.table[1] = torch.tensor(Parts.only(G1, **commanded).values(), dtype=torch.float32)
        _, memory = task.authored(torch.tensor([0])) if authored else task.along(torch.tensor([5]))
        memory["parts"] = torch.tensor([1])
        if not authored:
            memory["frame"] = memory["goal"].clone()
        there = task.table.state(memory["goal"])
        turned = quat_multiply(quat_from_rotvec(torch.tensor([[0.0, 0.0, 2.0]])), there.root_quat_w)
        away = there.root_pos_w + torch.tensor([0.4, 0.0, 0.0])
        off = there._replace(root_pos_w=away, root_quat_w=turned, joint_pos=there.joint_pos + 1.0)
        costs.append([float(task.cost(off, memory.set("steps_left", torch.tensor([left])))) for left in (3, 0)])
    assert costs[1][0] == costs[0][0]
    assert costs[1][1] - costs[0][1] == pytest.approx(2.0 * missed, abs=1e-2)
