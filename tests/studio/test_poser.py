from pathlib import Path

import numpy as np
import pytest
import torch

from plat.errors import RobotError
from plat.robots import G1, get_robot
from plat.rotations import quat_angle, quat_from_rotvec, quat_multiply

pytest.importorskip("mink", reason="the extra plat-rl[studio] is not installed")

from plat.studio.poser import HANDLES, WHOLE, Frame, Poser
from plat.studio.poses import Floor

POSER = Poser(G1)
POSE = G1.default_qpos
FEET = ("left foot", "right foot")


def hold(*handles: str) -> dict[str, Frame]:
    return {handle: POSER.frames(POSE)[handle] for handle in handles}


def shifted(handle: str, *by: float) -> Frame:
    frame = POSER.frames(POSE)[handle]
    return Frame(frame.pos + by, frame.quat)


def off(qpos: np.ndarray, handle: str, target: Frame) -> float:
    return float(np.linalg.norm(POSER.frames(qpos)[handle].pos - target.pos))


@pytest.mark.parametrize(
    ("handle", "by"),
    [
        ("pelvis", (0.05, 0.03, -0.1)),
        ("left hand", (0.1, 0.05, 0.3)),
        ("right hand", (0.05, -0.1, 0.25)),
        ("left foot", (0.2, 0.05, 0.15)),
        ("right foot", (0.1, -0.1, 0.2)),
    ],
)
def test_a_handle_follows_and_held_ones_stay(handle: str, by: tuple[float, float, float]):
    target, held = shifted(handle, *by), hold("pelvis", *FEET)
    qpos = POSER.dragged(POSE, handle, target, held)
    assert off(qpos, handle, target) < 0.01
    for other, frame in held.items():
        if other != handle:
            assert off(qpos, other, frame) < 0.005, other


def test_orientation_follows():
    frame = POSER.frames(POSE)["pelvis"]
    turn = quat_from_rotvec(torch.tensor([0.0, 0.2, 0.1], dtype=torch.float64))
    target = Frame(frame.pos - [0, 0, 0.05], quat_multiply(turn, torch.from_numpy(frame.quat)).numpy())
    qpos = POSER.dragged(POSE, "pelvis", target, hold(*FEET))
    assert quat_angle(*(torch.from_numpy(quat) for quat in (qpos[3:7], target.quat))) < 0.03


@pytest.mark.parametrize("handle", HANDLES)
def test_targets_out_of_reach_stretch_the_limb_and_leave_the_stance_alone(handle: str):
    qpos = POSER.dragged(POSE, handle, shifted(handle, 2.0, 0.5, 1.0), hold("pelvis", *FEET))
    low, high = G1.joint_range.double().numpy().T
    assert (qpos[7:] >= low).all()
    assert (qpos[7:] <= high).all()
    for foot in FEET:
        if foot != handle:
            assert off(qpos, foot, POSER.frames(POSE)[foot]) < 0.03


def test_the_whole_robot_is_moved_and_turned_as_it_is():
    spot = POSER.frames(POSE)[WHOLE]
    assert spot.pos[2] == 0.0
    turn = torch.tensor([np.cos(0.25), 0.0, 0.0, np.sin(0.25)], dtype=torch.float64)  # by 0.5 rad about the vertical
    quat = quat_multiply(turn, torch.from_numpy(spot.quat)).numpy()
    target = Frame(np.add(spot.pos, [1.0, -0.5, 0.0]), quat)
    qpos = POSER.dragged(POSE, WHOLE, target, hold(*FEET), POSE)
    np.testing.assert_array_equal(qpos[7:], POSE[7:])
    there = POSER.frames(qpos)
    np.testing.assert_allclose(there[WHOLE].pos, target.pos, atol=1e-9)
    np.testing.assert_allclose(there[WHOLE].quat, target.quat, atol=1e-9)
    assert qpos[2] == POSE[2]
    again = POSER.dragged(qpos, WHOLE, target, {}, POSE)
    np.testing.assert_allclose(again, qpos, atol=1e-12)


def test_a_drag_there_and_back_ends_where_it_began():
    qpos, held = POSE, hold("pelvis", *FEET)
    for share in [*np.linspace(0, 1, 8), *np.linspace(1, 0, 8)]:
        qpos = POSER.dragged(qpos, "left hand", shifted("left hand", 0.6 * share, 0.2 * share, 0.5 * share), held, POSE)
    np.testing.assert_allclose(qpos, POSE, atol=5e-3)


def test_a_pose_beyond_its_limits_can_be_dragged():
    qpos = POSE.copy()
    qpos[7 + G1.joint_names.index("left_knee")] = 3.5
    assert np.isfinite(POSER.dragged(qpos, "right hand", shifted("right hand", 0.1, 0.0, 0.1), {})).all()


def test_feet_become_flat_on_the_floor():
    qpos = POSE.copy()
    qpos[2] -= 0.04
    qpos[7 + G1.joint_names.index("left_ankle_pitch")] += 0.3
    qpos[7 + G1.joint_names.index("right_ankle_roll")] += 0.2
    flat = POSER.flat(qpos)
    np.testing.assert_allclose(flat[:3], qpos[:3], atol=0.01)
    assert Floor(G1).clearance(flat) == pytest.approx(0.0, abs=2e-3)
    for foot in FEET:
        quat = POSER.frames(flat)[foot].quat
        assert np.abs(quat[1:3]).max() < 5e-3, "level"


def test_a_robot_that_the_studio_cannot_pose_is_told_so():
    toy = get_robot(Path(__file__).parents[1] / "robots" / "toy.json")
    with pytest.raises(RobotError, match="robot 'toy': the studio needs the bodies of the G1, and it lacks"):
        Poser(toy)
