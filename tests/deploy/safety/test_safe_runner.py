import logging
import sys
import threading
from dataclasses import replace

import numpy as np
import pytest

from plat.deploy import PolicyRunner
from plat.deploy.safety import SafeRunner, SafetySettings
from plat.errors import PlatError, StateError
from plat.keyframes import KeyframeQueue, KeyframeSequence, only, standing
from plat.robots import G1
from plat.rotations_np import quat_from_rotvec
from plat.spec.timing import Timing
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


def test_a_program_that_softens_gains_softens_those_of_its_step():
    runner = SafeRunner(StandIn(), Commands(), QUICK)
    for step in range(20):
        now = step * DT
        command = runner.step(now, good_state(1e-3 * step) if step % 4 else None)
        for gains in command[1:]:
            gains *= 0.5
    assert runner.mode == "run"
    command = runner.step(20 * DT, good_state(0.02))
    np.testing.assert_allclose(command.stiffness, G1.stiffness)
    np.testing.assert_allclose(command.damping, G1.damping)


@pytest.mark.parametrize(("period", "told"), [(1.0, 0), (1.1, 0), (1.5, 1), (3.0, 1)])
def test_a_program_that_is_too_slow_is_told(period, told):
    """The policy was trained at its own rate; at a lower one it acts late, and nothing else would say so."""
    runner = SafeRunner(StandIn(), Commands(), SafetySettings(ramp=0.1, missing=1.0))
    for step in range(150):
        runner.step(step * period * DT, good_state(1e-4 * step))
    assert runner.mode == "run"
    assert [entry.piece for entry in runner.journal] == ["clock"] * told
    if told:
        assert next(iter(runner.journal)).reason.endswith("control steps in the last second, expected 50")


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


@pytest.mark.parametrize("state", [object(), "state", 5])
def test_what_is_no_state_is_bridged(state):
    robot = Robot(SafeRunner(StandIn(), Commands(), QUICK))
    robot.run(20)
    assert robot.run(1, lambda _: state) == "run"
    assert list(robot.runner.journal)[-1].reason == "joint_pos is no array of 29 floats"


def test_a_stamp_that_is_no_number_is_bridged():
    robot = Robot(SafeRunner(StandIn(), Commands(), QUICK))
    robot.run(20)
    robot.runner.step(robot.now, robot.state, "noon")
    assert robot.runner.mode == "run"
    assert (
        list(robot.runner.journal)[-1].reason == f"the state's time is 'noon' s, the control step's {robot.now:.6g} s"
    )


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


@pytest.mark.parametrize("error", [RuntimeError("device lost"), KeyError("k"), ZeroDivisionError()])
def test_a_program_of_the_users_own_that_fails_keeps_the_last_target(error):
    def fail(*_):
        raise error

    policy, source = StandIn(), Commands()
    robot = Robot(SafeRunner(policy, source, QUICK))
    robot.run(20)
    before, policy.answer = robot.commands[-1].position, fail
    assert robot.run(1) == "run"
    policy.answer, source.command = lambda *_: before, fail
    assert robot.run(1) == "run"
    np.testing.assert_array_equal([command.position for command in robot.commands[-2:]], [before, before])
    assert all(entry.reason.startswith(f"{type(error).__name__}: ") for entry in robot.runner.journal)


def test_the_run_begins_once_the_hook_of_its_start_succeeds():
    tries = []

    def start(state):
        tries.append(state)
        if len(tries) < 4:
            raise ValueError("no markers yet")

    policy = StandIn()
    robot = Robot(SafeRunner(policy, Commands(), QUICK, on_start=start))
    while len(tries) < 3:
        robot.run(1)
    assert robot.runner.mode == "ramp"
    assert not policy.asked
    np.testing.assert_allclose(robot.commands[-1].position, ROBOT.default_joint_pos, atol=1e-3)
    assert robot.run(3) == "run"
    assert len(tries) == 4
    assert robot.runner.elapsed(robot.now) == pytest.approx(3 * DT)
    assert [entry.reason for entry in robot.runner.journal] == ["ValueError: no markers yet"]


