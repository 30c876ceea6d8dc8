import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from plat.errors import KeyframeError, PlatError
from plat.keyframes import Keyframe, KeyframeSequence, interpolate, long_intervals, split_long_intervals, standing
from plat.motions import MotionLibrary, generate_motions
from plat.robots import G1

POSE = standing(G1)


def sequence(*times: float) -> KeyframeSequence:
    return KeyframeSequence(G1, POSE, tuple(POSE.at(time) for time in times))


@pytest.fixture(scope="module")
def clip():
    return generate_motions("val", seconds=8, families=("walk",))[0]


def test_commands_follow_each_other_and_count_down():
    arms = sequence(0.06, 0.10)
    seen = [arms.command(step * 0.02) for step in range(6)]
    assert [(c.index, c.steps_left, c.length) for c in seen[:5]] == [
        (0, 3, 3),
        (0, 2, 3),
        (0, 1, 3),
        (1, 2, 2),
        (1, 1, 2),
    ]
    assert seen[5] is None
    assert arms.command(0.05).steps_left == 1  # to the nearest control step
    assert arms.command(-1.0).steps_left == 3


def test_every_step_has_a_command_that_the_policy_knows():
    steps = sequence(0.9, 1.02, 2.0)
    for step in range(steps.arrival_steps[-1]):
        assert 1 <= steps.command(step * 0.02).steps_left <= 50


def test_sample_passes_through_every_keyframe_and_stays_at_both_ends(clip):
    walk = KeyframeSequence.from_motion(clip, [0.5, 1.0, 1.5], G1)
    for keyframe in (walk.start, *walk.keyframes):
        np.testing.assert_allclose(walk.sample(keyframe.time).qpos, keyframe.qpos, atol=1e-12)
    np.testing.assert_array_equal(walk.sample(9.0).qpos, walk.keyframes[-1].qpos)
    np.testing.assert_array_equal(walk.sample(-1.0).qpos, walk.start.qpos)
    between = walk.sample(0.75)
    assert between.time == 0.75
    np.testing.assert_allclose(between.joint_pos, (walk.keyframes[0].joint_pos + walk.keyframes[1].joint_pos) / 2)


def test_a_keyframe_between_control_steps_is_where_its_arrival_is(clip):
    """At 0.51 s it arrives with step 26; what is sampled there was already on the way to the next one."""
    away = replace(POSE, root_pos=POSE.root_pos + np.array([1.0, 0.0, 0.0]))
    frames = (away.at(0.51), POSE.at(1.01), away.at(1.49))
    steps = KeyframeSequence(G1, POSE, frames)
    for keyframe, step in zip(frames, steps.arrival_steps, strict=True):
        for pose in (steps.sample(step * 0.02), steps.commanded(step * 0.02)):
            np.testing.assert_allclose(pose.qpos, keyframe.qpos, atol=1e-12)
    np.testing.assert_allclose(steps.on_the_way(1, steps.began(1, POSE), 0.52).root_pos, away.root_pos)
    assert steps.sample(0.5).root_pos[0] == pytest.approx(25 / 26)


def test_poses_of_a_motion_are_those_of_the_library(clip):
    library = MotionLibrary.from_clips([clip])
    frames = [0, 25, 41, 88]
    poses = library.poses(torch.tensor(frames))
    walk = KeyframeSequence.from_motion(clip, [0.5, 0.82, 1.76], G1)
    for row, keyframe in enumerate((walk.start, *walk.keyframes)):
        assert keyframe.time == pytest.approx(frames[row] * 0.02)
        np.testing.assert_allclose(keyframe.root_pos, poses["keypoint_pos"][row, 0], atol=1e-6)
        np.testing.assert_allclose(keyframe.root_quat, poses["keypoint_quat"][row, 0], atol=1e-6)
        np.testing.assert_allclose(keyframe.joint_pos, poses["joint_pos"][row], atol=1e-6)


def test_a_motion_may_begin_later_and_ends_where_it_ends(clip):
    whole = KeyframeSequence.from_motion(clip, [0.5, 1.5], G1)
    later = KeyframeSequence.from_motion(clip, [1.5], G1, begin=0.5, names=["stride"])
    np.testing.assert_array_equal(later.start.qpos, whole.keyframes[0].qpos)
    assert later.keyframes[0].time == 1.0
    assert later.keyframes[0].name == "stride"
    KeyframeSequence.from_motion(clip, [clip.duration], G1, begin=clip.duration - 1)
    with pytest.raises(KeyframeError, match=f"{clip.name}.*no time 99 s"):
        KeyframeSequence.from_motion(clip, [99.0], G1)


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ((), "none, expected at least one"),
        ((0.0,), "keyframe 0: time is 0 s, expected at least 0.02 s after 0 s"),
        ((-0.5,), "keyframe 0: time is -0.5 s"),
        ((0.5, 0.5), "keyframe 1: time is 0.5 s, expected at least 0.02 s after 0.5 s"),
        ((0.5, 0.505), "keyframe 1: time is 0.505 s, expected at least 0.02 s"),
        ((0.5, 1.52), "keyframe 1: time is 1.52 s, 51 control steps after 0.5 s, expected at most 50"),
        ((float("nan"),), "keyframe 0: time is nan"),
    ],
)
def test_times_that_do_not_fit_are_named(times, message):
    with pytest.raises(KeyframeError, match=message):
        sequence(*times)


