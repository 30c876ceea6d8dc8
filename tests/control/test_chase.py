import math
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from plat.control import Chase, Simulator
from plat.errors import KeyframeError, StateError
from plat.keyframes import KeyframeSequence, only, standing
from plat.robots import G1
from tests.control.puppets import DEFAULT, Limp, Puppet

POSE = standing(G1)


def sequence(*times: float) -> KeyframeSequence:
    return KeyframeSequence(G1, POSE, tuple(POSE.at(time) for time in times))


@pytest.fixture(scope="module")
def simulator() -> Simulator:
    return Simulator(G1.model())


def test_keyframes_are_commanded_one_after_the_other(simulator):
    puppet = Puppet()
    steps = list(Chase(puppet, sequence(0.06, 0.1), simulator))
    assert [step.command.steps_left for step in steps] == [3, 2, 1, 2, 1]
    assert [step.command.index for step in steps] == [0, 0, 0, 1, 1]
    assert [left for _, left in puppet.asked] == [3, 2, 1, 2, 1]
    assert [round(step.time, 9) for step in steps] == [0.02, 0.04, 0.06, 0.08, 0.1]
    assert not any(step.holding for step in steps)
    # what a step leaves is what the next one sees
    np.testing.assert_array_equal(steps[0].after.joint_pos, steps[1].before.joint_pos)
    np.testing.assert_array_equal(steps[0].before.joint_pos, POSE.joint_pos)
    np.testing.assert_array_equal(steps[-1].after.joint_pos, simulator.data.qpos[7:])
    assert steps[2].reference.time == pytest.approx(0.06)


@pytest.mark.parametrize(("hold", "held"), [(0.0, 0), (0.02, 1), (0.1, 5)])
def test_the_last_keyframe_is_held_for_as_long_as_is_asked(simulator, hold, held):
    steps = list(Chase(Puppet(), sequence(0.06), simulator, hold=hold))
    assert [step.holding for step in steps] == [False] * 3 + [True] * held
    assert all((step.command.index, step.command.steps_left) == (0, 1) for step in steps[3:])


@pytest.mark.parametrize("time", [0.051, 0.069])
def test_no_hold_is_none_for_a_time_between_control_steps(simulator, time):
    assert [step.holding for step in Chase(Puppet(), sequence(time), simulator)] == [False] * 3


def test_holding_goes_on_for_ever(simulator):
    assert sum(1 for _ in islice(Chase(Puppet(), sequence(0.06), simulator, hold=math.inf), 200)) == 200


def test_another_controller_takes_over_at_what_the_motors_hold(simulator):
    first, second = Puppet(), Puppet()
    chase = Chase(first, sequence(0.2), simulator)
    told = [step.joint_target for step in islice(chase, 3)]
    chase.controller = second
    rest = list(chase)
    assert len(first.asked) == 3
    assert [left for _, left in second.asked] == [7, 6, 5, 4, 3, 2, 1]
    assert len(rest) == 7
    np.testing.assert_array_equal(second.resets[-1], told[-1])


def test_an_edited_sequence_is_obeyed_from_now_on(simulator):
    puppet = Puppet()
    chase = Chase(puppet, sequence(0.2), simulator)
    list(islice(chase, 4))
    chase.sequence = sequence(0.1, 0.14)
    list(chase)
    assert [left for _, left in puppet.asked] == [10, 9, 8, 7, 1, 2, 1]


def test_restart_makes_the_same_chase_again(simulator):
    puppet = Puppet()
    chase = Chase(puppet, sequence(0.2), simulator)
    first = [step.after.root_pos_w for step in chase]
    simulator.push(np.array([1.0, 0.0, 0.0]))
    chase.restart()
    assert chase.time == 0
    assert puppet.resets == [None, None]
    np.testing.assert_array_equal(first, [step.after.root_pos_w for step in chase])


def test_a_push_between_steps_is_felt(simulator):
    still = [step.after for step in Chase(Limp(), sequence(0.2), simulator)][-1]
    chase = Chase(Limp(), sequence(0.2), simulator)
    next(chase)
    simulator.push(np.array([0.0, 1.0, 0.0]))
    pushed = list(chase)[-1].after
    assert pushed.root_pos_w[1] > still.root_pos_w[1] + 0.05
    assert DEFAULT.shape == pushed.joint_pos.shape


def test_a_start_in_the_floor_is_called_the_start(simulator):
    low = replace(POSE, root_pos=POSE.root_pos - [0, 0, 0.5])
    with pytest.raises(StateError, match="^start: the robot is 50 cm inside the floor"):
        Chase(Puppet(), KeyframeSequence(G1, low, (POSE.at(0.5),)), simulator)


def test_a_policy_for_whole_poses_is_not_given_parts(simulator):
    class Whole(Puppet):
        sees_parts = False

    partial = KeyframeSequence(G1, POSE, (POSE.at(0.1), only(G1, 0.2, root=(0.1, 0.0), name="there")))
    with pytest.raises(KeyframeError, match=r"keyframe at 0.2 s \('there'\) commands a part"):
        Chase(Whole(), partial, simulator)
    chase = Chase(Puppet(), partial, simulator)
    with pytest.raises(KeyframeError, match="commands a part"):
        chase.controller = Whole()
    whole = Chase(Whole(), sequence(0.1), simulator)
    with pytest.raises(KeyframeError, match="commands a part"):
        whole.sequence = partial