def test_an_emergency_stop_and_a_broken_clock():
    robot = Robot(SafeRunner(StandIn(), Commands(), QUICK))
    robot.run(20)
    before = robot.commands[-1].position
    for now in (float("nan"), 10**400, None):
        command = robot.runner.step(now, good_state())
        np.testing.assert_array_equal(command.position, before)
    robot.runner.stop()
    assert robot.run(2) == "damping"
    assert [entry.piece for entry in robot.runner.journal] == ["clock", "stop"]


def test_a_clock_that_stays_broken_ends_it():
    robot = Robot(SafeRunner(StandIn(), Commands(), QUICK))
    robot.run(20)
    for _ in range(3):  # a time in between begins the count anew
        for _ in range(10):
            command = robot.runner.step(np.nan, good_state())
            assert command.stiffness.all()
        robot.run(1)
    fallen = good_state()  # what a stop would see
    fallen.root_quat_w = quat_from_rotvec([1.5, 0.0, 0.0])
    commands = [robot.runner.step(np.nan, fallen) for _ in range(11)]
    assert [bool(command.stiffness.any()) for command in commands] == [True] * 10 + [False]
    assert robot.runner.mode == "damping"
    assert list(robot.runner.journal)[-1].reason == "time is nan, 11 steps in a row: damping mode"


class Interruption:
    """A call in the middle of a step, as by a signal: before the n-th line that the runner's file executes."""

    def __init__(self, runner: SafeRunner, line: int, call=lambda runner: runner.stop("a hand on the button")):
        self.runner, self.left, self.call = runner, line, call

    @property
    def came(self) -> bool:
        return self.left < 0

    def trace(self, frame, event, argument):
        if frame.f_code.co_filename != sys.modules[SafeRunner.__module__].__file__:
            return None
        if event == "line":
            self.left -= 1
            if self.left == -1:
                self.call(self.runner)
        return self.trace

    def step(self, *arguments):
        return self.during(self.runner.step, *arguments)

    def during(self, method, *arguments):
        before = sys.gettrace()
        sys.settrace(self.trace)
        try:
            return method(*arguments)
        finally:
            sys.settrace(before)


def test_a_stop_holds_wherever_in_a_step_it_comes():
    """At every line: of the wait, the ramp, the start, a broken clock, a missing state, the end, and a new command."""
    times = [0.0, 0.02, 0.04, float("nan"), 0.06, 0.08, 0.10, 0.12]
    missing, commanded, line = 0.06, (0.04, 0.08, 0.12), 0
    while True:
        queue = KeyframeQueue(ROBOT)
        policy = StandIn(lambda *_: ROBOT.default_joint_pos + 9.0)  # the limits tell of it
        hooks = {"temperatures": lambda: np.full(29, 30.0), "on_start": lambda state: state}
        runner = SafeRunner(policy, queue, SafetySettings(ramp=0.02), **hooks)
        button = Interruption(runner, line)
        for index, now in enumerate(times):
            if now in commanded:
                queue.put(standing(ROBOT).at(runner.elapsed(now) + 0.04), runner.elapsed(now), replace_all=True)
            came = button.came
            command = button.step(now, None if now == missing else good_state(1e-4 * index))
            if came or button.came:
                assert runner.mode == "damping", (line, now)
                assert not command.stiffness.any(), (line, now)
        if not button.came:
            break
        assert [entry.piece for entry in runner.journal].count("stop") == 1
        line += 1
    assert line > 100
    assert "end" in [entry.piece for entry in runner.journal]


