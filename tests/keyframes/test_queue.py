import copy
import json
import pickle
from dataclasses import replace

import numpy as np
import pytest

from plat.errors import KeyframeError, PlatError
from plat.keyframes import Keyframe, KeyframeQueue, keyframe_from_json, keyframe_to_json, only, standing
from plat.robots import G1, describe_robot
from plat.spec.timing import Timing


def at(time: float, name: str | None = None):
    return replace(standing(G1).at(time), name=name)


def test_keyframes_are_commanded_in_the_order_of_their_arrivals():
    queue = KeyframeQueue(G1)
    for time in (1.2, 0.4, 0.8):
        assert queue.put(at(time), now=0.0) == "queued"
    seen = [queue.command(0.02 * step) for step in range(61)]
    assert [command.keyframe.time for command in seen[:60:20]] == [0.4, 0.8, 1.2]
    assert [command.steps_left for command in seen[:60]] == [20 - step % 20 for step in range(60)]
    assert [command.index for command in seen[:60:20]] == [0, 1, 2]
    assert seen[60] is None


def test_one_of_the_same_step_is_replaced_and_a_teleoperator_replaces_all():
    queue = KeyframeQueue(G1)
    queue.put(at(0.5, "old"), 0.0)
    queue.put(at(0.504, "new"), 0.0)
    queue.put(at(0.9), 0.0)
    assert len(queue) == 2
    assert queue.command(0.0).keyframe.name == "new"
    queue.put(at(0.7, "only"), 0.1, replace_all=True)
    assert (len(queue), queue.command(0.1).keyframe.name) == (1, "only")


def test_the_clock_of_a_robot_that_is_up_for_a_month():
    queue, now = KeyframeQueue(G1), 30 * 86_400.0
    assert queue.put(at(now + 0.5), now) == "queued"
    assert queue.command(now).steps_left == 25
    queue.stay(standing(G1), now)
    assert queue.command(now).steps_left == 25
    with pytest.raises(KeyframeError, match="time is nan"):
        queue.put(at(float("nan")), now)


@pytest.mark.parametrize(("time", "answer"), [(0.9, "late"), (1.0, "too soon"), (1.005, "too soon"), (70.0, "too far")])
def test_what_cannot_be_reached_changes_nothing(time, answer):
    queue = KeyframeQueue(G1)
    queue.put(at(1.5), 1.0)
    assert queue.put(at(time), 1.0, replace_all=True) == answer
    assert queue.command(1.0).keyframe.time == 1.5


def test_one_that_is_beyond_the_longest_command_waits():
    queue = KeyframeQueue(G1, Timing(max_steps=50))
    queue.put(at(1.5), 0.0)
    assert queue.command(0.0) is None
    assert queue.command(0.5).steps_left == 50


def test_canceling():
    queue = KeyframeQueue(G1)
    queue.put(at(0.5), 0.0)
    queue.put(at(0.9), 0.0)
    assert queue.cancel() == 2
    assert queue.command(0.0) is None
    queue.put(at(0.5), 0.0)
    queue.stay(at(0.0, "here"), now=0.2, seconds=0.1)
    command = queue.command(0.2)
    assert (command.keyframe.name, command.steps_left, len(queue)) == ("here", 5, 1)


@pytest.mark.parametrize("seconds", [0.0, -1.0, 0.01, 0.5, 1.0, 5.0])
def test_a_pose_to_stay_in_is_commanded_at_once_and_in_the_next_step(seconds):
    """Whatever lies between ``now`` and the control steps, and when it is asked for."""
    queue = KeyframeQueue(G1)
    for now in np.arange(0.0, 0.3, 0.003):
        queue.stay(standing(G1), now, seconds)
        assert 1 <= queue.command(now).steps_left <= 50
        assert queue.command(now + 0.02) is not None


def test_a_measured_pose_to_stay_in_may_be_beyond_the_range():
    """By the bias of an encoder."""
    queue, here, knee = KeyframeQueue(G1), standing(G1), G1.joint_names.index("left_knee")
    queue.put(at(0.5), 0.0)
    most = float(G1.joint_range[knee, 1])
    joint_pos = here.joint_pos.copy()
    joint_pos[knee] = most + 0.005
    queue.stay(replace(here, joint_pos=joint_pos, name="here"), now=0.2)
    command = queue.command(0.2)
    assert (command.keyframe.name, len(queue)) == ("here", 1)
    assert command.keyframe.joint_pos[knee] == most
    assert joint_pos[knee] == most + 0.005


