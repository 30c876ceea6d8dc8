"""Each piece of the last line of defense by itself."""

import logging
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from plat.deploy.safety import EndOfSequence, Journal, Ramp, SafetySettings, StateWatch, TargetLimiter, stop_reason
from plat.errors import ConfigError
from plat.rotations_np import quat_from_rotvec
from plat.spec.parts import Parts
from tests.deploy.safety.stand_ins import DT, ROBOT, Commands, good_state

LOW, HIGH = ROBOT.joint_range.T


def free() -> SafetySettings:
    """Limits that do not bind, to try one at a time."""
    return SafetySettings(rate=1e6)


class TestLimiter:
    def test_what_is_within_passes_unchanged(self):
        limiter = TargetLimiter(ROBOT)
        target = ROBOT.default_joint_pos + 0.05
        limited, reasons = limiter(target, good_state(), DT)
        np.testing.assert_array_equal(limited, target)
        assert reasons == {}

    def test_range_with_a_margin(self):
        limiter = TargetLimiter(ROBOT, replace(free(), range_margin=0.1))
        limited, reasons = limiter(np.where(np.arange(29) % 2, 9.0, -9.0), None, DT)
        np.testing.assert_allclose(limited, np.where(np.arange(29) % 2, HIGH - 0.1, LOW + 0.1))
        assert "left_hip_pitch and 28 more: target -9 rad, is outside its range" in reasons["range"]

    def test_a_margin_wider_than_the_range_leaves_its_middle(self):
        limited, _ = TargetLimiter(ROBOT, replace(free(), range_margin=50.0))(np.zeros(29), None, DT)
        np.testing.assert_allclose(limited, 0.5 * (LOW + HIGH))

    def test_torque(self):
        state = good_state()
        state.joint_vel = np.full(29, 2.0)
        limiter = TargetLimiter(ROBOT, replace(free(), torque=0.5))
        limited, reasons = limiter(ROBOT.default_joint_pos + 3.0, state, DT)
        asked = ROBOT.stiffness * (limited - state.joint_pos) - ROBOT.damping * state.joint_vel
        inside = limited < HIGH - 1e-9
        np.testing.assert_allclose(asked[inside], 0.5 * ROBOT.effort_limit[inside])
        assert inside.sum() > 15
        assert "torque" in reasons

    def test_rate(self):
        limiter = TargetLimiter(ROBOT, SafetySettings(rate=2.0))
        target = ROBOT.default_joint_pos + 0.3
        steps = [limiter(target, None, DT) for _ in range(8)]
        moved = np.array([limited - ROBOT.default_joint_pos for limited, _ in steps]).max(1)
        np.testing.assert_allclose(moved, np.minimum(0.04 * np.arange(1, 9), 0.3))
        assert ["rate" in reasons for _, reasons in steps] == [True] * 7 + [False]

    def test_time_that_goes_back_moves_nothing(self):
        limited, _ = TargetLimiter(ROBOT)(ROBOT.default_joint_pos + 1, None, -1.0)
        np.testing.assert_array_equal(limited, ROBOT.default_joint_pos)

    @pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
    def test_what_is_not_finite_stays(self, bad):
        limiter = TargetLimiter(ROBOT)
        target = ROBOT.default_joint_pos + 0.01
        target[3] = bad
        limited, reasons = limiter(target, good_state(), DT)
        assert limited[3] == ROBOT.default_joint_pos[3]
        assert limited[4] == target[4]
        assert reasons["finite"].startswith("left_knee: target")

    def test_a_wrong_number_of_targets(self):
        limited, reasons = TargetLimiter(ROBOT)(np.zeros(3), None, DT)
        np.testing.assert_array_equal(limited, ROBOT.default_joint_pos)
        assert reasons["finite"] == "targets of shape (3,), expected (29,)"

    @pytest.mark.parametrize("targets", ["abc", [[1.0], [1.0, 2.0]], {}])
    def test_what_is_no_numbers(self, targets):
        limited, reasons = TargetLimiter(ROBOT)(targets, None, DT)
        np.testing.assert_array_equal(limited, ROBOT.default_joint_pos)
        assert reasons["finite"] == f"targets {targets!r}, which are no numbers, expected (29,)"

    def test_a_motor_without_stiffness(self):
        limiter = TargetLimiter(replace(ROBOT, stiffness=np.zeros(29)))
        assert np.isfinite(limiter(ROBOT.default_joint_pos + 0.1, good_state(), DT)[0]).all()


