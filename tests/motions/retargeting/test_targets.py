from dataclasses import replace

import numpy as np
import pytest

from plat.motions.retargeting import builtin_maps, read_bvh
from plat.motions.retargeting.geometry import RobotGeometry
from plat.motions.retargeting.human import Human, read_human
from plat.motions.retargeting.targets import Targets, robot_targets
from plat.robots import G1
from plat.rotations_np import axis_rotation

from .human import write_human

LAFAN1 = next(skeleton for skeleton in builtin_maps() if skeleton.name == "lafan1")
ROBOT = RobotGeometry.of(G1)


def make(tmp_path, **arguments) -> tuple[Human, Targets]:
    bvh = read_bvh(write_human(tmp_path / "a.bvh", **arguments))
    human = read_human(bvh, LAFAN1, "a.bvh")
    return human, robot_targets(human, LAFAN1, ROBOT, bvh.fps)


def angle(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arccos((a @ b) / np.linalg.norm(a) / np.linalg.norm(b))))


def test_arms_keep_their_direction_and_take_the_robots_length(tmp_path):
    human, targets = make(tmp_path, turns={"LeftArm": (20, 60, 0), "LeftForeArm": (50, 0, 0)})
    for frame in (0, 15):
        reach = targets.positions["left_wrist"][frame] - targets.positions["left_elbow"][frame]
        expected = human.positions["left_wrist"][frame] - human.positions["left_elbow"][frame]
        assert np.linalg.norm(reach) == pytest.approx(ROBOT.forearm)
        assert angle(reach, expected) < 1e-3


def test_feet_stand_flat_on_the_ground_and_do_not_move(tmp_path):
    _, targets = make(tmp_path, turns={"Spine": (40, 0, 0)})
    for side in ("left_ankle", "right_ankle"):
        assert (targets.contact[side] == 1).all()
        np.testing.assert_allclose(targets.positions[side][:, 2], ROBOT.ankle_height, atol=1e-6)
        np.testing.assert_allclose(targets.rotations[side][:, 2, 2], 1, atol=1e-6)
        assert np.ptp(targets.positions[side], axis=0).max() < 1e-4
    width = targets.positions["left_ankle"] - targets.positions["right_ankle"]
    assert (np.linalg.norm(width[:, :2], axis=1) > 0.2).all()


@pytest.mark.parametrize("turn", [60, 120, 360])
def test_a_foot_that_pivots_on_its_toe_turns_with_the_body(tmp_path, turn):
    """Held at its mean yaw, it pointed 60 degrees elsewhere before and after a turn by 120, and nothing said so."""
    human, _ = make(tmp_path, frames=90)
    share = np.clip((np.arange(90) - 30) / 30, 0, 1)
    turned = axis_rotation(2, np.deg2rad(turn) * share**2 * (3 - 2 * share))
    toe = human.positions["left_toe"]
    positions = {role: toe + (turned @ (place - toe)[..., None])[..., 0] for role, place in human.positions.items()}
    rotations = {role: turned @ rotation for role, rotation in human.rotations.items()}
    targets = robot_targets(replace(human, positions=positions, rotations=rotations), LAFAN1, ROBOT, 30.0)
    forward = (np.swapaxes(targets.rotations["pelvis"], 1, 2) @ targets.rotations["left_ankle"])[:, :2, 0]
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    assert np.degrees(np.arccos((forward @ forward[0]).clip(-1, 1))).max() < 4
    tip = targets.positions["left_ankle"] + targets.rotations["left_ankle"] @ [ROBOT.sole[:, 0].max(), 0, 0]
    assert np.ptp(tip[:, :2], axis=0).max() < 2e-3


def test_who_stands_on_the_hands_is_not_below_the_floor(tmp_path):
    """Feet that are never low were taken for the ground: the pelvis of a handstand was 0.7 m below it."""
    human, _ = make(tmp_path, turns={"LeftArm": (0, 170, 0), "RightArm": (0, -170, 0)}, frames=31)
    raised = {role: place[15:16].repeat(9, 0) @ np.diag([1.0, -1, -1]) for role, place in human.positions.items()}
    lowest = min(place[:, 2].min() for place in raised.values())
    positions = {role: place + np.array([0, 0, 0.05 - lowest]) for role, place in raised.items()}
    rotations = {role: np.diag([1.0, -1, -1]) @ rotation[:9] for role, rotation in human.rotations.items()}
    upside_down = replace(human, positions=positions, rotations=rotations)
    targets = robot_targets(upside_down, LAFAN1, ROBOT, 30.0)
    height = ROBOT.leg / human.leg * positions["hips"][0, 2]
    assert height - 0.3 < targets.positions["pelvis"][0, 2] < height
    assert max(targets.contact[role].max() for role in targets.contact) == 0


def test_a_lifted_foot_keeps_its_clearance_in_proportion(tmp_path):
    human, targets = make(tmp_path, turns={"LeftUpLeg": (60, 0, 0), "LeftLeg": (-60, 0, 0)})
    lift = np.ptp(human.positions["left_ankle"][:, 2])
    lowest = (targets.rotations["left_ankle"] @ ROBOT.sole.T)[:, 2].min(1) + targets.positions["left_ankle"][:, 2]
    assert targets.contact["left_ankle"][15] == 0
    assert lowest.max() == pytest.approx(lift * ROBOT.leg / human.leg, rel=0.1)
    assert lowest.min() == pytest.approx(0, abs=1e-6)


def test_upright_is_upright_and_a_bow_is_a_bow(tmp_path):
    _, targets = make(tmp_path, turns={"Spine": (40, 0, 0)})
    for role in ("pelvis", "torso"):
        assert angle(targets.rotations[role][0][:, 2], np.array([0, 0, 1])) < 1
    frame = targets.rotations["torso"][15]
    assert angle(frame[:, 2], np.array([0, 0, 1])) == pytest.approx(40, abs=1)
    assert frame[2, 0] < -0.6, "the chest looks down"


def test_a_pointed_foot_does_not_turn_about_itself(tmp_path):
    # at -75 the foot would lie in line with the shin, where shin and foot span no plane
    turns = {"LeftUpLeg": (50, 0, 0), "LeftLeg": (-50, 0, 0), "LeftFoot": (-74, 0, 0)}
    _, targets = make(tmp_path, turns=turns, frames=60)
    left = targets.rotations["left_ankle"][:, :, 1]
    assert (left @ left[0] > 0.95).all()


def test_an_arm_that_is_up_came_up_in_front(tmp_path):
    _, targets = make(tmp_path, turns={"LeftArm": (0, 160, 0)})
    pitch, roll = targets.posture["left_shoulder_pitch"], targets.posture["left_shoulder_roll"]
    assert abs(pitch[0]) < 0.2
    assert pitch[15] == pytest.approx(-np.pi, abs=0.3)
    assert (abs(roll) < np.pi / 2 + 1e-6).all()
