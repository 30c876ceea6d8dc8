import math
from dataclasses import replace
from types import SimpleNamespace

import pytest
import torch
from tensordict import TensorDict

from plat.control import ReachLimits
from plat.envs import GeneralizedState
from plat.envs.reach import LowestRoot, distances, down
from plat.envs.transforms import TerminationLimits
from plat.envs.transforms.terminations import fallen
from plat.robots import G1
from plat.spec.parts import Parts
from plat.tasks import Task

WHOLE = Parts.all(G1)


def robots(**changes: torch.Tensor) -> TensorDict:
    """One robot in a pose of zeros."""
    entries = {
        "keypoint_pos_w": torch.zeros(1, 14, 3),
        "keypoint_quat_w": torch.tensor([1.0, 0, 0, 0]).expand(1, 14, 4).clone(),
        "joint_pos": torch.zeros(1, 29),
    }
    return TensorDict({**entries, **changes}, [1])


def mask(parts: Parts) -> torch.Tensor:
    return torch.tensor(parts.values(), dtype=torch.float32)[None]


def test_distances_are_of_what_is_commanded():
    places = torch.zeros(1, 14, 3)
    places[0, 0] = torch.tensor([0.3, 0.4, 1.2])
    places[0, 10] = torch.tensor([0.0, 0.1, 0.0])
    angles = torch.zeros(1, 29)
    angles[0, :2] = torch.tensor([0.2, 0.4])
    state = robots(keypoint_pos_w=places, joint_pos=angles)

    def of(parts: Parts | None):
        return distances(state, robots(), None if parts is None else mask(parts))

    for whole in (of(None), of(WHOLE)):
        assert float(whole.root) == pytest.approx(1.3)
        assert float(whole.joints) == pytest.approx(0.6 / 29)
        assert bool(whole.whole)
    assert float(of(Parts.only(G1, root=["horizontal"])).root) == pytest.approx(0.5)
    assert float(of(Parts.only(G1, root=["height"])).root) == pytest.approx(1.2)
    assert float(of(Parts.only(G1, joints=G1.joint_names[:1])).joints) == pytest.approx(0.2)
    hand = of(Parts.only(G1, bodies=["left_wrist_yaw_link"]))
    assert float(hand.bodies) == pytest.approx(0.1)
    assert (float(hand.root), float(hand.joints), float(hand.turn)) == (0, 0, 0)
    assert not bool(hand.whole)


def test_a_partial_keyframe_is_near_when_all_that_it_commands_is():
    turned = torch.tensor([math.cos(0.15), 0, 0, math.sin(0.15)]).expand(1, 14, 4)  # 0.3 rad
    places = torch.zeros(1, 14, 3)
    places[0, 10, 0] = 0.1
    state = robots(keypoint_pos_w=places, keypoint_quat_w=turned)

    def near(parts: Parts, limits: ReachLimits | None = None, bodies: float | None = None) -> bool:
        return bool(distances(state, robots(), mask(parts)).near(limits or ReachLimits(), bodies))

    hand = Parts.only(G1, bodies=["left_wrist_yaw_link"])
    assert near(WHOLE)  # of a whole pose, root and joints count
    assert near(hand)
    assert not near(hand, bodies=0.05)
    assert not near(hand, ReachLimits(bodies=0.05))
    assert not near(Parts.only(G1, root=["horizontal", "orientation"]))
    assert near(Parts.only(G1, root=["horizontal", "orientation"]), ReachLimits(turn=0.4))


UPRIGHT = torch.tensor([1.0, 0.0, 0.0, 0.0])


def told(*heights: float, quat: torch.Tensor = UPRIGHT) -> LowestRoot:
    """The lowest of roots at some heights, all of one orientation."""
    pos = torch.tensor([[[0.0, 0.0, height] for height in heights]])
    return LowestRoot.of(pos, quat.expand(1, len(heights), 4))


def at(height: float, quat: torch.Tensor = UPRIGHT) -> TensorDict:
    pos = torch.zeros(1, 14, 3)
    pos[..., 2] = height
    return robots(keypoint_pos_w=pos, keypoint_quat_w=quat.expand(1, 14, 4))


def test_who_is_down():
    limits = ReachLimits()
    assert bool(down(at(0.3), told(0.76), G1, limits))
    assert not bool(down(at(0.3), told(0.3), G1, limits))
    assert not bool(down(at(0.3), told(0.76), G1, ReachLimits(fallen_height=0.2)))


@pytest.mark.parametrize(("ends", "fell"), [((0.3, 0.76), False), ((0.76, 0.3), False), ((0.76, 0.76), True)])
def test_between_a_low_and_a_high_keyframe_a_robot_may_be_low(ends, fell):
    assert bool(down(at(0.39), told(*ends), G1, ReachLimits())) is fell


@pytest.mark.parametrize(("wanted", "fell"), [(0.44, False), (0.46, True)])
def test_who_sags_a_little_from_a_low_keyframe_has_not_fallen(wanted, fell):
    assert bool(down(at(0.39), told(wanted), G1, ReachLimits())) is fell


def test_who_gets_up_from_a_tilt_may_be_tilted():
    lying = torch.tensor([math.sqrt(0.5), 0, math.sqrt(0.5), 0])
    both = LowestRoot.of(torch.full((1, 2, 3), 0.76), torch.stack((lying, UPRIGHT))[None])
    assert not bool(down(at(0.76, lying), both, G1, ReachLimits()))
    assert bool(down(at(0.76, lying), told(0.76), G1, ReachLimits()))


@pytest.mark.parametrize(
    ("height", "g1_lies", "small_lies"), [(0.45, False, False), (0.3, True, False), (0.19, True, True)]
)
def test_what_is_low_for_a_robot_depends_on_how_it_stands(height, g1_lies, small_lies):
    pos, upright = torch.zeros(1, 14, 3), torch.zeros(1, 14, 3)
    pos[..., 2], upright[..., 2] = height, 0.76
    state, reference = robots(keypoint_pos_w=pos), robots(keypoint_pos_w=upright)
    small, hand = replace(G1, name="small", root_height=0.38), mask(Parts.only(G1, bodies=["left_wrist_yaw_link"]))
    for robot, lies in ((G1, g1_lies), (small, small_lies)):
        assert bool(down(state, told(0.76), robot, ReachLimits())) is lies
        assert bool(fallen(state, reference, robot, TerminationLimits(), hand)) is lies
        there = GeneralizedState.unpack(torch.tensor([[0.0, 0.0, height, *[0.0] * 68]]))
        assert bool(Task.failed(SimpleNamespace(robot=robot), there, TensorDict())) is lies
    assert bool(down(state, told(0.76), small, ReachLimits(fallen_height=0.5)))  # in meters for any robot
