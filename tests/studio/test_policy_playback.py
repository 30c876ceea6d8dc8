import math
import re

import numpy as np
import pytest
from tensordict.nn import TensorDictModuleBase

from plat.control import HOLD
from plat.errors import KeyframeError, StudioError
from plat.modules import LatentPolicy, LatentPolicyConfig
from plat.robots import G1
from plat.spec.timing import Timing
from plat.studio.pins import preset
from plat.studio.policy_playback import PolicyPlayback
from plat.studio.timeline import Timeline
from tests.studio.conftest import squat

TIMELINE = Timeline.empty(G1).inserted(squat(), 0.4, "squat").inserted(G1.default_qpos, 0.4)


@pytest.fixture
def playback(policies) -> PolicyPlayback:
    return PolicyPlayback(G1, policies, lambda: TIMELINE)


def test_a_pause_keeps_the_robot_where_it_is(playback):
    playback.toggle()
    playback.tick(0.1)
    playback.toggle()
    assert playback.paused
    playback.tick(0.5)
    assert playback.cursor == pytest.approx(0.1)
    playback.toggle()
    playback.tick(0.1)
    assert playback.cursor == pytest.approx(0.2)


def test_slow_motion_takes_longer(playback):
    playback.speed = 0.25
    playback.play()
    for _ in range(8):
        playback.tick(0.1)
    assert playback.cursor == pytest.approx(0.2)


def test_steps_go_both_ways_and_simulate_what_was_not_yet(playback):
    playback.step(3)
    assert playback.paused
    assert playback.cursor == pytest.approx(0.06)
    end = playback.player.qpos
    playback.step(-2)
    assert playback.cursor == pytest.approx(0.02)
    assert playback.simulated == pytest.approx(0.06)
    playback.step(2)
    np.testing.assert_array_equal(playback.player.pose_at(playback.cursor), end)
    playback.step(1000)
    assert playback.player.finished
    assert set(playback.scores) == {"plat"}


def test_what_was_played_can_be_looked_at_again(playback):
    playback.step(1000)
    playback.seek(0.4)
    step = playback.player.step_at(playback.cursor)
    assert step.time == pytest.approx(0.4)
    np.testing.assert_array_equal(playback.player.pose_at(0.4), step.after.qpos)
    assert playback.player.step_at(0.0) is None
    playback.seek(99.0)
    assert playback.cursor == playback.simulated


def test_a_loop_begins_again(playback):
    playback.loop = True
    playback.play()
    for _ in range(round(10 * (0.8 + HOLD)) + 4):
        playback.tick(0.1)
    assert playback.playing
    assert playback.cursor < 0.6


def test_two_policies_play_the_same_keyframes(playback):
    with pytest.raises(StudioError, match="expected one of plat, expert"):
        playback.set_beside("nobody")
    playback.set_beside("expert")
    playback.step(1000)
    assert dict(playback.players).keys() == playback.scores.keys() == {"plat", "expert"}
    assert not np.allclose(playback.player.pose_at(0.4), playback.second.pose_at(0.4))
    playback.set_beside(None)
    assert playback.second is None


def test_a_policy_plays_beside_itself(playback):
    playback.set_beside("plat")
    playback.step(5)
    first, second = (player for _, player in playback.players)
    np.testing.assert_array_equal(first.qpos, second.qpos)
    assert first.time == second.time == pytest.approx(0.1)


def test_a_long_interval_is_one_command_where_the_policy_knows_it():
    """A policy that knows 3 s ahead is not held to what another one knows."""
    policies = {
        name: LatentPolicy(G1, LatentPolicyConfig(timing=Timing(max_steps=steps))).deployed()
        for name, steps in (("far", 150), ("near", 50))
    }
    far = Timeline.empty(G1).inserted(squat(), 2.5, "squat")
    playback = PolicyPlayback(G1, policies, lambda: far)
    assert playback.timing.longest == 3.0
    assert [len(playback.sequence(name)) for name in ("far", "near")] == [1, 3]
    playback.step(30)
    for name in ("near", "far"):  # another one takes over, and back
        playback.choose(name)
        assert len(playback.player.sequence) == len(playback.sequence(name))
        playback.step(1)
    assert playback.simulated == pytest.approx(0.64)


