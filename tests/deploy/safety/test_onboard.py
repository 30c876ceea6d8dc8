"""Sensor readings in, motor commands out, whatever the sensors say."""

from dataclasses import replace

import numpy as np
import pytest

from plat.deploy import RobotState, StateEstimator
from plat.deploy.safety import OnboardController, OnboardReading, SafetySettings
from plat.errors import PlatError
from plat.rotations_np import quat_from_rotvec
from tests.deploy.robots import SomePose
from tests.deploy.safety.stand_ins import DT, ROBOT, Commands, StandIn

QUICK = SafetySettings(settle=0.1, ramp=0.2)
PERIOD = 0.005


class Bench:
    """A robot that stands still under a controller, at 200 Hz."""

    def __init__(self, settings=QUICK, answer=None, anchor=None):
        self.policy = StandIn(answer)
        self.controller = OnboardController(self.policy, Commands(), settings, anchor=anchor)
        self.now, self.commands = 0.0, []
        self._random = np.random.default_rng(1)

    def reading(self, **changed) -> OnboardReading:
        noise = self._random.standard_normal
        reading = OnboardReading(
            joint_pos=ROBOT.default_joint_pos + 1e-4 * noise(29),
            joint_vel=0.01 * noise(29),
            gyro=0.01 * noise(3),
            acceleration=np.array([0.0, 0.0, 9.81]) + 0.05 * noise(3),
        )
        return replace(reading, **changed)

    def run(self, seconds: float, **changed) -> "Bench":
        for _ in range(round(seconds / PERIOD)):
            self.step(self.reading(**changed))
        return self

    def step(self, reading: OnboardReading | None):
        command = self.controller.step(self.now, reading)
        if command is not None:
            self.commands.append((self.now, command))
        self.now += PERIOD

    @property
    def pieces(self) -> list[str]:
        return [entry.piece for entry in self.controller.journal]


def test_modes_and_rate():
    bench = Bench().run(0.05)
    assert bench.controller.mode == "settle"
    assert not bench.commands
    bench.run(0.7)
    assert bench.controller.mode == "run"
    times = [time for time, _ in bench.commands]
    np.testing.assert_allclose(np.diff(times), DT)
    assert not bench.pieces
    assert bench.controller.elapsed(bench.now) > 0.2
    assert abs(bench.controller.state.root_pos_w[2] - ROBOT.root_height) < 0.03


@pytest.mark.parametrize(("rate", "jitter"), [(50, 0.0005), (60, 0.0), (200, 0.0003), (200, 0.002), (500, 0.0003)])
def test_the_policy_keeps_its_rate_when_readings_do_not_come_on_time(rate, jitter):
    bench, random = Bench(), np.random.default_rng(0)
    for tick in range(4 * rate):
        bench.now = tick / rate + random.uniform(-jitter, jitter)
        bench.step(bench.reading())
    times = np.array([time for time, _ in bench.commands])
    assert np.diff(times).mean() == pytest.approx(DT, rel=0.01)
    assert np.abs(np.diff(times) - DT).max() < 1 / rate + 2 * jitter


def test_after_a_gap_steps_do_not_come_in_a_row():
    bench = Bench().run(1.0)
    bench.now += 0.1
    first = len(bench.commands)
    bench.run(0.2)
    times = np.array([time for time, _ in bench.commands[first:]])
    np.testing.assert_allclose(np.diff(times), DT)


def test_a_reset_within_a_step_begins_with_settling():
    bench, times = Bench(), []

    def answer(*_):
        times.append(bench.now)
        bench.controller.reset()
        return ROBOT.default_joint_pos

    bench.policy.answer = answer
    bench.run(0.4)
    assert bench.controller.mode == "settle"
    assert bench.controller.state is None
    bench.run(0.4)
    first, second = times
    assert second - first > QUICK.settle + QUICK.ramp - 1e-6


def test_a_stop_before_it_stood_still_is_sent():
    bench = Bench().run(0.05)
    bench.controller.stop()
    bench.run(0.02)
    assert bench.commands
    assert not any(command.stiffness.any() for _, command in bench.commands)


def test_a_stop_after_a_reset_within_one_step_is_sent():
    bench = Bench()

    def answer(*_):
        bench.controller.reset()
        bench.controller.stop()
        return ROBOT.default_joint_pos

    bench.policy.answer = answer
    bench.run(0.5)
    assert bench.controller.mode == "damping"
    assert len(bench.policy.asked) == 1
    assert not bench.commands[-1][1].stiffness.any()
    assert bench.commands[-1][0] > 0.45


