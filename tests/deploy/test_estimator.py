from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

import plat
from plat.control import PolicyController, SensorNoise, SimulatedSensors, Simulator
from plat.deploy import EstimatorSettings, StateEstimator
from plat.errors import ConfigError, PlatError, StateError
from plat.keyframes import standing
from plat.robots import G1
from plat.rotations_np import heading_pitch_roll, quat_from_heading_pitch_roll, quat_from_rotvec, quat_to_matrix
from tests.deploy.robots import describe_g1

ROBOT = describe_g1()
STILL = {"gyro": np.zeros(3), "acceleration": np.array([0.0, 0.0, 9.81])}


@cache
def walk() -> tuple[dict[str, np.ndarray], list[tuple]]:
    """A robot that takes a step of 0.35 m and turns by 0.3 rad: means of a second at rest, readings and true states."""
    controller = PolicyController(plat.load("imagined-g1").deployed(), G1)
    simulator = Simulator(G1.model())
    simulator.reset(standing(G1))
    sensors = SimulatedSensors(simulator, SensorNoise(), seed=3)
    rest = [sensors.read() for _ in range(200)]
    still = {name: np.mean([getattr(each, name) for each in rest], 0) for name in ("joint_pos", "gyro", "acceleration")}
    pose = standing(G1)
    goal = replace(pose, root_pos=pose.root_pos + np.array([0.35, 0.0, 0.0]), root_quat=quat_from_rotvec([0, 0, 0.3]))
    record = []
    for step in range(80):
        target = controller(simulator.state(), goal, max(50 - step, 1))
        record.append((sensors.step(target), simulator.state()))
    return still, record


def step_forward() -> list[tuple]:
    return walk()[1]


def follow(estimator: StateEstimator, torque: bool = True):
    """Run an estimator along the step; return its last state and the true one."""
    readings = [reading for readings, _ in step_forward() for reading in readings]
    estimate = estimator.reset(**walk()[0])
    for each in readings:
        estimate = estimator.update(
            each.joint_pos, each.joint_vel, each.gyro, each.acceleration, each.dt, each.torque if torque else None
        )
    return estimate, step_forward()[-1][1]


def errors(estimate, truth) -> tuple[float, float]:
    """Error of the position (m) and angle between the orientations (rad)."""
    off = quat_to_matrix(estimate.root_quat_w) @ quat_to_matrix(truth.root_quat_w).T
    return float(np.linalg.norm(estimate.root_pos_w - truth.root_pos_w)), float(np.arccos((np.trace(off) - 1) / 2))


@pytest.mark.parametrize("torque", [True, False])
def test_a_step_is_followed(torque):
    estimate, truth = follow(StateEstimator(ROBOT), torque)
    assert truth.root_pos_w[0] > 0.25  # it has gone somewhere
    place, turn = errors(estimate, truth)
    assert place < 0.05
    assert turn < 0.05
    assert np.linalg.norm(estimate.root_lin_vel_b - truth.root_lin_vel_b) < 0.1


def test_an_imu_elsewhere_gives_the_same():
    """The readings of an IMU that is turned in the pelvis."""
    quat = quat_from_rotvec([0.3, -0.2, 1.5])
    to_imu = quat_to_matrix(quat).T
    here, turned = StateEstimator(ROBOT), StateEstimator(ROBOT, imu_quat=quat)
    first = step_forward()[0][0][0]
    here.reset(first.joint_pos, first.gyro, STILL["acceleration"])
    turned.reset(first.joint_pos, to_imu @ first.gyro, to_imu @ STILL["acceleration"])
    for readings, _ in step_forward()[:20]:
        for each in readings:
            a = here.update(each.joint_pos, each.joint_vel, each.gyro, each.acceleration, each.dt)
            b = turned.update(each.joint_pos, each.joint_vel, to_imu @ each.gyro, to_imu @ each.acceleration, each.dt)
    for field in ("root_pos_w", "root_lin_vel_b", "root_ang_vel_b"):
        np.testing.assert_allclose(getattr(a, field), getattr(b, field), atol=1e-6)


