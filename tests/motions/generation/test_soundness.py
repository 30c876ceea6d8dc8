import numpy as np
import pytest

from plat.motions.generation import soundness
from plat.motions.generation.soundness import SoundnessLimits, measure_soundness, speed_limits
from plat.robots import G1

DT = 0.02


@pytest.fixture
def standing() -> np.ndarray:
    qpos = np.tile(G1.default_qpos, (60, 1))
    qpos[:, 2] -= 0.0033  # the default pose is a little above the floor
    return qpos


def joint(name: str) -> int:
    return 7 + G1.joint_names.index(name)


def test_standing_is_sound(standing):
    found = measure_soundness(G1, standing, DT)
    assert found.faults() == []
    assert found.slip == 0
    assert found.balanced == 1


def test_slip_is_how_far_a_foot_slides(standing):
    standing[:, 0] += 0.3 * np.arange(60) * DT  # a centimeter and more in all
    found = measure_soundness(G1, standing, DT)
    assert found.slip == pytest.approx(0.3 * 59 * DT, abs=1e-3)
    assert any(fault.startswith("slip") for fault in found.faults())


def test_a_foot_in_the_air_may_move(standing):
    standing[:, 2] += 0.05
    standing[:, 0] += 0.3 * np.arange(60) * DT
    assert measure_soundness(G1, standing, DT).slip == 0


def test_penetration(standing):
    lowest = measure_soundness(G1, standing, DT).penetration
    standing[30, 2] -= 0.02
    assert measure_soundness(G1, standing, DT).penetration == pytest.approx(lowest + 0.02, abs=4e-3)


def test_a_leaning_robot_is_out_of_balance(standing):
    standing[:, joint("waist_roll")] = 0.5
    standing[:, joint("waist_pitch")] = 0.5
    standing[:, joint("left_shoulder_pitch")] = standing[:, joint("right_shoulder_pitch")] = -1.5
    assert measure_soundness(G1, standing, DT).balanced == 1.0  # still over the feet
    for ankle in ("left_ankle_pitch", "right_ankle_pitch"):
        standing[:, joint(ankle)] -= 0.25
    turn = 0.25 / 2
    standing[:, 3], standing[:, 5] = np.cos(turn), np.sin(turn)  # the whole body leans forward over flat feet
    assert measure_soundness(G1, standing, DT).balanced < 0.5


def test_joint_range_and_speed(standing):
    knee = joint("left_knee")
    high = float(G1.joint_range[knee - 7, 1])
    standing[30:, knee] = high + 0.1
    found = measure_soundness(G1, standing, DT)
    assert found.joint_excess == pytest.approx(0.1, abs=1e-4)
    assert found.speed == pytest.approx((high + 0.1 - G1.default_qpos[knee]) / DT / 20.0, rel=1e-4)
    assert {fault.split()[0] for fault in found.faults()} >= {"joint_excess", "speed"}


def test_an_arm_in_the_trunk_is_found(standing):
    standing[30, joint("left_shoulder_roll")] = -1.2
    assert measure_soundness(G1, standing, DT).self_penetration > 0.01


def test_speed_limits_go_by_motor():
    limits = dict(zip(G1.joint_names, speed_limits(G1), strict=True))
    assert limits["left_knee"] == limits["right_hip_roll"] == 20.0
    assert limits["waist_yaw"] == limits["left_hip_pitch"] == 32.0
    assert limits["left_ankle_roll"] == limits["right_elbow"] == 37.0
    assert limits["left_wrist_yaw"] == 22.0


def test_limits_are_the_callers(standing):
    standing[30, joint("left_elbow")] += 0.05
    found = measure_soundness(G1, standing, DT)
    assert found.faults() == []
    assert len(found.faults(SoundnessLimits(speed=0.01))) == 1


def test_support_margin_of_a_triangle():
    points = np.array([[[0, 0, 0], [1, 0, 0]], [[0, 1, 0], [5, 5, 0]]], dtype=float)[None].repeat(2, 0)
    down = np.array([[[True, True], [True, False]]]).repeat(2, 0)
    margin = soundness.support_margin(points, down, np.array([[0.25, 0.25], [1.0, 1.0]]))
    np.testing.assert_allclose(margin, [0.25, -np.sqrt(0.5)])


def test_a_robot_that_falls_freely_is_sound_in_flight_and_one_that_hangs_is_not(standing):
    time = np.arange(60) * DT
    hanging = standing.copy()
    hanging[10:50, 2] += 0.2
    assert measure_soundness(G1, hanging, DT).falling == pytest.approx(9.81, abs=0.01)
    jumping = standing.copy()
    jumping[:, 2] += np.where((time > 0.2) & (time < 0.6), 9.81 / 2 * (time - 0.2) * (0.6 - time), 0.0)
    assert measure_soundness(G1, jumping, DT).falling < 1e-6