class TestWatch:
    def check(self, *states, settings=SafetySettings(), stamps=None):  # noqa: B008
        watch = StateWatch(ROBOT, settings)
        times = [1.0 + DT * step for step in range(len(states))]
        stamps = stamps or times
        return [watch.check(*each) for each in zip(times, states, stamps, strict=True)], watch

    def test_good_states(self):
        verdicts, watch = self.check(*(good_state(0.01 * step) for step in range(20)))
        assert verdicts == [None] * 20
        assert watch.bad_share == 0
        assert watch.age(1.0 + 19 * DT + 0.5) == pytest.approx(0.5)

    @pytest.mark.parametrize(
        ("change", "reason"),
        [
            ({"joint_pos": np.full(29, np.nan)}, "joint_pos is not finite"),
            ({"joint_vel": np.zeros(28)}, "joint_vel is no array of 29 floats"),
            ({"joint_vel": [0.0] * 29}, "joint_vel is no array of 29 floats"),
            ({"joint_pos": np.full(29, 9.0)}, "left_hip_pitch at 9 rad, far outside its range"),
            ({"joint_vel": np.full(29, 99.0)}, "joint_vel of 99, at most 60 is plausible"),
            ({"root_quat_w": np.zeros(4)}, "root_quat_w is no unit quaternion"),
            ({"root_quat_w": np.full(4, 1e300)}, "root_quat_w is no unit quaternion"),
            ({"root_lin_vel_b": np.array([0, 20.0, 0])}, "root_lin_vel_b of 20, at most 15 is plausible"),
            ({"root_ang_vel_b": np.array([0, 0, -50.0])}, "root_ang_vel_b of 50, at most 40 is plausible"),
        ],
    )
    def test_what_no_robot_measures(self, change, reason):
        verdicts, _ = self.check(replace(good_state(), **change))
        assert verdicts == [reason]

    def test_a_jump(self):
        jumped = good_state()
        jumped.joint_pos[3] += 1.3  # the knee, within its range
        verdicts, _ = self.check(good_state(), jumped)
        assert verdicts == [None, "a joint jumped by 1.3 rad in 0.02 s"]

    def test_a_jump_in_a_state_that_is_filled_anew(self):
        state, watch = good_state(), StateWatch(ROBOT)
        assert watch.check(1.0, state) is None
        state.joint_pos[3] += 1.3
        assert watch.check(1.0 + DT, state) == "a joint jumped by 1.3 rad in 0.02 s"

    def test_no_state(self):
        assert self.check(None)[0] == ["no state"]

    def test_frozen_sensors(self):
        verdicts, watch = self.check(*[good_state()] * 8, settings=SafetySettings(frozen=3))
        assert verdicts[:2] == [None, None]
        assert verdicts[2] == "the same numbers 3 times: frozen sensors"
        assert all(verdicts[2:])
        assert watch.check(9.0, good_state(0.01)) is None  # it moves again

    def test_order_and_age(self):
        states = [good_state(0.01 * step) for step in range(4)]
        verdicts, _ = self.check(*states, stamps=[1.0, 0.99, 1.0, 1.06])
        assert verdicts[0] is None
        assert "came after" in verdicts[1]
        assert "came after" in verdicts[2]
        assert verdicts[3] is None
        assert "is 3 s old" in self.check(good_state(), stamps=[-2.0])[0][0]
        assert "the state's time is 9 s" in self.check(good_state(), stamps=[9.0])[0][0]
        assert self.check(good_state(), stamps=[np.nan])[0][0]

    def test_the_share_of_bad_states(self):
        states = [None if step % 4 == 0 else good_state(0.001 * step) for step in range(40)]
        assert self.check(*states)[1].bad_share == pytest.approx(0.25)


class TestStops:
    def test_tilt(self):
        tilted = replace(good_state(), root_quat_w=quat_from_rotvec([0.9, 0, 0]))
        assert stop_reason(ROBOT, tilted) is None
        assert stop_reason(ROBOT, tilted, SafetySettings(tilt=0.8))[0] == "tilt"

    def test_height(self):
        low = replace(good_state(), root_pos_w=np.array([0, 0, 0.25]))
        assert stop_reason(ROBOT, low) == ("height", "root 0.25 m above the floor, at least 0.3")
        small = replace(ROBOT, root_height=0.38)
        assert stop_reason(small, low) is None
        lower = replace(low, root_pos_w=np.array([0, 0, 0.14]))
        assert stop_reason(small, lower) == ("height", "root 0.14 m above the floor, at least 0.15")
        assert stop_reason(small, low, SafetySettings(height=0.3))[0] == "height"  # in meters for any robot

    def test_temperature(self):
        hot = np.full(29, 40.0)
        assert stop_reason(ROBOT, good_state(), temperatures=hot) is None
        hot[3], hot[5] = 95.0, np.nan
        assert stop_reason(ROBOT, good_state(), temperatures=hot) == (
            "temperature",
            "left_knee at 95 °C, at most 90",
        )


