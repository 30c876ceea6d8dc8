from dataclasses import replace

import numpy as np
import pytest

from plat.errors import KeyframeError
from plat.keyframes import standing
from plat.robots import G1
from plat.spec.timing import Timing
from plat.studio.pins import preset
from plat.studio.timeline import NEW_INTERVAL, Timeline


def pose(height: float) -> np.ndarray:
    qpos = G1.default_qpos.copy()
    qpos[2] = height
    return qpos


def three() -> Timeline:
    """Keyframes at 0.5, 0.9 and 1.8 s, told apart by their heights, the last one selected."""
    timeline = Timeline.empty(G1)
    for height, interval in ((0.1, 0.5), (0.2, 0.4), (0.3, 0.9)):
        timeline = timeline.inserted(pose(height), interval)
    return timeline


def times(timeline: Timeline) -> list[float]:
    return [keyframe.time for keyframe in timeline.keyframes]


def heights(timeline: Timeline) -> list[float]:
    return [float(keyframe.root_pos[2]) for keyframe in timeline.keyframes]


def test_an_empty_timeline_has_a_start_and_nothing_to_play():
    timeline = Timeline.empty(G1)
    assert timeline.labels == ("start",)
    with pytest.raises(KeyframeError, match="no keyframes yet: press A"):
        timeline.sequence()


def test_keyframes_are_added_one_after_the_other():
    timeline = three()
    assert times(timeline) == [0.5, 0.9, 1.8]
    assert timeline.selected == 3
    assert timeline.interval == pytest.approx(0.9)
    assert len(timeline.sequence()) == 3


def test_an_added_keyframe_moves_later_ones():
    timeline = three().select(1).inserted(pose(0.7))
    assert heights(timeline) == [0.1, 0.7, 0.2, 0.3]
    assert times(timeline) == pytest.approx([0.5, 0.5 + NEW_INTERVAL, 0.9 + NEW_INTERVAL, 1.8 + NEW_INTERVAL])
    assert timeline.selected == 2


def test_intervals_are_whole_control_steps_and_long_ones_are_split_when_played():
    timeline = Timeline.empty(G1).inserted(pose(0.1), 2.71).inserted(pose(0.2), 0.0)
    assert times(timeline) == [2.72, 2.74]
    played = timeline.sequence()
    assert [frame.time for frame in played.keyframes] == [0.9, 1.8, 2.72, 2.74]
    assert [timeline.toward(frame.time) for frame in played.keyframes] == [1, 1, 1, 2]
    assert len(timeline.sequence(Timing(max_steps=150))) == 2, "a policy that knows them in one command gets it"


def test_a_hold_moves_later_keyframes_and_is_played_as_the_same_pose():
    timeline = three().select(2).held(1.5)
    assert times(timeline) == [0.5, 0.9, 3.3]
    assert timeline.interval == pytest.approx(0.4)
    assert timeline.duration == 3.3
    played = timeline.sequence().keyframes
    assert [frame.time for frame in played] == pytest.approx([0.5, 0.9, 1.64, 2.4, 3.3])
    assert [frame.root_pos[2] for frame in played] == [0.1, 0.2, 0.2, 0.2, 0.3]
    assert [timeline.toward(frame.time) for frame in played] == [1, 2, 2, 2, 3]
    assert (timeline.toward(0.1), timeline.toward(9.0)) == (1, 3)
    assert times(timeline.held(-3)) == [0.5, 0.9, 1.8]
    assert timeline.sample(2.0).root_pos[2] == 0.2
    assert timeline.sample(2.85).root_pos[2] == pytest.approx(0.25)
    assert timeline.at(0.9) == 2
    assert timeline.at(1.0) is None


def test_holds_come_back_from_a_file():
    timeline = three().select(2).renamed("stay").held(1.5)
    again = Timeline.of(timeline.start, timeline.to_keyframes(), G1, timeline.timing)
    assert times(again) == times(timeline)
    assert again.holds == timeline.holds == (0.0, 1.5, 0.0)
    assert again.labels == timeline.labels


def test_holds_between_control_steps_leave_every_gap_a_step():
    start, first = Timeline.empty(G1).start, Timeline.empty(G1).start.at(0.611)
    frames = [replace(first, name="x"), replace(first.at(1.226), name="x (hold)"), replace(first.at(1.245), name="y")]
    timeline = Timeline.of(start, frames, G1, Timing())
    assert timeline.renamed("z").select(2).held(0.0).sequence()
    moved = timeline.select(1).stretched(0.7)
    assert times(moved) == [0.7, 1.32]
    assert moved.sequence()


def test_a_keyframe_is_inserted_where_the_cursor_is():
    timeline = three().select(2).held(0.4)
    added = timeline.inserted_at(0.7)
    assert times(added) == [0.5, 0.7, 0.9, 2.2]
    assert heights(added)[1] == pytest.approx(0.15)
    assert added.selected == 2
    assert added.holds == (0.0, 0.0, 0.4, 0.0)
    assert timeline.inserted_at(1.1).selected == 2, "within a hold there is no room"
    assert times(timeline.inserted_at(1.1)) == times(timeline)
    assert timeline.inserted_at(0.0).selected == 0


def test_a_keyframe_that_is_inserted_commands_what_the_one_after_it_does():
    """Else the playhead between two keyframes of the hands alone would add one of the whole body."""
    timeline = three().commanding(preset("hands", G1)).select(2).commanding(preset("place", G1))
    assert timeline.inserted_at(1.3).pose.commands == preset("hands", G1)
    assert timeline.inserted_at(0.7).pose.commands == preset("place", G1)
    assert timeline.inserted_at(0.2).pose.whole
    assert Timeline.empty(G1).inserted_at(0.4).pose.whole