@pytest.mark.parametrize(
    "change",
    [
        {"joint_pos": np.zeros(3)},
        {"joint_pos": np.full(29, np.inf)},
        {"joint_pos": 0.0},
        {"joint_pos": ["much"] * 29},
        {"root_pos": np.full(3, np.nan)},
    ],
)
def test_a_cancellation_holds_even_if_its_pose_is_refused(change):
    queue = KeyframeQueue(G1)
    queue.put(at(0.5), 0.0)
    with pytest.raises(KeyframeError, match=next(iter(change))):
        queue.stay(replace(standing(G1), **change), now=0.2)
    assert len(queue) == 0
    assert queue.command(0.2) is None


@pytest.mark.parametrize("now", [10**400, np.nan, "now", None])
def test_a_clock_without_a_time(now):
    queue = KeyframeQueue(G1)
    for asked in (lambda: queue.put(at(0.5), now), lambda: queue.stay(at(0.5), now), lambda: queue.command(now)):
        with pytest.raises(PlatError, match="(now|time) is"):
            asked()


def test_poses_of_another_robot_are_refused():
    with pytest.raises(KeyframeError, match="joint_pos has shape"):
        KeyframeQueue(G1).put(replace(at(0.5), joint_pos=np.zeros(3)), 0.0)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda queue: pickle.loads(pickle.dumps(queue))])
def test_a_copy_is_a_queue_of_its_own(copied):
    queue = KeyframeQueue(G1)
    queue.put(at(0.5), now=0.0)
    other = copied(queue)
    other.put(at(0.2), now=0.0)
    assert (len(queue), len(other)) == (1, 2)
    assert queue.command(0.1).steps_left == 20
    assert other.command(0.1).steps_left == 5


def test_what_is_no_robot_no_timing_or_no_keyframe_is_named():
    with pytest.raises(PlatError, match="robot is 'g1', expected a Robot"):
        KeyframeQueue("g1")
    with pytest.raises(PlatError, match="timing is 0.02, expected a Timing"):
        KeyframeQueue(G1, 0.02)
    queue = KeyframeQueue(G1)
    queue.put(at(0.5), 0.0)
    with pytest.raises(KeyframeError, match="keyframe is None, expected a Keyframe"):
        queue.put(None, 0.0)
    with pytest.raises(KeyframeError, match="pose is None, expected a Keyframe"):
        queue.stay(None, 0.0)
    assert len(queue) == 0


def test_messages_come_back_the_same():
    hands = only(G1, 0.7, left_hand=(0.3, 0.2, 0.9))
    for keyframe in (at(0.5, "named"), hands):
        read = keyframe_from_json(keyframe_to_json(keyframe, G1), G1)
        np.testing.assert_array_equal(read.qpos, keyframe.qpos)
        assert (read.time, read.name, read.commands) == (keyframe.time, keyframe.name, keyframe.commands)
    with pytest.raises(KeyframeError, match="keyframe is 3, expected an object"):
        keyframe_from_json(3, G1)


def test_a_bundles_description_is_robot_enough_for_partial_keyframes():
    ours = only(describe_robot(G1, 0.02), 0.7, bodies={"left_wrist_yaw_link": (0.3, 0.2, 0.9)})
    theirs = only(G1, 0.7, left_hand=(0.3, 0.2, 0.9))
    np.testing.assert_allclose(ours.qpos, theirs.qpos, atol=1e-9)
    assert ours.commands == theirs.commands
    with pytest.raises(KeyframeError, match="left_hand: nothing says which body of 'g1' it is, expected its name"):
        only(describe_robot(G1, 0.02), 0.7, left_hand=(0.3, 0.2, 0.9))


def test_a_message_is_json_whatever_the_numbers_came_as():
    pose = at(0.5)
    numbers = [part.astype(np.float32) for part in (pose.root_pos, pose.root_quat, pose.joint_pos)]
    for keyframe in (Keyframe(np.float32(0.5), *numbers), Keyframe(0.5, *(part.tolist() for part in numbers))):
        read = keyframe_from_json(json.loads(json.dumps(keyframe_to_json(keyframe, G1))), G1)
        np.testing.assert_allclose(read.qpos, pose.qpos, atol=1e-6)
        assert read.time == 0.5
    with pytest.raises(KeyframeError, match="joint_pos has shape"):
        keyframe_to_json(Keyframe(0.5, *numbers[:2], numbers[2][:28]), G1)