@pytest.mark.parametrize("field", ["joint_pos", "joint_vel", "gyro", "acceleration"])
def test_a_sensor_that_is_missing_once_does_not_keep_it_from_settling(field):
    bench = Bench().run(0.05)
    bench.step(bench.reading(**{field: None}))
    bench.run(0.2)
    assert bench.controller.mode == "ramp"
    assert [entry.reason.partition(":")[0] for entry in bench.controller.journal] == [field]


@pytest.mark.parametrize("mode", ["ramp", "run"])
def test_a_robot_that_hangs_until_it_runs_does_not_drift_away(mode):
    """Its feet bear no weight, and its accelerometer is off."""
    settings = replace(QUICK, ramp=6.0 if mode == "ramp" else 0.2)
    bench = Bench(settings)
    while bench.now < 6.0:
        reading = bench.reading(torque=np.zeros(29))
        bench.step(replace(reading, acceleration=reading.acceleration + 0.05))
    assert bench.controller.mode == mode
    state = bench.controller.state
    drift = abs(state.root_pos_w[2] - ROBOT.root_height)
    if mode == "ramp":
        assert drift < 0.03
        assert np.abs(state.root_lin_vel_b).max() < 0.05
    else:
        assert drift > 0.1, "then it may move"


def test_a_robot_that_moves_has_to_come_to_rest():
    bench = Bench()
    while bench.now < 0.5:
        bench.step(bench.reading(gyro=np.array([0.0, 1.0 + 0.1 * bench.now, 0.0])))
    assert bench.controller.mode == "settle"
    assert "sensors" in bench.pieces
    assert "stands still" in next(iter(bench.controller.journal)).reason
    bench.run(0.15)
    assert bench.controller.mode == "ramp"


@pytest.mark.parametrize("field", ["gyro", "joint_pos"])
def test_swinging_about_a_mean_is_no_rest(field):
    bench = Bench()
    for _ in range(100):
        reading = bench.reading()
        swing = 0.5 * np.sin(2 * np.pi * 10 * bench.now)
        bench.step(replace(reading, **{field: getattr(reading, field) + swing}))
    assert bench.controller.mode == "settle"
    assert "it sways by 0.35 rad" in next(iter(bench.controller.journal)).reason
    bench.run(0.25)
    assert bench.controller.mode != "settle"


def test_the_first_step_of_the_policy_is_in_the_world_of_its_keyframes():
    """Not where the estimator began: the keyframe would be far away for one step."""
    quat = quat_from_rotvec(np.array([0.0, 0.0, 2.0]))
    anchor = SomePose(np.concatenate(([5.0, -3.0, ROBOT.root_height], quat, ROBOT.default_joint_pos)))
    bench = Bench(anchor=anchor).run(0.6)
    assert bench.controller.mode == "run"
    for state, *_ in bench.policy.asked:
        np.testing.assert_allclose(state.root_pos_w[:2], [5.0, -3.0], atol=0.02)
        assert abs(state.root_quat_w @ quat) > 0.9999


@pytest.mark.parametrize(
    "broken",
    [
        {"joint_pos": np.full(29, np.nan)},
        {"joint_vel": np.full(29, 1e5)},
        {"gyro": np.array([0.0, np.inf, 0.0])},
        {"gyro": np.array([0.0, 1e3, 0.0])},
        {"acceleration": np.array([0.0, 0.0, 1e5])},
        {"acceleration": np.zeros(2)},
        {"torque": np.full(29, np.nan)},
        {"joint_pos": "nothing"},
        {"joint_pos": None},
        {"gyro": [[1.0], [2.0, 3.0]]},
    ],
)
def test_one_broken_reading_changes_nothing(broken):
    """The estimate goes on, and so does the robot: one number that is none would stay in a filter for ever."""
    bench = Bench().run(0.6)
    before = bench.controller.state.root_pos_w.copy()
    bench.step(bench.reading(**broken))
    bench.run(0.3)
    assert bench.controller.mode == "run"
    assert "sensors" in bench.pieces
    np.testing.assert_allclose(bench.controller.state.root_pos_w, before, atol=0.01)


@pytest.mark.parametrize("kind", ["missing", "nan", "order", "frozen", "gyro", "acceleration"])
def test_readings_that_stay_broken_brake(kind):
    bench = Bench().run(0.6)
    last = bench.reading()
    for _ in range(200):
        if kind == "missing":
            bench.step(None)
        elif kind == "nan":
            bench.step(bench.reading(gyro=np.full(3, np.nan)))
        elif kind in ("gyro", "acceleration"):  # one sensor is dead, the others are not
            bench.step(bench.reading(**{kind: getattr(last, kind)}))
        elif kind == "order":
            bench.controller.step(0.3, bench.reading())
            bench.now += PERIOD
            command = bench.controller.step(bench.now, None)
            if command is not None:
                bench.commands.append((bench.now, command))
        else:
            bench.step(last)
    assert bench.controller.mode == "damping"
    assert not bench.commands[-1][1].stiffness.any()