def test_an_imu_with_a_lever_arm():
    """A robot that turns on the spot: the IMU moves, the root does not."""
    arm = np.array([0.1, 0.0, -0.05])
    estimator = StateEstimator(ROBOT, EstimatorSettings(floor=None), imu_pos=arm)
    estimator.reset(ROBOT.default_joint_pos, **STILL)
    kalman = estimator._filter
    kalman.velocity = np.cross((0.0, 0.0, 2.0), kalman.rotation @ arm)
    rate = np.array([0.0, 0.0, 2.0])
    force = np.cross(rate, np.cross(rate, arm)) + STILL["acceleration"]
    lifted = ROBOT.default_joint_pos.copy()
    estimator._detector = lambda *_: np.zeros(8, dtype=bool)  # in the air
    for _ in range(200):
        state = estimator.update(lifted, np.zeros(29), rate, force, 0.001)
    np.testing.assert_allclose(state.root_pos_w[:2], 0, atol=1e-3)
    np.testing.assert_allclose(state.root_lin_vel_b, 0, atol=5e-3)
    assert abs(heading_pitch_roll(state.root_quat_w)[0] - 0.4) < 1e-6


def test_the_tilt_at_the_start_is_that_of_gravity():
    angles = np.array([0.7, 0.2, -0.1])
    up = quat_to_matrix(quat_from_heading_pitch_roll(angles)).T @ (0, 0, 9.81)
    state = StateEstimator(ROBOT).reset(ROBOT.default_joint_pos, np.zeros(3), up, root_pos_w=(2.0, 3.0), heading=0.7)
    np.testing.assert_allclose(heading_pitch_roll(state.root_quat_w), angles, atol=1e-9)
    np.testing.assert_allclose(state.root_pos_w[:2], [2, 3])


def test_the_world_of_the_keyframes_is_laid_under_the_robot():
    estimator = StateEstimator(ROBOT)
    before, _ = follow(estimator)
    pose = SimpleNamespace(root_pos=np.array([5.0, -2.0, 0.9]), root_quat=quat_from_rotvec([0.0, 0.0, 2.0]))
    estimator.anchor(pose)
    last = step_forward()[-1][0][-1]
    after = estimator.update(last.joint_pos, last.joint_vel, last.gyro, last.acceleration, last.dt, last.torque)
    np.testing.assert_allclose(after.root_pos_w[:2], [5, -2], atol=5e-3)
    assert abs(after.root_pos_w[2] - before.root_pos_w[2]) < 5e-3
    np.testing.assert_allclose(heading_pitch_roll(after.root_quat_w)[0], 2.0, atol=5e-3)
    np.testing.assert_allclose(after.root_lin_vel_b, before.root_lin_vel_b, atol=0.05)


def test_a_measurement_from_outside_takes_the_drift_away():
    estimator = StateEstimator(ROBOT)
    follow(estimator)
    spread = estimator.position_spread
    place = np.array([0.5, 0.1, 0.75])
    for _ in range(20):
        estimator.measure(place, heading=0.35, spread=0.005, heading_spread=0.005)
    last = step_forward()[-1][0][-1]
    after = estimator.update(last.joint_pos, last.joint_vel, last.gyro, last.acceleration, last.dt)
    np.testing.assert_allclose(after.root_pos_w, place, atol=0.02)
    assert abs(heading_pitch_roll(after.root_quat_w)[0] - 0.35) < 0.01
    assert (estimator.position_spread < spread).all()


@pytest.mark.parametrize("turned", [(0.0, 0.0, 1.57), (0.0, 0.52, 0.0), (0.0, 1.05, 0.0), (0.3, 1.57, -0.2)])
def test_a_heading_from_outside_is_that_of_the_root_wherever_the_imu_is(turned):
    found = []
    for quat in (quat_from_rotvec(np.zeros(3)), quat_from_rotvec(np.array(turned))):
        still = {"gyro": np.zeros(3), "acceleration": quat_to_matrix(quat).T @ STILL["acceleration"]}
        estimator = StateEstimator(ROBOT, imu_quat=quat)
        estimator.reset(ROBOT.default_joint_pos, **still, heading=0.3)
        for _ in range(100):
            state = estimator.update(ROBOT.default_joint_pos, np.zeros(29), **still, dt=0.02)
            estimator.measure(heading=0.5, heading_spread=0.01)
        found.append(heading_pitch_roll(state.root_quat_w))
    np.testing.assert_allclose(found[0], (0.5, 0.0, 0.0), atol=0.06)
    np.testing.assert_allclose(found[1], found[0], atol=1e-6)