@pytest.fixture
def two() -> dict[str, TensorDictModuleBase]:
    """A policy that sees parts of poses, and one for whole poses and shorter commands."""
    sees = LatentPolicyConfig(also=("parts",), timing=Timing(max_steps=50))
    return {
        "parts": LatentPolicy(G1, sees).deployed(),
        "whole": LatentPolicy(G1, LatentPolicyConfig(timing=Timing(max_steps=15))).deployed(),
    }


class Edited:
    """Keyframes that are edited while they are played."""

    def __init__(self, policies: dict[str, TensorDictModuleBase], timeline: Timeline):
        self.timeline = timeline
        self.playback = PolicyPlayback(G1, policies, lambda: self.timeline)


HANDS = TIMELINE.select(1).commanding(preset("hands", G1))


def test_a_policy_that_refuses_the_keyframes_does_not_take_over(two):
    playback = Edited(two, HANDS).playback
    playback.step(5)
    with pytest.raises(KeyframeError, match="trained on whole poses"):
        playback.choose("whole")
    assert playback.policy == "parts"
    playback.step(1000)
    # as if nobody had been asked: neither was the sequence split for the other one
    scores, _ = playback.compare(HANDS)
    assert playback.scores == {"parts": scores["parts"]}


def test_a_policy_whose_simulation_ends_early_fell_and_the_one_beside_it_goes_on(policies):
    broken = LatentPolicy(G1)
    for weights in broken.parameters():
        weights.data.fill_(math.nan)
    playback = PolicyPlayback(G1, {"broken": broken.deployed(), "plat": policies["plat"]}, lambda: TIMELINE)
    scores, notes = playback.compare(TIMELINE)
    (told,) = notes.values()
    assert re.fullmatch(r"at 0.00 s: the policy's action for joint .* is nan, .*; it fell from there on", told)
    assert notes == {"broken": told}
    assert [score.words for score in scores["broken"]] == ["fell", "fell"]
    playback.set_beside("plat")
    playback.play()
    while playback.playing:
        playback.tick(0.1)
    assert playback.simulated == pytest.approx(0.8 + HOLD)
    assert playback.notes == notes
    assert playback.scores["plat"] == scores["plat"]
    assert [score.words for score in playback.scores["broken"]] == ["fell", "fell"]
    playback.changed()
    assert not playback.notes


def test_scores_are_those_of_the_policy_that_played(two):
    playback = Edited(two, TIMELINE).playback
    playback.step(1000)
    scores = dict(playback.scores)
    playback.choose("whole")
    playback.step(-1)
    assert playback.scores == scores, "the other one has not played yet"
    assert [name for name, _ in playback.players] == ["parts"]


@pytest.mark.parametrize("beside", [False, True])
def test_a_chase_ends_when_its_policy_refuses_the_edited_keyframes(two, beside):
    edited = Edited(two, TIMELINE)
    playback = edited.playback
    playback.choose("parts" if beside else "whole")
    playback.set_beside("whole" if beside else None)
    playback.step(5)
    playback.toggle()
    edited.timeline = HANDS
    playback.changed()
    assert "trained on whole poses" in playback.refused
    assert not playback.players
    playback.tick(5.0)
    assert not playback.scores


def test_a_policy_that_refuses_is_left_out_of_a_comparison_and_says_why(two):
    edited = Edited(two, HANDS)
    playback = edited.playback
    compared = scores, notes = playback.compare(HANDS)
    assert list(scores) == ["parts"]
    assert notes["whole"].startswith("did not play: the keyframe at 0.2 s (")
    assert "trained on whole poses" in notes["whole"]
    playback.take_scores(HANDS, *compared)
    assert (playback.scores, playback.notes) == (scores, notes)
    edited.timeline = TIMELINE
    playback.changed()
    assert not playback.notes
    with pytest.raises(KeyframeError, match="no keyframes yet"):
        playback.compare(Timeline.empty(G1))
