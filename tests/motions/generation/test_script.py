import numpy as np
import pytest

from plat.motions.generation.script import LEFT, RIGHT, SOLE_CENTER, MotionScript

STANCE = np.array([[0.0, 0.1, 0.0], [0.0, -0.1, 0.0]])


@pytest.fixture
def script() -> MotionScript:
    return MotionScript(STANCE, {"left_elbow": 0.6})


def test_rest_takes_everything_back(script):
    script.move({"left_elbow": 1.0, "waist_yaw": 0.5}, 0.5)
    script.wait(0.5)
    script.rest(0.5)
    script.wait(0.5)
    draft = script.draft(0.02)
    assert draft.channels["left_elbow"][25] == pytest.approx(1.0)
    assert draft.channels["waist_yaw"][25] == pytest.approx(0.5)
    assert draft.channels["left_elbow"][-1] == pytest.approx(0.6)
    assert draft.channels["waist_yaw"][-1] == pytest.approx(0.0)


def test_shift_is_relative_to_rest(script):
    script.shift({"left_elbow": -0.1}, 0.5)
    script.shift({"left_elbow": 0.1}, 0.5, delay=0.5)
    script.wait(1.0)
    np.testing.assert_allclose(script.draft(0.5).channels["left_elbow"], [0.6, 0.5, 0.7])


def test_a_step_moves_one_foot_over_the_floor(script):
    script.wait(0.2)
    script.step(RIGHT, np.array([0.3, -0.15, 0.2]), 0.5, 0.05, delay=0.1)
    script.wait(1.0)
    draft = script.draft(0.02)
    np.testing.assert_allclose(draft.foot_pos[:, LEFT], np.tile([0.0, 0.1, 0.0], (61, 1)))
    np.testing.assert_allclose(draft.foot_pos[-1, RIGHT], [0.3, -0.15, 0.0], atol=1e-9)
    assert draft.foot_yaw[-1, RIGHT] == pytest.approx(0.2)
    assert draft.foot_pos[:, RIGHT, 2].max() == pytest.approx(0.05, abs=1e-3)
    assert (draft.foot_pos[:15, RIGHT] == draft.foot_pos[0, RIGHT]).all()
    np.testing.assert_allclose(script.feet[RIGHT], [0.3, -0.15, 0.2])


def test_offsets_go_along_the_foots_own_heading():
    turned = MotionScript(np.array([[0.0, 0.0, np.pi / 2], [0.2, 0.0, np.pi / 2]]), {})
    turned.move({"left_foot_forward": 0.1, "left_foot_sideways": 0.03, "left_foot_up": 0.2}, 0.5)
    turned.wait(0.5)
    np.testing.assert_allclose(turned.draft(0.5).foot_pos[-1, LEFT], [-0.03, 0.1, 0.2], atol=1e-9)


def test_weight_stays_until_it_is_moved(script):
    np.testing.assert_allclose(script.under(0.5), [SOLE_CENTER, 0.0])
    script.wait(1.0)
    script.weigh(script.under(1.0, 0.02), 0.5, delay=0.5)
    script.wait(2.0)
    zmp = script.draft(0.25).zmp
    np.testing.assert_allclose(zmp[:7], np.tile([SOLE_CENTER, 0.0], (7, 1)))
    np.testing.assert_allclose(zmp[7], [SOLE_CENTER + 0.01, -0.05])
    np.testing.assert_allclose(zmp[8:], np.tile([SOLE_CENTER + 0.02, -0.1], (5, 1)))


def test_arms_follow_the_other_foot(script):
    script.step(LEFT, np.array([0.3, 0.1, 0.0]), 1.0, 0.05)
    script.wait(3.0)
    script.swing_arms(0.5, begin=0.0)
    channels = script.draft(0.02).channels
    # the left foot is ahead: the right arm swings forward (negative pitch), the left one back
    assert channels["left_shoulder_pitch"][75] == pytest.approx(0.15)
    assert channels["right_shoulder_pitch"][75] == pytest.approx(-0.15)


def test_waves_fade(script):
    script.wave("waist_roll", 0.2, 2.0, 2.0)
    script.wait(2.0)
    wave = script.draft(0.02).channels["waist_roll"]
    assert abs(wave[[0, -1]]).max() < 1e-9
    assert abs(wave).max() == pytest.approx(0.2, rel=0.05)