def test_a_reset_within_a_step_brakes_and_begins_anew():
    """At every line: of the wait, the ramp, the start, the run and damping mode. Before the first it is none within."""
    line = 0
    while True:
        runner = SafeRunner(StandIn(), Commands(), SafetySettings(ramp=0.04))
        hand = Interruption(runner, line, SafeRunner.reset)
        for index, now in enumerate([0.0, 0.02, 0.04, 0.06, 0.08, 0.10]):
            if now == 0.08:
                runner.stop()
            state = good_state(1e-4 * index)
            command = hand.step(now, state)
            if hand.came:
                break
        if not hand.came:
            break
        if runner.mode == "ramp":
            np.testing.assert_allclose(command.position, state.joint_pos, atol=1e-6)
        else:
            assert runner.mode == "wait", (line, now)
            assert not command.stiffness.any(), (line, now)
            command = runner.step(now + 0.02, good_state(0.2))
            assert runner.mode == "ramp"
            np.testing.assert_allclose(command.position, good_state(0.2).joint_pos, atol=1e-6)
        line += 1
    assert line > 50


def test_a_stop_holds_that_comes_within_a_reset():
    """Before its first line it is as if the stop had come before."""
    modes = []
    while True:
        runner = SafeRunner(StandIn(), Commands(), QUICK)
        runner.step(0.0, good_state())
        runner.stop("an older one")
        button = Interruption(runner, len(modes))
        button.during(runner.reset)
        if not button.came:
            break
        runner.step(0.02, good_state(1e-4))
        modes.append(runner.mode)
    assert modes[0] == "ramp"
    assert set(modes[1:]) == {"damping"}


