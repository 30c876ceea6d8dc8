from dataclasses import replace

import numpy as np
import pytest

from plat.deploy import PolicyRunner
from plat.deploy.safety import SafeRunner, SafetySettings
from plat.errors import StateError
from plat.rotations_np import quat_from_rotvec
from tests.deploy.safety.stand_ins import DT, ROBOT, Commands, StandIn, good_state

QUICK = SafetySettings(ramp=0.1, hold=0.1, stand=0.1)


class Robot:
    """A robot that is where it was told to be, and trembles so that its sensors are not frozen."""

    def __init__(self, runner: SafeRunner):
        self.runner, self.now, self.state, self.steps = runner, 0.0, good_state(), 0
        self.commands: list = []

    def run(self, steps: int, change=lambda state: state) -> str:
        for _ in range(steps):
            self.steps += 1
            moved = self.state.joint_pos if not self.commands else self.commands[-1].position
            state = replace(self.state, joint_pos=moved + 1e-4 * (self.steps % 2))
            self.commands.append(self.runner.step(self.now, change(state)))
            self.now += DT
        return self.runner.mode


def test_from_the_ramp_to_standing():
    policy, source = StandIn(), Commands(0.4, ROBOT.default_joint_pos + 0.05)
    robot = Robot(SafeRunner(policy, source, QUICK))
    robot.state = good_state(0.2)
    assert robot.run(5) == "ramp"
    np.testing.assert_allclose(robot.commands[0].position, ROBOT.default_joint_pos + 0.2, atol=1e-3)
    assert policy.asked == []
    assert robot.run(5) == "run"
    np.testing.assert_array_equal(robot.commands[-1].position, ROBOT.default_joint_pos + 0.05)
    assert robot.run(25) == "end"
    np.testing.assert_array_equal(robot.commands[-1].position, ROBOT.default_joint_pos)
    assert [entry.piece for entry in robot.runner.journal] == ["end"]
    assert all((command.stiffness == ROBOT.stiffness).all() for command in robot.commands)


def test_it_waits_for_a_state_with_damped_motors():
    robot = Robot(SafeRunner(StandIn(), Commands(), QUICK))
    assert robot.run(3, lambda state: None) == "wait"
    assert not robot.commands[-1].stiffness.any()
    assert (robot.commands[-1].damping == ROBOT.damping).all()
    assert robot.run(2) == "ramp"


def test_a_missing_state_is_bridged_and_many_end_it():
    robot = Robot(SafeRunner(StandIn(), Commands(), QUICK))
    robot.run(20)
    before = robot.commands[-1].position
    assert robot.run(3, lambda state: None) == "run"
    np.testing.assert_array_equal(robot.commands[-1].position, before)
    assert robot.run(30) == "run"
    assert robot.run(15, lambda state: None) == "damping"
    assert not robot.commands[-1].stiffness.any()
    assert robot.run(30) == "damping"  # good states alone do not start it again
    robot.runner.reset()
    assert robot.run(1) == "ramp"


def test_every_second_state_is_bad():
    robot = Robot(SafeRunner(StandIn(), Commands(), replace(QUICK, doubt=0.3)))
    robot.run(20)
    bad = iter(range(1000))
    assert robot.run(60, lambda state: None if next(bad) % 2 else state) == "damping"
    assert "% of the last second's states are bad" in [entry.reason for entry in robot.runner.journal][-1]


@pytest.mark.parametrize(
    ("change", "piece"),
    [
        ({"root_quat_w": quat_from_rotvec([1.3, 0, 0])}, "tilt"),
        ({"root_pos_w": np.array([0, 0, 0.1])}, "height"),
    ],
)
def test_a_fall_ends_it(change, piece):
    robot = Robot(SafeRunner(StandIn(), Commands(), QUICK))
    robot.run(20)
    assert robot.run(1, lambda state: replace(state, **change)) == "damping"
    assert [entry.piece for entry in robot.runner.journal] == [piece]


def test_hot_motors_end_it_and_a_broken_thermometer_does_not():
    temperatures = [np.full(29, 30.0)]
    runner = SafeRunner(StandIn(), Commands(), QUICK, temperatures=lambda: temperatures[0])
    robot = Robot(runner)
    assert robot.run(20) == "run"
    temperatures.clear()
    assert robot.run(5) == "run"
    assert [entry.piece for entry in runner.journal] == ["temperature"]
    temperatures.append(np.full(29, 120.0))
    assert robot.run(1) == "damping"


def test_a_policy_that_fails_keeps_the_last_target():
    def fail(*_):
        raise StateError("no")

    policy = StandIn()
    robot = Robot(SafeRunner(policy, Commands(), QUICK))
    robot.run(20)
    before, policy.answer = robot.commands[-1].position, fail
    robot.run(1)
    np.testing.assert_array_equal(robot.commands[-1].position, before)
    assert [(entry.piece, entry.reason) for entry in robot.runner.journal] == [("policy", "no")]


def test_an_emergency_stop_and_a_broken_clock():
    robot = Robot(SafeRunner(StandIn(), Commands(), QUICK))
    robot.run(20)
    before = robot.commands[-1].position
    command = robot.runner.step(float("nan"), good_state())
    np.testing.assert_array_equal(command.position, before)
    robot.runner.stop()
    assert robot.run(2) == "damping"
    assert [entry.piece for entry in robot.runner.journal] == ["clock", "stop"]


def test_the_start_is_told_once():
    seen = []
    robot = Robot(SafeRunner(StandIn(), Commands(), QUICK, on_start=seen.append))
    robot.run(40)
    assert len(seen) == 1


def test_a_runner_of_a_bundle_is_a_policy(bundle):
    robot = Robot(SafeRunner(PolicyRunner(bundle), Commands(), QUICK))
    assert robot.run(20) == "run"
