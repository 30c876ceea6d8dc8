from dataclasses import replace

import numpy as np
import pytest

from plat.control import Chase, KeyframeScorer, Simulator, record
from plat.errors import StateError
from plat.keyframes import KeyframeSequence, standing
from plat.robots import G1
from tests.control.puppets import Limp, Puppet

SEQUENCE = KeyframeSequence(G1, standing(G1), (standing(G1).at(0.3), standing(G1).at(1.3)))


def recorded(controller, sequence=SEQUENCE):
    scorer = KeyframeScorer(G1)
    chase = Chase(controller, sequence, Simulator(G1.model()), hold=0.1)
    return record(((step, scorer.add(step)) for step in chase), scorer)


def test_a_chase_is_recorded_step_by_step():
    playback = recorded(Puppet())
    assert playback.qpos.shape == playback.target_qpos.shape == (70, 36)
    np.testing.assert_array_equal(playback.qpos[0], SEQUENCE.start.qpos)
    np.testing.assert_array_equal(playback.target_qpos[20], SEQUENCE.keyframes[1].qpos)
    assert playback.steps_left.tolist() == [*range(15, 0, -1), *range(50, 0, -1), 0, 0, 0, 0, 0]
    assert (playback.command_length[:15] == 15).all()
    assert (playback.command_length[15:65] == 50).all()
    assert playback.dt == 0.02


def test_a_fall_is_a_failure_from_then_on():
    failed = recorded(Limp()).failed
    assert not failed[:10].any()
    assert failed[-1]


def test_a_recorded_step_ends_where_the_next_one_begins():
    playback = recorded(Limp())
    np.testing.assert_array_equal(playback.reached_qpos[:-1], playback.qpos[1:])


def test_the_outcome_is_told_for_a_moment_after_each_arrival():
    words = recorded(Puppet()).words
    assert words[14] == ""
    assert words[15] == words[50] == "1: reached"
    assert words[64] == ""
    # this puppet does not balance: it is tipping over at the second arrival, and lies in the hold
    assert words[65].startswith("2: late or off: 0.")
    assert words[-1].endswith(", fell afterwards")
    assert recorded(Limp()).words[-1] == "2: fell"


def test_the_outcome_is_told_from_the_arrival_on_where_that_is_before_the_written_time():
    early = KeyframeSequence(G1, standing(G1), (standing(G1).at(0.309), standing(G1).at(1.309)))
    assert early.arrival_steps == (15, 65)
    assert recorded(Puppet(), early).words == recorded(Puppet()).words


def test_a_keyframe_that_was_missed_marks_its_arrival():
    aside = standing(G1).at(0.2)
    aside = replace(aside, root_pos=aside.root_pos + np.array([0.6, 0.0, 0.0]))
    scorer = KeyframeScorer(G1)
    chase = Chase(Puppet(), KeyframeSequence(G1, standing(G1), (aside,)), Simulator(G1.model()), hold=0.1)
    playback = record(((step, scorer.add(step)) for step in chase), scorer)
    assert playback.failed.nonzero()[0].tolist() == [9]
    assert playback.words[-1] == "1: late or off: 0.59 m off"


def test_a_chase_that_ended_with_its_first_step_has_no_playback():
    with pytest.raises(StateError, match="record: no steps"):
        record([], KeyframeScorer(G1))