@pytest.mark.parametrize("spread", [0.0, -0.02, np.nan, np.inf])
def test_a_measurement_without_a_spread_is_refused_and_changes_nothing(spread):
    estimator, untouched = StateEstimator(ROBOT), StateEstimator(ROBOT)
    for each in (estimator, untouched):
        each.reset(ROBOT.default_joint_pos, **STILL)
    with pytest.raises(StateError, match="state estimator: spread is .*, expected a standard deviation above 0"):
        estimator.measure(np.ones(3), heading=1.0, spread=spread)
    with pytest.raises(StateError, match="heading_spread is .*, expected a standard deviation above 0"):
        estimator.measure(np.ones(3), heading=1.0, heading_spread=spread)
    good = {"joint_pos": ROBOT.default_joint_pos, "joint_vel": np.zeros(29), **STILL, "dt": 0.02}
    np.testing.assert_array_equal(estimator.update(**good).root_pos_w, untouched.update(**good).root_pos_w)


def test_feet_on_the_floor_are_told():
    estimator = StateEstimator(ROBOT)
    estimator.reset(ROBOT.default_joint_pos, **STILL)
    assert not estimator.contacts.any()  # nothing was seen yet
    for _ in range(5):
        estimator.update(ROBOT.default_joint_pos, np.zeros(29), **STILL, dt=0.02)
    assert estimator.contacts.tolist() == [True, True]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"joint_pos": np.zeros(3)}, r"joint_pos has shape \(3,\), expected \(29,\)"),
        ({"gyro": np.array([0, np.nan, 0])}, r"gyro\[1\] is nan, expected a finite number"),
        ({"acceleration": np.array([0, 0, 1e300])}, r"acceleration\[2\] is 1e\+300"),
        ({"joint_vel": np.full(29, np.inf)}, r"joint_vel\[0\] is inf"),
        ({"torque": np.zeros(28)}, r"torque has shape \(28,\)"),
        ({"dt": 0.0}, "dt is 0.0, expected seconds above 0 and below 1"),
        ({"dt": np.nan}, "dt is nan"),
        ({"dt": "soon"}, "dt is 'soon', expected seconds"),
        ({"gyro": "none"}, "gyro is 'none', expected 3 numbers"),
        ({"acceleration": None}, r"acceleration has shape \(\), expected \(3,\)"),
    ],
)
def test_readings_that_no_robot_gives_are_refused_and_change_nothing(change, message):
    estimator, untouched = StateEstimator(ROBOT), StateEstimator(ROBOT)
    good = {"joint_pos": ROBOT.default_joint_pos, "joint_vel": np.zeros(29), **STILL, "dt": 0.02}
    for each in (estimator, untouched):
        each.reset(ROBOT.default_joint_pos, **STILL)
    with pytest.raises(StateError, match=f"state estimator: {message}"):
        estimator.update(**{**good, **change})
    np.testing.assert_array_equal(estimator.update(**good).root_pos_w, untouched.update(**good).root_pos_w)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"root_pos_w": (np.nan, 0.0)}, r"root_pos_w is \(nan, 0.0\), expected x and y of the root"),
        ({"root_pos_w": 5}, "root_pos_w is 5, expected x and y"),
        ({"root_pos_w": (1.0,)}, r"root_pos_w is \(1.0,\), expected x and y"),
        ({"heading": np.nan}, "heading is nan, expected a finite angle"),
        ({"heading": None}, "heading is None, expected a finite angle"),
    ],
)
def test_a_start_that_is_no_place(change, message):
    with pytest.raises(StateError, match=f"state estimator: {message}"):
        StateEstimator(ROBOT).reset(ROBOT.default_joint_pos, **STILL, **change)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"imu_pos": (np.nan, 0.0, 0.0)}, r"imu_pos\[0\] is nan, expected a finite number"),
        ({"imu_pos": 0.1}, r"imu_pos has shape \(\), expected \(3,\)"),
        ({"imu_quat": (0.0, 0.0, 0.0, 0.0)}, "imu_quat has length 0, expected a unit quaternion wxyz"),
        ({"settings": {"floor": None}}, "settings is {.*}, expected an EstimatorSettings"),
    ],
)
def test_an_imu_that_is_nowhere(given, message):
    with pytest.raises(PlatError, match=f"state estimator: {message}"):
        StateEstimator(ROBOT, **given)