def test_a_ramp_begins_and_ends_at_rest():
    ramp = Ramp(np.zeros(2), np.array([1.0, -2.0]), 2.0)
    np.testing.assert_allclose([ramp(-1.0), ramp(0.0), ramp(1.0), ramp(2.0), ramp(9.0)],
                               [[0, 0], [0, 0], [0.5, -1], [1, -2], [1, -2]], atol=1e-12)  # fmt: skip
    assert np.abs(ramp(0.02)).max() < 1e-3


def test_the_end_of_a_sequence_is_held_and_then_it_stands():
    source = Commands(0.1, joint_pos=ROBOT.default_joint_pos + 0.1)
    source.pose.root_pos = np.array([2.0, 1.0, 0.6])
    source.pose.root_quat = quat_from_rotvec([0, 0, 1.5])
    commands = EndOfSequence(source, ROBOT, max_steps=50, settings=SafetySettings(hold=0.1, stand=0.2))
    seen = [commands.command(step * DT) for step in range(25)]
    assert [command.steps_left for command in seen] == [5, 4, 3, 2, 1, *[1] * 5, *range(10, 0, -1), *[1] * 5]
    assert all(command.keyframe is source.pose for command in seen[:10])
    last = seen[-1].keyframe
    np.testing.assert_allclose(last.root_pos, [2, 1, ROBOT.root_height])
    np.testing.assert_allclose(last.root_quat, quat_from_rotvec([0, 0, 1.5]), atol=1e-12)
    np.testing.assert_array_equal(last.joint_pos, ROBOT.default_joint_pos)


@pytest.mark.parametrize(
    ("root", "body"),
    [
        ((), "left_wrist_yaw_link"),
        ((), "pelvis"),  # a body among others, and the root
        (("horizontal",), "left_wrist_yaw_link"),
        (("orientation",), "left_wrist_yaw_link"),
        (("horizontal", "height", "orientation"), "left_wrist_yaw_link"),
    ],
)
def test_what_of_the_root_was_not_commanded_is_where_the_robot_is(root, body):
    """Wherever the keyframe happens to draw it."""
    source = Commands(0.04)
    source.pose.root_pos, source.pose.root_quat = np.array([1.5, 0.5, 0.7]), quat_from_rotvec([0, 0, 1.0])
    source.pose.commands = Parts.only(ROBOT, bodies=[body], root=root)
    commands = EndOfSequence(source, ROBOT, max_steps=50, settings=SafetySettings(hold=0.04, stand=0.1))
    state = good_state()
    for step in range(10):
        # it goes on moving until it is to stand
        state.root_pos_w = np.array([2.0 + 0.1 * min(step, 4), 1.0, 0.74])
        state.root_quat_w = quat_from_rotvec([0.0, 0.0, -0.5])
        pose = commands.command(step * DT, state).keyframe
    place = [1.5, 0.5] if "horizontal" in root or body == "pelvis" else [2.4, 1.0]
    np.testing.assert_allclose(pose.root_pos, [*place, ROBOT.root_height])
    heading = 1.0 if "orientation" in root else -0.5
    np.testing.assert_allclose(pose.root_quat, quat_from_rotvec([0, 0, heading]), atol=1e-12)


def test_a_source_that_goes_on_is_obeyed_again():
    commands = [None, SimpleNamespace(keyframe=good_pose(), steps_left=7)]
    source = SimpleNamespace(command=lambda time: commands[int(time)])
    ending = EndOfSequence(source, ROBOT, 50)
    assert ending.command(0.0).steps_left == 50  # there is nothing to hold: it stands, and not at once
    assert ending.ended
    assert ending.command(1.0).steps_left == 7
    assert not ending.ended


def good_pose():
    return Commands().pose


def test_steps_in_a_row_are_one_entry(caplog):
    journal = Journal(gap=0.1, size=3)
    with caplog.at_level(logging.WARNING, logger="plat.deploy.safety"):
        for time in (0.0, 0.05, 0.1, 1.0):
            journal.note(time, "rate", f"at {time}")
        journal.note(1.0, "tilt", "over")
    assert [(entry.piece, entry.reason, entry.first, entry.last, entry.steps) for entry in journal] == [
        ("rate", "at 0.0", 0.0, 0.1, 3),
        ("rate", "at 1.0", 1.0, 1.0, 1),
        ("tilt", "over", 1.0, 1.0, 1),
    ]
    assert [record.message for record in caplog.records] == [
        "0.00 s: rate: at 0.0",
        "1.00 s: rate: at 1.0",
        "1.00 s: tilt: over",
    ]
    for time in range(2, 9):
        journal.note(10.0 * time, "rate", "more")
    assert len(journal) == 3


def test_settings_are_checked():
    with pytest.raises(ConfigError, match="SafetySettings: torque is 0"):
        SafetySettings(torque=0.0)
