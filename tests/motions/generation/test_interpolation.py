import numpy as np

from plat.motions.generation.interpolation import fade, minimum_jerk, moves, quintic


def test_minimum_jerk_starts_and_stops_gently():
    progress = np.linspace(0, 1, 1001)
    value = minimum_jerk(progress)
    speed = np.gradient(value, progress)
    assert abs(speed[[0, -1]]).max() < 1e-2
    assert abs(speed.max() - 1.875) < 1e-3  # the known peak of the curve
    assert (np.diff(value) >= 0).all()


def test_changes_that_overlap_add_up():
    time = np.linspace(0, 3, 31)
    both = moves(time, 0.5, [(0.0, 2.0, 1.0), (1.0, 2.0, -3.0)])
    apart = moves(time, 0.5, [(0.0, 2.0, 1.0)]) + moves(time, 0.0, [(1.0, 2.0, -3.0)])
    np.testing.assert_allclose(both, apart)
    assert both[-1] == -1.5


def test_fade_is_soft_inside_and_nothing_outside():
    time = np.linspace(0, 4, 401)
    weight = fade(time, 1.0, 3.0, 0.5)
    assert (weight[(time <= 1) | (time >= 3)] == 0).all()
    assert (weight[(time >= 1.5) & (time <= 2.5)] == 1).all()
    assert np.abs(np.diff(weight)).max() < 0.05


def test_knots_of_free_fall_are_joined_by_a_parabola():
    time = np.linspace(0.5, 0.7, 21)
    height = quintic(time, [(0.0, 0.0, 0.0, 0.0), (0.5, 0.1, 0.981, -9.81), (0.7, 0.1, -0.981, -9.81)])
    fallen = 0.1 + 0.981 * (time - 0.5) - 9.81 / 2 * (time - 0.5) ** 2
    np.testing.assert_allclose(height, fallen, atol=1e-12)


def test_quintics_pass_their_knots_smoothly_and_stay_outside():
    knots = [(0.2, 1.0, 0.0, 0.0), (1.0, 2.0, -1.0, 3.0), (1.5, 0.5, 0.0, 0.0)]
    time = np.linspace(0, 2, 20001)
    value = quintic(time, knots)
    assert value[0] == 1.0
    assert value[-1] == 0.5
    np.testing.assert_allclose([value[2000], value[10000], value[15000]], [1.0, 2.0, 0.5], atol=1e-9)
    speed = np.gradient(value, time)
    assert abs(speed[10000] + 1.0) < 1e-3
    assert np.abs(np.diff(speed)).max() < 5e-3  # no kink