@pytest.mark.parametrize(
    ("pose", "message"),
    [
        (None, "pose is None, expected a pose, such as the start of a keyframe sequence"),
        (SimpleNamespace(root_pos=np.zeros(2), root_quat=np.eye(4)[0]), r"pose: root_pos has shape \(2,\)"),
        (SimpleNamespace(root_pos=np.zeros(3), root_quat=np.zeros(4)), "pose: root_quat has length 0, expected a unit"),
        (SimpleNamespace(root_pos=np.zeros(3)), r"pose: root_quat has shape \(\), expected \(4,\)"),
    ],
)
def test_an_anchor_that_is_no_pose(pose, message):
    estimator = StateEstimator(ROBOT)
    estimator.reset(ROBOT.default_joint_pos, **STILL)
    with pytest.raises(StateError, match=f"state estimator: {message}"):
        estimator.anchor(pose)


def test_a_slow_turn_is_no_bias_of_a_gyroscope():
    """0.4 rad/s of a robot that turned on its gantry ran away with the heading afterwards."""
    with pytest.raises(StateError, match=r"0.4 rad/s at the IMU, expected a robot that stands still"):
        StateEstimator(ROBOT).reset(ROBOT.default_joint_pos, np.array([0.0, 0.0, 0.4]), STILL["acceleration"])
    StateEstimator(ROBOT).reset(ROBOT.default_joint_pos, np.array([0.05, 0.0, 0.05]), STILL["acceleration"])


def test_a_start_in_free_fall_is_refused():
    with pytest.raises(StateError, match="expected a robot that stands still"):
        StateEstimator(ROBOT).reset(ROBOT.default_joint_pos, np.zeros(3), np.array([0.0, 0.0, 0.3]))


def test_a_robot_that_hangs_does_not_drift_and_swings_as_it_does():
    """No foot bears weight, and the accelerometer is off by 0.05 m/s² along each axis."""
    noise, torque, dt = np.random.default_rng(0).standard_normal, np.zeros(29), 0.005
    held, falling = StateEstimator(ROBOT), StateEstimator(ROBOT)
    force = STILL["acceleration"] + 0.05
    for estimator in (held, falling):
        estimator.reset(ROBOT.default_joint_pos, np.zeros(3), force)
    swung = []
    for step in range(2000):
        turn = 2 * np.pi * 1.0 * step * dt  # once a second
        pull = force + [0.3 * 2 * np.pi * np.cos(turn), 0.0, 0.0] + 0.2 * noise(3)
        reading = (ROBOT.default_joint_pos, np.zeros(29), 0.02 * noise(3), pull, dt, torque)
        alone = falling.update(*reading)
        held.update(*reading)
        state = held.hang(dt)
        swung.append([0.3 * np.sin(turn), state.root_lin_vel_b[0]])
    assert not held.contacts.any()
    assert abs(alone.root_pos_w[2] - ROBOT.root_height) > 0.5
    assert abs(state.root_pos_w[2] - ROBOT.root_height) < 0.05
    true, found = np.array(swung[1000:]).T
    assert np.abs(found - true).max() < 0.15
    with pytest.raises(StateError, match="dt is 0"):
        held.hang(0.0)


def test_settings_are_checked():
    with pytest.raises(ConfigError, match="EstimatorSettings: gate is -1"):
        EstimatorSettings(gate=-1.0)


def test_before_a_reset_nothing_is_estimated():
    estimator = StateEstimator(ROBOT)
    for what, call in {
        "update": lambda: estimator.update(ROBOT.default_joint_pos, np.zeros(29), **STILL, dt=0.02),
        "hang": lambda: estimator.hang(0.02),
        "measure": lambda: estimator.measure(np.ones(3)),
        "anchor": lambda: estimator.anchor(standing(G1)),
    }.items():
        with pytest.raises(StateError, match=rf"{what}\(\) before reset\(\)"):
            call()