def test_removing_closes_the_gap():
    timeline = three().select(2).removed()
    assert heights(timeline) == [0.1, 0.3]
    assert times(timeline) == [0.5, 1.4]
    assert timeline.selected == 2
    assert timeline.removed().selected == 1
    assert timeline.removed().removed().selected == 0


def test_moving_takes_the_interval_along():
    timeline = three().moved(-2)
    assert heights(timeline) == [0.3, 0.1, 0.2]
    assert times(timeline) == [0.9, 1.4, 1.8]
    assert timeline.selected == 1
    assert heights(timeline.moved(-1)) == heights(timeline)


def test_stretching_moves_later_keyframes():
    timeline = three().select(2).stretched(0.6)
    assert times(timeline) == [0.5, 1.1, 2.0]
    assert times(timeline.stretched(99.0)) == [0.5, 30.5, 31.4]


@pytest.mark.parametrize(
    ("number", "asked", "expected"),
    [
        (2, 1.2, [0.5, 1.2, 1.8]),
        (2, 0.1, [0.5, 0.52, 1.8]),  # a control step after the one before
        (2, 1.9, [0.5, 1.78, 1.8]),
        (1, 5.0, [0.88, 0.9, 1.8]),  # a control step before the next
        (3, 9.0, [0.5, 0.9, 9.0]),
        (3, 0.0, [0.5, 0.9, 0.92]),
    ],
)
def test_retiming_moves_one_keyframe_between_its_neighbours(number: int, asked: float, expected: list[float]):
    timeline = three().retimed(number, asked)
    assert times(timeline) == pytest.approx(expected)
    timeline.sequence()


def test_what_a_file_has_for_longer_than_edits_make_is_not_cut_by_them():
    frames = (standing(G1).at(40.0), standing(G1).at(80.0))
    timeline = Timeline(G1, standing(G1), frames, 1, holds=(35.0, 0.0))
    assert times(timeline.retimed(1, 39.98)) == [39.98, 80.0]
    assert times(timeline.retimed(1, 41.0)) == [40.0, 80.0]
    assert timeline.held(34.98).holds == (34.98, 0.0)
    assert timeline.stretched(36.0).interval == 36.0


def test_a_random_walk_of_edits_can_always_be_played():
    rng = np.random.default_rng(0)
    timeline = three()
    for _ in range(300):
        edit = rng.integers(7)
        timeline = timeline.select(int(rng.integers(1, len(timeline.poses))))
        if edit == 0 or len(timeline.keyframes) < 2:
            timeline = timeline.inserted(pose(0.5), rng.uniform(-1, 3))
        elif edit == 1:
            timeline = timeline.removed()
        elif edit == 2:
            timeline = timeline.moved(int(rng.integers(-3, 4)))
        elif edit == 3:
            timeline = timeline.stretched(rng.uniform(-1, 3))
        elif edit == 5:
            timeline = timeline.held(rng.uniform(-1, 2))
        else:
            timeline = timeline.retimed(timeline.selected, rng.uniform(-1, 30))
        arrivals = np.array([0, *timeline.sequence().arrival_steps])
        assert np.diff(arrivals).min() >= 1
        assert np.diff(arrivals).max() <= 50


def test_posing_and_naming_change_the_selected_pose_only():
    timeline = three().select(2).posed(pose(0.9)).renamed(" wave ")
    assert heights(timeline) == [0.1, 0.9, 0.3]
    assert times(timeline) == [0.5, 0.9, 1.8]
    assert timeline.labels == ("start", "1", "2 wave", "3")
    assert timeline.renamed("").labels[2] == "2"
    assert timeline.select(0).posed(pose(0.8)).start.root_pos[2] == 0.8


@pytest.mark.parametrize(
    "edit", [Timeline.removed, lambda t: t.moved(1), lambda t: t.stretched(1), lambda t: t.renamed("a")]
)
def test_the_start_stays_where_it_is(edit):
    with pytest.raises(KeyframeError, match="select a keyframe"):
        edit(three().select(0))


def test_a_sequence_comes_back_as_it_went():
    sequence = three().sequence()
    again = Timeline.of(sequence.start, sequence.keyframes, G1, sequence.timing)
    assert again.selected == 1
    assert times(again) == [0.5, 0.9, 1.8]
    assert heights(again) == [0.1, 0.2, 0.3]


def test_only_what_a_hold_is_written_as_comes_back_as_one():
    hands = preset("hands", G1)
    whole = Timeline.empty(G1).inserted(pose(0.7), 0.5, "a")
    for second, name in ((hands, "a (hold)"), (None, "b (hold)")):
        frame = replace(whole.pose, time=1.0, name=name, commands=second)
        again = Timeline.of(whole.start, (*whole.keyframes, frame), G1, whole.timing)
        assert [(kept.name, kept.commands) for kept in again.keyframes] == [("a", None), (name, second)]
        assert [(kept.name, kept.commands) for kept in again.to_keyframes()] == [("a", None), (name, second)]
    renamed = whole.inserted(whole.pose.qpos, 0.5).renamed("a (hold) (hold) ")
    assert len(Timeline.of(renamed.start, renamed.to_keyframes(), G1, renamed.timing).keyframes) == 2
    partial = whole.commanding(hands).held(0.4)
    assert Timeline.of(partial.start, partial.to_keyframes(), G1, partial.timing).holds == (0.4,)