def test_resets_and_stops_of_other_threads():
    switch = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        for _ in range(20):
            runner = SafeRunner(StandIn(), Commands(), QUICK)
            robot, failed = Robot(runner), []

            def walk(robot=robot, failed=failed):
                try:
                    robot.run(40)
                except Exception as error:
                    failed.append(error)

            def press(runner=runner):
                for _ in range(20):
                    runner.reset()
                runner.stop("the last word")

            threads = [threading.Thread(target=work) for work in (walk, press)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            assert not failed
            assert robot.run(2) == "damping"
            assert not robot.commands[-1].stiffness.any()
    finally:
        sys.setswitchinterval(switch)


class Smoke(logging.Handler):
    """A detector that stops the robot from within a piece of the user's own, among them a handler of the log."""

    def __init__(self, place: str):
        super().__init__()
        self.place, self.robot, self.stopped = place, None, None

    def pass_by(self, place: str, value=None):
        if place == self.place:
            if self.stopped is None:
                self.stopped = len(self.robot.commands)
            self.robot.runner.stop("smoke")
        return value

    def emit(self, record):
        self.pass_by("log")


@pytest.mark.parametrize("place", ["temperatures", "on_start", "source", "reset", "policy", "log"])
def test_a_stop_holds_that_a_hook_asks_for(place):
    """The log tells of a target beyond its limits: the last thing in a step."""
    smoke, policy, source = Smoke(place), StandIn(), Commands()
    policy.answer = lambda *_: smoke.pass_by("policy", ROBOT.default_joint_pos + 9.0)
    policy.reset = lambda target: smoke.pass_by("reset")
    command, source.command = source.command, lambda time: smoke.pass_by("source", command(time))
    hooks = {
        "temperatures": lambda: smoke.pass_by("temperatures", np.zeros(29)),
        "on_start": lambda state: smoke.pass_by("on_start", state),
    }
    robot = smoke.robot = Robot(SafeRunner(policy, source, QUICK, **hooks))
    logger = logging.getLogger("plat.deploy.safety")
    logger.addHandler(smoke)
    try:
        assert robot.run(20) == "damping"
    finally:
        logger.removeHandler(smoke)
    assert not any(command.stiffness.any() for command in robot.commands[smoke.stopped :])
    assert [entry.reason for entry in robot.runner.journal if entry.piece == "stop"] == ["smoke: damping mode"]
    smoke.place = "nowhere"
    robot.runner.reset()
    assert robot.run(10) == "run"


def test_the_start_is_told_once():
    seen = []
    robot = Robot(SafeRunner(StandIn(), Commands(), QUICK, on_start=seen.append))
    robot.run(40)
    assert len(seen) == 1


def test_a_runner_of_a_bundle_is_a_policy(bundle):
    robot = Robot(SafeRunner(PolicyRunner(bundle), Commands(), QUICK))
    assert robot.run(20) == "run"


def at(seconds: float, x: float = 0.0):
    pose = standing(ROBOT)
    return replace(pose.at(seconds), root_pos=pose.root_pos + np.array([x, 0.0, 0.0]))


def hand(seconds: float):
    return only(ROBOT, seconds, bodies={"left_wrist_yaw_link": (0.3, 0.2, 0.9)})


class WholePoses(StandIn):
    """A policy that was trained on whole poses."""

    sees_parts = False


@pytest.mark.parametrize(
    ("source", "policy", "message"),
    [
        (KeyframeSequence(ROBOT, at(0.0), (at(3.0),), Timing(max_steps=150)), StandIn,
         r"keyframe 0: time is 3 s, 150 control steps after 0 s, expected at most 50 \(1 s\)"),
        (KeyframeSequence(ROBOT, at(0.0), (at(0.5),), Timing(control_dt=0.01)), StandIn,
         "keyframes: control step of 0.01 s, expected the policy's 0.02 s"),
        (KeyframeSequence(ROBOT, at(0.0), (at(0.5), hand(1.0))), WholePoses,
         "the keyframe at 1 s commands a part of its pose, but this policy was trained on whole poses"),
        (KeyframeQueue(ROBOT, Timing(control_dt=0.01)), StandIn, "keyframes: control step of 0.01 s"),
        (KeyframeQueue(ROBOT, Timing(max_steps=150)), StandIn, "150 control steps, expected at most the policy's 50"),
    ],
)  # fmt: skip
def test_what_the_policy_cannot_follow_is_refused_before_anything_moves(source, policy, message):
    with pytest.raises(PlatError, match=message) as refused:
        SafeRunner(policy(), source, QUICK)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("source", "policy"),
    [
        # for a policy with longer commands, but near enough; and of shorter ones
        (KeyframeSequence(ROBOT, at(0.0), (at(0.9),), Timing(max_steps=150)), StandIn),
        (KeyframeSequence(ROBOT, at(0.0), (at(0.4),), Timing(max_steps=20)), StandIn),
        (KeyframeSequence(ROBOT, at(0.0), (hand(0.9),)), StandIn),
        (KeyframeQueue(ROBOT, Timing(max_steps=20)), WholePoses),
    ],
)
def test_what_it_can_follow_is_taken(source, policy):
    assert SafeRunner(policy(), source, QUICK).mode == "wait"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"policy": None}, "policy is None, expected one with its robot"),
        ({"source": None}, "source is None, expected what commands keyframes"),
        ({"source": [at(0.5)]}, r"source is \[.*\], expected what commands keyframes"),
        ({"settings": {"tilt": 0.8}}, "settings is {'tilt': 0.8}, expected a SafetySettings"),
        ({"start": np.zeros(3)}, r"start has shape \(3,\), expected \(29,\)"),
        ({"start": np.full(29, np.nan)}, r"start\[0\] is nan, expected a finite number"),
        ({"temperatures": 40.0}, "temperatures is 40.0, expected a function"),
        ({"on_start": True}, "on_start is True, expected a function"),
    ],
)
def test_arguments_of_another_kind_are_refused_before_anything_moves(change, message):
    given = {"policy": StandIn(), "source": Commands(), "settings": QUICK}
    with pytest.raises(PlatError, match=message):
        SafeRunner(**{**given, **change})


