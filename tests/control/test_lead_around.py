from dataclasses import replace

import numpy as np
import pytest

from plat.control import Feasibility, keyframe_around, lead_around
from plat.control.authored import author
from plat.errors import KeyframeError
from plat.keyframes import KeyframeSequence, standing
from plat.keyframes.partial import hands_of
from plat.robots import G1
from plat.spec.parts import Parts
from plat.spec.timing import Timing
from tests.crossed import ABOVE, BELOW

STAND = standing(G1)


def doubts(sequence):
    return [[concern.measure for concern in concerns] for concerns in Feasibility(G1).sequence(sequence)]


def test_a_clear_way_stays_as_it_is():
    assert keyframe_around(STAND, ABOVE, G1) is None
    sequence = KeyframeSequence(G1, STAND, (ABOVE, ABOVE.at(2.0), BELOW.at(3.0)))
    assert doubts(sequence) == [[], [], ["way_penetration"]]
    led = lead_around(sequence)
    assert [keyframe.time for keyframe in led.keyframes] == [1.0, 2.0, 2.5, 3.0]
    assert doubts(led) == [[], [], [], []]
    for before, after in zip(sequence.keyframes, (*led.keyframes[:2], led.keyframes[3]), strict=True):
        np.testing.assert_array_equal(before.qpos, after.qpos)


def test_a_keyframe_around_commands_what_the_next_one_does():
    hands = Parts.only(G1, bodies=hands_of(G1))
    middle = keyframe_around(ABOVE, replace(BELOW, commands=hands, name="below"), G1)
    assert middle is not None
    assert (middle.time, middle.commands, middle.name) == (1.5, hands, None)
    assert np.ptp(middle.root_pos - STAND.root_pos) == pytest.approx(0, abs=1e-6)
    alone = Parts.only(G1, bodies=hands_of(G1)[:1])
    assert keyframe_around(ABOVE, replace(BELOW, commands=alone), G1) is None, "the right hand moves out of the way"


def test_it_is_on_a_control_step_of_the_policy():
    middle = keyframe_around(ABOVE.at(0.1), BELOW.at(0.3), G1, Timing(control_dt=0.05))
    assert middle is not None
    assert middle.time == pytest.approx(0.2)
    with pytest.raises(KeyframeError, match=r"^keyframe at 1\.02 s: a control step after the one before, expected 2"):
        keyframe_around(ABOVE, BELOW.at(1.02), G1)


def test_where_none_is_found_the_keyframe_is_named():
    found = []
    for chain in author("three_point", G1, 60, 0):
        for before, after in zip(chain.sequence.arrived[:-1], chain.sequence.keyframes, strict=True):
            try:
                keyframe_around(before, after, G1)
            except KeyframeError as error:
                found.append(str(error))
    assert found
    assert all("no way around was found, and " in words for words in found)
    assert all(words.startswith("keyframe at ") and "('three_point " in words for words in found)


def test_most_ways_of_hands_are_led_around_and_then_clear():
    chains = [chain.sequence for chain in author("reach", G1, 30, 0)]
    blocked = [chain for chain in chains if any(map(len, doubts(chain)))]
    assert len(blocked) >= 5
    for chain in blocked:
        led = lead_around(chain)
        assert len(led) > len(chain)
        assert not any(map(len, doubts(led)))
