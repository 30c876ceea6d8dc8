import numpy as np
import pytest

from plat.motions.retargeting.planted_feet import contact_weight, hold, lift


def test_contact_needs_a_foot_that_is_low_and_slow():
    fps = 50.0
    moving = np.column_stack((np.arange(10) / fps, np.zeros((10, 2))))
    assert (contact_weight(np.zeros(10), np.zeros((10, 3)), fps) == 1).all()
    assert (contact_weight(np.full(10, 0.1), np.zeros((10, 3)), fps) == 0).all()
    assert (contact_weight(np.zeros(10), moving, fps) == 0).all()


@pytest.mark.parametrize("fps", [30.0, 60.0, 120.0, 240.0])
def test_a_foot_that_trembles_by_a_millimeter_stands_at_any_frame_rate(fps):
    """From frame to frame it moves at 0.3 m/s at 240 Hz: a foot that stood was taken as one in the air."""
    tremble = np.random.default_rng(0).normal(0, 0.001, size=(240, 3))
    assert contact_weight(np.zeros(240), tremble, fps).min() > 0.9


def test_a_free_path_is_left_alone():
    path = np.random.default_rng(0).normal(size=(40, 2)).cumsum(0)
    np.testing.assert_allclose(hold(path, np.zeros(40), 30.0), path, atol=1e-9)


def test_steps_that_slide_stand_still_and_the_swing_between_is_kept():
    fps, time = 30.0, np.arange(90) / 30.0
    # steps of 0.5 m; the foot slides 3 cm in each stance
    weight = ((time % 1.0) < 0.6).astype(float)
    path = 0.5 * np.floor(time) + np.where(weight > 0, 0.05 * (time % 1.0), 0.03 + (time % 1.0 - 0.6) * 1.175)
    held = hold(path[:, None], weight, fps)[:, 0]
    stance = np.minimum(weight[1:], weight[:-1]) > 0
    assert abs(np.diff(path)[stance]).max() > 1e-3
    assert abs(np.diff(held)[stance]).max() < 2e-5
    assert abs(held - path).max() < 0.03
    assert abs(np.diff(held) - np.diff(path))[~stance].max() < 0.01


def test_a_lift_is_enough_everywhere_and_has_no_jumps():
    depth = np.random.default_rng(0).normal(size=200).cumsum() * 0.002
    raised = lift(depth, 30.0)
    assert (raised >= depth.clip(0) - 1e-12).all()
    assert abs(np.diff(raised)).max() < abs(np.diff(depth.clip(0))).max() + 1e-12
    assert (lift(np.full(50, -0.01), 30.0) == 0).all()