def test_keyframes_of_another_robot_are_refused_before_anything_moves():
    """Of as many joints in another order it would obey all of them, wrongly."""
    other = replace(ROBOT, name="other", joint_names=ROBOT.joint_names[::-1], joint_range=ROBOT.joint_range[::-1])
    fewer = replace(ROBOT, name="fewer", joint_names=ROBOT.joint_names[:-1])
    for robot, message in (
        (other, "keyframes are of robot 'other', whose joint 0 is 'right_wrist_yaw', expected 'left_hip_pitch' as in"),
        (
            fewer,
            "keyframes are of robot 'fewer', whose joint 28 is None, expected 'right_wrist_yaw' as in",
        ),
    ):
        with pytest.raises(PlatError, match=message):
            SafeRunner(StandIn(), KeyframeQueue(robot), QUICK)
    spelled = replace(ROBOT, joint_names=tuple(f"{name}_joint" for name in ROBOT.joint_names))
    assert SafeRunner(StandIn(), KeyframeQueue(spelled), QUICK).mode == "wait"


def test_commands_that_are_no_parts_are_left_out():
    policy, source = StandIn(), Commands(0.2)
    source.pose.commands = ["left_elbow"]
    robot = Robot(SafeRunner(policy, source, QUICK))
    assert robot.run(6 + 5) == "end"
    reasons = {entry.piece: entry.reason for entry in robot.runner.journal}
    assert reasons["commands"] == "commands is ['left_elbow'], expected plat.spec.parts.Parts or None"


def test_a_partial_keyframe_that_comes_later_is_left_out():
    """As if it had not been given: the robot stands, and obeys the next one."""
    policy, queue = WholePoses(), KeyframeQueue(ROBOT)
    robot = Robot(SafeRunner(policy, queue, QUICK))
    for keyframe in (at(0.2, x=0.1), hand(0.6), at(1.0, x=0.2)):
        assert queue.put(keyframe, 0.0) == "queued"
    assert robot.run(6 + 25) == "end"
    assert robot.run(10) == "run"
    assert {keyframe.root_pos[0] for _, keyframe, _ in policy.asked} == {0.1, 0.2}
    reasons = {entry.piece: entry.reason for entry in robot.runner.journal}
    assert "policy" not in reasons
    assert "the keyframe at 0.6 s commands a part of its pose" in reasons["commands"]


def test_a_command_that_is_too_long_for_the_policy_is_left_out_until_it_is_near():
    class Far:
        """Of a kind that says nothing about its timing."""

        def command(self, time):
            from types import SimpleNamespace

            left = 60 - round(time / DT)
            return SimpleNamespace(keyframe=at(1.2, x=0.3), steps_left=left) if left > 0 else None

    policy = StandIn()
    robot = Robot(SafeRunner(policy, Far(), QUICK))
    assert robot.run(6 + 5) == "end"
    assert robot.run(10) == "run"
    assert [steps for *_, steps in policy.asked if steps > 5] == list(range(50, 44, -1))
    assert "commands" in [entry.piece for entry in robot.runner.journal]


def test_nothing_is_commanded_and_it_stands_where_it_is():
    """Not at the origin, nor at once."""
    policy = StandIn()
    robot = Robot(SafeRunner(policy, KeyframeQueue(ROBOT), replace(QUICK, stand=0.2)))
    quat = quat_from_rotvec([0, 0, 1.2])
    robot.state = replace(robot.state, root_pos_w=np.array([3.0, 2.0, ROBOT.root_height]), root_quat_w=quat)
    assert robot.run(20) == "end"
    assert [steps for *_, steps in policy.asked][:12] == [*range(10, 0, -1), 1, 1]
    for _, pose, _ in policy.asked:
        np.testing.assert_allclose(pose.root_pos, [3.0, 2.0, ROBOT.root_height])
        np.testing.assert_allclose(pose.root_quat, quat, atol=1e-12)


def test_a_canceled_keyframe_is_not_chased():
    policy, queue = StandIn(), KeyframeQueue(ROBOT)
    robot = Robot(SafeRunner(policy, queue, QUICK))
    queue.put(at(0.8, x=2.0), 0.0)
    robot.run(15)
    queue.cancel()
    policy.asked.clear()
    robot.state = replace(robot.state, root_pos_w=np.array([0.5, 0.0, ROBOT.root_height]))
    assert robot.run(20) == "end"
    assert {pose.root_pos[0] for _, pose, _ in policy.asked} == {0.5}
    assert policy.asked[0][2] == 5
