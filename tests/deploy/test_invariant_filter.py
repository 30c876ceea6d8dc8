import numpy as np
import pytest

from plat.deploy.invariant_filter import FilterNoise, InvariantFilter, _exp, _left_jacobian, _log
from plat.rotations_np import quat_from_rotvec, quat_to_matrix

QUIET = FilterNoise(gyro=1e-9, acceleration=1e-9, gyro_bias=0.0, acceleration_bias=0.0, slip=1e-9)


def some_filter(noise: FilterNoise = QUIET) -> InvariantFilter:
    random = np.random.default_rng(0)
    kalman = InvariantFilter(2, noise)
    kalman.reset(quat_to_matrix(quat_from_rotvec([0.2, -0.3, 0.8])), np.array([1.0, -2.0, 0.7]))
    kalman.velocity = np.array([0.5, 0.2, -0.1])
    kalman.contacts = random.normal(size=(2, 3))
    kalman.gyro_bias, kalman.acceleration_bias = random.normal(0, 0.1, (2, 3))
    return kalman


def moved(kalman: InvariantFilter, delta: np.ndarray) -> InvariantFilter:
    """The filter whose state is exp(delta) times that of another."""
    other = some_filter()
    turn, left = _exp(delta[:3]), _left_jacobian(delta[:3])
    other.rotation = turn @ kalman.rotation
    other.velocity = turn @ kalman.velocity + left @ delta[3:6]
    other.position = turn @ kalman.position + left @ delta[6:9]
    other.contacts = kalman.contacts @ turn.T + delta[9:15].reshape(2, 3) @ left.T
    other.gyro_bias, other.acceleration_bias = kalman.gyro_bias + delta[15:18], kalman.acceleration_bias + delta[18:]
    return other


def difference(true: InvariantFilter, estimate: InvariantFilter) -> np.ndarray:
    """The delta with true = exp(delta) estimate."""
    turn = true.rotation @ estimate.rotation.T
    back = np.linalg.inv(_left_jacobian(_log(turn)))
    vectors = [true.velocity - turn @ estimate.velocity, true.position - turn @ estimate.position]
    vectors += list(true.contacts - estimate.contacts @ turn.T)
    biases = (true.gyro_bias - estimate.gyro_bias, true.acceleration_bias - estimate.acceleration_bias)
    return np.concatenate((_log(turn), *(back @ vector for vector in vectors), *biases))


@pytest.mark.parametrize("entry", range(21))
def test_errors_grow_as_the_covariance_says(entry):
    """A covariance of one direction follows two filters that differ in that direction."""
    size = 1e-5
    delta = size * np.eye(21)[entry]
    kalman = some_filter()
    true = moved(kalman, delta)
    kalman.covariance = np.outer(delta, delta)
    gyro, acceleration = np.array([0.3, -0.5, 0.4]), np.array([0.4, 0.9, 9.0])
    for each in (kalman, true):
        each.predict(gyro, acceleration, 0.01)
    after = difference(true, kalman)
    np.testing.assert_allclose(kalman.covariance / size, np.outer(after, after) / size, atol=2e-7 * 10)


def test_the_integral_is_that_of_free_fall():
    kalman = InvariantFilter(1, QUIET)
    kalman.reset(np.eye(3), np.array([0.0, 0.0, 5.0]))
    kalman.velocity = np.array([1.0, 0.0, 2.0])
    for _ in range(100):
        kalman.predict(np.zeros(3), np.zeros(3), 0.005)
    np.testing.assert_allclose(kalman.position, [0.5, 0.0, 5 + 2 * 0.5 - 0.5 * 9.81 * 0.25], atol=1e-9)
    np.testing.assert_allclose(kalman.velocity, [1.0, 0.0, 2 - 9.81 * 0.5], atol=1e-9)