@pytest.mark.parametrize(
    ("times", "doubt"),
    [
        ((500.0, 1000.0, 1900.0), True),  # milliseconds
        ((15.0, 45.0), True),  # frames
        ((1.0, 45.0), False),
        ((500.0, 501.0), False),
        ((3.0,), False),
        ((500.0, float("nan")), False),
    ],
)
def test_times_in_another_unit_are_doubted(times, doubt):
    with pytest.raises(KeyframeError, match="add a keyframe in between") as raised:
        sequence(*times)
    assert str(raised.value).endswith("; times are in seconds: are these milliseconds or frames?") == doubt


@pytest.mark.parametrize("time", [10**400, np.nan, np.inf, "soon", None])
def test_times_that_are_none_are_one_line(clip, time):
    asked = sequence(0.5, 1.0)
    for question in (asked.command, asked.sample, asked.commanded, lambda time: Keyframe.from_motion(clip, time, G1)):
        with pytest.raises(PlatError, match="time"):
            question(time)
    for start, keyframe in ((POSE, POSE.at(time)), (POSE.at(time), POSE.at(1.0))):
        with pytest.raises(KeyframeError, match="time is .*, expected a finite number"):
            split_long_intervals(start, [keyframe])


def test_a_split_into_millions_is_refused():
    with pytest.raises(KeyframeError, match="keyframe 0: time is .*, expected at most a day"):
        split_long_intervals(POSE, [POSE.at(1e300)])


@pytest.mark.parametrize("keyframes", [POSE.at(1.0), (POSE.at(1.0), 2.0), ("pose",)])
def test_what_is_no_tuple_of_keyframes_is_named(keyframes):
    with pytest.raises(KeyframeError, match="keyframes .*, expected (a tuple of them|each to be a Keyframe)"):
        KeyframeSequence(G1, POSE, keyframes)


@pytest.mark.parametrize("timing", [0.02, "fast", None, SimpleNamespace(control_dt=0.02, max_steps=50)])
def test_what_is_no_timing_is_named(timing):
    for made in (
        lambda: KeyframeSequence(G1, POSE, (POSE.at(1.0),), timing),
        lambda: split_long_intervals(POSE, [POSE.at(1.0)], timing),
        lambda: long_intervals(POSE, [POSE.at(1.0)], timing),
        lambda: sequence(0.5).with_timing(timing),
        lambda: sequence(0.5).with_timing(timing, split=True),
    ):
        with pytest.raises(PlatError, match="timing is .*, expected a Timing"):
            made()


def test_what_is_no_motion_no_times_or_no_pose_is_named(clip):
    with pytest.raises(KeyframeError, match="motion is 'walk', expected a MotionClip"):
        KeyframeSequence.from_motion("walk", [1.0], G1)
    with pytest.raises(KeyframeError, match="times is 0.5, expected a list of seconds"):
        KeyframeSequence.from_motion(clip, 0.5, G1)
    with pytest.raises(KeyframeError, match="after is None, expected a Keyframe"):
        interpolate(POSE, None, 0.5)


def test_names_are_one_for_each_keyframe(clip):
    with pytest.raises(KeyframeError, match="names: 1 for 2 keyframes, expected one for each or none"):
        KeyframeSequence.from_motion(clip, [0.5, 1.0], G1, names=["up"])


def test_a_bad_pose_is_named_with_its_keyframe():
    bad = replace(POSE, root_quat=np.zeros(4), name="arms up")
    with pytest.raises(KeyframeError, match=r"keyframe 1 \('arms up'\): root_quat has length 0"):
        KeyframeSequence(G1, POSE, (POSE.at(0.5), bad.at(1.0)))
    with pytest.raises(KeyframeError, match="start: root_quat"):
        KeyframeSequence(G1, bad, (POSE.at(0.5),))
    with pytest.raises(KeyframeError, match="start: time is 1 s, expected 0"):
        KeyframeSequence(G1, POSE.at(1.0), (POSE.at(1.5),))


@pytest.mark.parametrize("seconds", [1.0, 1.02, 2.0, 2.02, 3.7, 17.3])
def test_splitting_adds_as_few_keyframes_as_will_do(seconds):
    far = replace(POSE.at(seconds), root_pos=np.array([seconds, 0, 0.7]), name="far")
    split = KeyframeSequence(G1, POSE, split_long_intervals(POSE, [far]))
    assert len(split) == -(-round(seconds / 0.02) // 50)
    assert np.ptp(np.diff((0, *split.arrival_steps))) <= 1
    assert split.keyframes[-1].name == "far"
    for index, keyframe in enumerate(split.keyframes[:-1], start=1):
        assert keyframe.root_pos[0] == pytest.approx(keyframe.time)
        assert keyframe.name == f"far {index}/{len(split)}"


def test_splitting_leaves_short_intervals_alone():
    keyframes = sequence(0.5, 1.5).keyframes
    assert split_long_intervals(POSE, keyframes) == keyframes
    with pytest.raises(KeyframeError, match="keyframe 1: time is 0.2 s"):
        split_long_intervals(POSE, [POSE.at(0.5), POSE.at(0.2)])


def test_numpy_is_enough():
    heavy = "[name for name in ('torch', 'tensordict', 'torchrl', 'mujoco') if name in sys.modules]"
    code = f"import sys, plat.keyframes; print({heavy})"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


def test_a_pose_that_cannot_be_led_to_is_named_by_its_keyframe():
    stand = standing(G1)
    with pytest.raises(KeyframeError, match=r"keyframe 1 \('odd'\): joint_pos has shape \(28,\), expected \(29,\)"):
        split_long_intervals(
            stand, [stand.at(1.0), Keyframe(3.0, stand.root_pos, stand.root_quat, np.zeros(28), "odd")]
        )
