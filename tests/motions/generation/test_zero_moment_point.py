import numpy as np
import pytest

from plat.motions.generation.zero_moment_point import (
    InvertedPendulum,
    VaryingPendulum,
    ground_reaction,
    zero_moment_point,
    zmp_of,
)
from plat.robots import G1

MASS_HEIGHT = 0.67


def test_the_pendulums_zero_moment_point_is_the_wanted_one():
    time = np.arange(200) * 0.02
    zmp = np.stack((0.1 * np.tanh(4 * (time - 2)), 0.05 * np.sin(3 * time)), -1)
    com = InvertedPendulum(200, MASS_HEIGHT, 0.02).com(zmp)
    acceleration = (com[2:] - 2 * com[1:-1] + com[:-2]) / 0.02**2
    np.testing.assert_allclose(com[1:-1] - MASS_HEIGHT / 9.81 * acceleration, zmp[1:-1], atol=1e-9)
    # it leans into a change before the change comes
    assert com[90, 0] > zmp[90, 0]


def test_a_robot_at_rest_has_it_below_its_center_of_mass():
    zmp = zero_moment_point(G1.model(), np.tile(G1.default_qpos, (5, 1)), 0.02)
    np.testing.assert_allclose(zmp, np.tile(zmp[:1], (5, 1)), atol=1e-9)
    assert abs(zmp[0, 1]) < 2e-3
    assert -0.02 < zmp[0, 0] < 0.05


@pytest.mark.parametrize("axis", [0, 1])
def test_an_accelerated_robot_has_it_behind(axis):
    acceleration, time = 1.0, np.arange(11) * 0.02
    still = np.tile(G1.default_qpos, (11, 1))
    moving = still.copy()
    moving[:, axis] += 0.5 * acceleration * time**2
    model = G1.model()
    com_height = 0.668
    change = zero_moment_point(model, moving, 0.02) - zero_moment_point(model, still, 0.02)
    expected = 0.5 * acceleration * time[5] ** 2 - com_height / 9.81 * acceleration
    assert change[5, axis] == pytest.approx(expected, abs=1e-3)
    assert change[5, 1 - axis] == pytest.approx(0, abs=1e-3)


def test_spinning_arms_push_it():
    # both arms speed up backward: the trunk is pushed the other way, and the zero-moment point with it
    time = np.arange(11) * 0.02
    swing = np.tile(G1.default_qpos, (11, 1))
    for side in ("left", "right"):
        swing[:, 7 + G1.joint_names.index(f"{side}_shoulder_pitch")] += 0.5 * 20 * time**2
    model = G1.model()
    still = zero_moment_point(model, np.tile(G1.default_qpos, (11, 1)), 0.02)
    assert abs(zero_moment_point(model, swing, 0.02) - still)[3, 0] > 0.01


def test_the_model_is_left_as_it_was():
    model = G1.model()
    flags = int(model.opt.disableflags)
    zero_moment_point(model, np.tile(G1.default_qpos, (3, 1)), 0.02)
    assert model.opt.disableflags == flags


def test_at_constant_height_the_varying_pendulum_is_the_plain_one():
    zmp = np.random.default_rng(0).normal(size=(80, 2))
    plain = InvertedPendulum(80, MASS_HEIGHT, 0.02).com(zmp)
    np.testing.assert_allclose(VaryingPendulum(np.full(80, MASS_HEIGHT), 0.02).com(zmp), plain, atol=1e-9)


def test_in_flight_the_varying_pendulum_goes_straight_on():
    time = np.arange(60) * 0.02
    height = 0.7 + np.where((time >= 0.4) & (time <= 0.8), 0.5 * 9.81 * (time - 0.4) * (0.8 - time), 0.0)
    zmp = np.stack((np.where(time < 0.6, 0.0, 0.5), np.zeros(60)), -1)
    pendulum = VaryingPendulum(height, 0.02)
    com = pendulum.com(zmp)
    flight = slice(22, 39)
    np.testing.assert_allclose(pendulum.load[flight], 0.0, atol=1e-9)
    np.testing.assert_allclose(np.diff(com[flight, 0], n=2), 0.0, atol=1e-9)
    assert com[40, 0] > com[20, 0]


def test_a_falling_robot_needs_no_ground():
    time = np.arange(11) * 0.02
    qpos = np.tile(G1.default_qpos, (11, 1))
    qpos[:, 2] += 1.0 - 9.81 / 2 * time**2
    model = G1.model()
    force, moment = ground_reaction(model, qpos, 0.02)
    np.testing.assert_allclose(force[1:-1], 0.0, atol=1e-6)
    assert np.isfinite(zmp_of(force, moment, qpos, least=10.0)).all()