def test_a_clock_that_goes_back_for_good_brakes():
    bench = Bench().run(0.6)
    bench.now = 0.0
    bench.run(0.4)
    assert bench.controller.mode in ("damping", "run")
    bench.now = -100.0
    bench.run(2.0)
    assert bench.controller.mode == "damping"


def test_a_clock_that_breaks_for_good_brakes():
    bench = Bench().run(0.6)
    bench.now = np.nan
    bench.run(0.3)
    assert bench.controller.mode == "damping"
    assert not bench.commands[-1][1].stiffness.any()


def test_temperatures_reach_the_stops():
    hot = np.full(29, 40.0)
    hot[7] = 95.0
    bench = Bench().run(0.6, temperature=np.full(29, 40.0))
    assert bench.controller.mode == "run"
    bench.run(0.05, temperature=hot)
    assert bench.controller.mode == "damping"
    assert ROBOT.joint_names[7] in list(bench.controller.journal)[-1].reason


def test_stop_and_reset():
    bench = Bench().run(0.6)
    command = bench.controller.stop("a hand on the button")
    assert not command.stiffness.any()
    bench.run(0.1)
    assert bench.controller.mode == "damping"
    bench.controller.reset()
    assert bench.controller.mode == "settle"
    bench.run(0.2)
    assert bench.controller.mode == "ramp"


@pytest.mark.parametrize("within", [False, True])
def test_a_reset_brakes_until_it_stood_still(within):
    """Motors hold what they were told last: without a word they would be stiff while nothing balances."""
    bench = Bench().run(0.6)
    if within:
        bench.policy.answer = lambda *_: bench.controller.reset() or ROBOT.default_joint_pos
        bench.run(DT)
    else:
        bench.controller.reset()
    count = len(bench.commands) - within
    bench.run(0.07)
    assert bench.controller.mode == "settle"
    assert len(bench.commands) - count >= 3
    for _, command in bench.commands[count:]:
        assert not command.stiffness.any()
        np.testing.assert_allclose(command.damping, ROBOT.damping)


def test_a_stop_from_within_a_step_holds():
    bench = Bench().run(0.6)
    bench.policy.answer = lambda *_: bench.controller.stop("smoke").position
    count = len(bench.commands)
    bench.run(0.1)
    assert bench.controller.mode == "damping"
    assert len(bench.policy.asked) < 20
    assert not any(command.stiffness.any() for _, command in bench.commands[count:])


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"anchor": (0.0, 0.0, 0.76)}, r"anchor is \(0.0, 0.0, 0.76\), expected a pose"),
        ({"estimator": 5}, "estimator is 5, expected a StateEstimator"),
        ({"settings": None}, "settings is None, expected a SafetySettings"),
    ],
)
def test_arguments_of_another_kind_are_refused_before_anything_moves(given, message):
    with pytest.raises(PlatError, match=message):
        OnboardController(StandIn(), Commands(), **given)


def test_anchoring_returns_the_state_there():
    estimator = StateEstimator(ROBOT)
    estimator.reset(ROBOT.default_joint_pos, np.zeros(3), np.array([0.0, 0.0, 9.81]))
    pose = SomePose(np.concatenate(([1.0, 2.0, 0.7], [1.0, 0, 0, 0], ROBOT.default_joint_pos)))
    state = estimator.anchor(pose)
    assert isinstance(state, RobotState)
    np.testing.assert_allclose(state.root_pos_w[:2], [1.0, 2.0], atol=1e-9)


def test_hostile_readings_leave_no_target_outside():
    """Anything in any field, in any order of time."""
    random = np.random.default_rng(2)
    bench = Bench(answer=lambda *_: ROBOT.default_joint_pos + random.normal(0, 10.0, 29))
    wild = [np.nan, np.inf, -np.inf, 1e300, -1e6, 0.0, 100.0]
    low, high = ROBOT.joint_range.T
    for step in range(1500):
        reading = bench.reading()
        if step > 100 and random.random() < 0.2:
            field = str(random.choice(["joint_pos", "joint_vel", "gyro", "acceleration"]))
            values = getattr(reading, field).copy()
            values[random.integers(len(values))] = random.choice(wild)
            reading = replace(reading, **{field: values})
        now = bench.now + (random.normal(0, 0.3) if random.random() < 0.05 else 0.0)
        command = bench.controller.step(now, None if random.random() < 0.02 else reading)
        bench.now += PERIOD
        if command is not None:
            assert np.isfinite(command.position).all()
            assert ((command.position >= low) & (command.position <= high)).all()
        if bench.controller.mode == "damping":
            bench.controller.reset()