def test_a_point_that_stands_corrects_an_error_that_was_expected():
    """Speed along x that is not there is taken away by a contact that stays where it is."""
    kalman = InvariantFilter(2)
    kalman.reset(np.eye(3), np.array([0.0, 0.0, 0.7]), speed=0.3)
    points, spread = np.array([[0.0, 0.1, -0.7], [0.0, -0.1, -0.7]]), np.tile(1e-6 * np.eye(3), (2, 1, 1))
    kalman.touch(np.array([True, True]), points, spread)
    kalman.velocity = np.array([0.3, 0.0, 0.0])
    for _ in range(50):
        kalman.predict(np.zeros(3), np.array([0, 0, 9.81]), 0.01)
        assert not kalman.stand(np.array([True, True]), points, spread, 30.0).any()
    assert np.abs(kalman.velocity).max() < 0.02
    assert np.abs(kalman.position - (0, 0, 0.7)).max() < 0.01


def test_a_point_that_jumped_is_refused():
    kalman = InvariantFilter(2)
    points, spread = np.array([[0.0, 0.1, -0.7], [0.0, -0.1, -0.7]]), np.tile(1e-6 * np.eye(3), (2, 1, 1))
    both = np.array([True, True])
    kalman.touch(both, points, spread)
    points[1, 0] += 0.2
    assert kalman.stand(both, points, spread, 12.0).tolist() == [False, True]


def test_measurements_from_outside_are_taken():
    kalman = some_filter()
    kalman.reset(kalman.rotation, kalman.position)
    arm, place = np.array([0.1, 0.0, 0.05]), np.array([1.5, -1.8, 0.8])
    for _ in range(5):
        kalman.covariance += 0.01 * np.eye(21)
        kalman.place(arm, place, 1e-8 * np.eye(3))
    np.testing.assert_allclose(kalman.position + kalman.rotation @ arm, place, atol=1e-3)
    for _ in range(5):
        kalman.covariance += np.eye(21)
        kalman.turn_heading(2.9, 1e-4)
    assert abs(np.arctan2(kalman.rotation[1, 0], kalman.rotation[0, 0]) - 2.9) < 1e-3
    goal = quat_to_matrix(quat_from_rotvec([0.1, 0.2, -0.4]))
    kalman.covariance += np.eye(21)
    kalman.turn(goal, 1e-4)
    np.testing.assert_allclose(kalman.rotation, goal, atol=1e-3)


def test_a_filter_at_rest_has_no_velocity_and_keeps_its_place():
    kalman = some_filter()
    kalman.reset(kalman.rotation, kalman.position)
    kalman.velocity = np.array([0.3, -0.2, 0.1])
    place = kalman.position.copy()
    kalman.rest(1e-4)
    np.testing.assert_allclose(kalman.velocity, 0.0, atol=1e-4)
    np.testing.assert_allclose(kalman.position, place, atol=1e-3)


def test_another_world_changes_nothing_but_coordinates():
    """Predicting and correcting in two worlds gives the same state, and the same uncertainty of it."""
    turn, shift = quat_to_matrix(quat_from_rotvec([0, 0, 1.2])), np.array([4.0, -7.0, 0.0])
    here, there = some_filter(FilterNoise()), some_filter(FilterNoise())
    there.change_world(turn, shift)
    points, spread = np.array([[0.0, 0.1, -0.7], [0.0, -0.1, -0.7]]), np.tile(1e-6 * np.eye(3), (2, 1, 1))
    for kalman in (here, there):
        kalman.touch(np.array([True, True]), points, spread)
        for _ in range(10):
            kalman.predict(np.array([0.1, 0.2, -0.3]), np.array([0.3, 0.1, 9.7]), 0.01)
            kalman.stand(np.array([True, True]), points, spread, 1e9)
    here.change_world(turn, shift)
    np.testing.assert_allclose(here.position, there.position, atol=1e-9)
    np.testing.assert_allclose(here.rotation, there.rotation, atol=1e-9)
    np.testing.assert_allclose(here.covariance, there.covariance, atol=1e-9)
