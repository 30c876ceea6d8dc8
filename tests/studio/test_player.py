from dataclasses import replace

import numpy as np
import pytest

from plat.control import HOLD, PolicyController
from plat.errors import KeyframeError
from plat.keyframes import KeyframeSequence
from plat.robots import G1
from plat.spec.timing import Timing
from plat.studio.pins import preset
from plat.studio.player import Player, Summary, score, simulator
from plat.studio.timeline import Timeline
from tests.control.puppets import Kicking, Limp, Puppet


def play(player: Player, frame: float = 0.03) -> Player:
    while not player.finished:
        player.advance(frame)
    return player


def test_steps_are_taken_as_time_passes(sequence):
    player = Player(G1, Puppet(), sequence)
    for _ in range(10):
        player.advance(0.0301)
    np.testing.assert_allclose(player.times, 0.02 * np.arange(1, 16))
    player.advance(0.009)
    assert len(player.times) == 15
    assert player.step.time == pytest.approx(0.3)


@pytest.mark.parametrize("control_dt", [1 / 60, 0.0125, 0.02])
def test_physics_is_that_of_training_at_any_control_step(control_dt):
    """60 Hz is no whole number of the description's 5 ms, and was refused after it had been trained."""
    played = simulator(G1, Puppet(Timing(control_dt=control_dt)))
    assert played.substeps == 4
    assert played.model.opt.timestep == pytest.approx(control_dt / 4)


def test_a_machine_that_is_too_slow_stretches_time(sequence):
    player = Player(G1, Puppet(), sequence)
    player.advance(10.0)
    assert len(player.times) == 5


def test_the_robot_holds_the_last_keyframe_and_is_finished(sequence):
    player = play(Player(G1, Puppet(), sequence))
    assert player.times[-1] == pytest.approx(sequence.duration + HOLD)
    steps = len(player.errors)
    player.advance(1.0)
    assert len(player.errors) == steps


@pytest.mark.parametrize("frame", [0.02, 0.033, 0.1])
def test_scores_do_not_depend_on_the_frame_rate(sequence, policies, frame: float):
    player = play(Player(G1, PolicyController(policies["plat"], G1), sequence), frame)
    at_once, ended = score(G1, PolicyController(policies["plat"], G1), sequence)
    assert (ended, player.ended) == ("", "")
    assert player.scores == at_once
    assert [keyframe.name for keyframe in at_once] == ["squat", None]


def test_the_committed_policy_gets_there_and_a_limp_robot_does_not(sequence, policies):
    assert all(keyframe.reached for keyframe in score(G1, PolicyController(policies["plat"], G1), sequence)[0])
    assert not score(G1, Limp(), sequence)[0][-1].reached


def test_errors_are_the_distance_to_the_commanded_keyframe():
    ahead = G1.default_qpos + np.eye(36)[0]  # a meter
    player = Player(G1, Puppet(), Timeline.empty(G1).inserted(ahead, 1.0).sequence())
    player.advance(0.0201)
    assert player.errors[0].keypoint == pytest.approx(1.0, abs=0.01)
    assert player.errors[0].joint < 0.01


def test_what_is_not_commanded_is_no_error():
    bent = G1.default_qpos.copy()
    bent[7 + G1.joint_names.index("left_knee")] += 0.8
    timeline = Timeline.empty(G1).inserted(bent, 1.0)
    away = []
    for commands in (None, preset("hands", G1)):
        player = Player(G1, Puppet(), timeline.commanding(commands).sequence())
        player.advance(0.0201)
        away.append(player.errors[0].keypoint)
    assert away[0] > 0.015
    assert away[1] < 0.005


def test_there_are_no_scores_of_what_was_exchanged_on_the_way(sequence):
    player = Player(G1, Puppet(), sequence)
    player.advance(0.1)
    player.hand_over(Puppet(), player.sequence)
    assert play(player).scores is None
    player.restart()
    player.sequence = sequence
    assert play(player).scores is None
    player.restart()
    assert play(player).scores is not None


def test_a_restarted_robot_does_the_same_again(sequence):
    player = play(Player(G1, Puppet(), sequence))
    first, end = player.scores, player.qpos
    player.restart()
    assert player.step is None
    np.testing.assert_array_equal(player.qpos, sequence.start.qpos)
    assert play(player).scores == first
    np.testing.assert_array_equal(player.qpos, end)


def test_a_summary_counts_and_averages(sequence):
    scores, _ = score(G1, Limp(), sequence)
    summary = Summary.of(scores)
    assert (summary.reached, summary.total) == (sum(keyframe.reached for keyframe in scores), 2)
    assert summary.joint_error == pytest.approx((scores[0].joint_error + scores[1].joint_error) / 2)
    assert summary.keypoint_error == pytest.approx((scores[0].keypoint_error + scores[1].keypoint_error) / 2)


def test_a_policy_that_refuses_the_keyframes_changes_nothing(sequence):
    class Whole(Puppet):
        sees_parts = False

    commanded = replace(sequence.keyframes[0], commands=preset("hands", G1))
    partial = KeyframeSequence(G1, sequence.start, (commanded, *sequence.keyframes[1:]))
    undisturbed, player = (Player(G1, Puppet(), partial) for _ in range(2))
    player.advance(0.1)
    with pytest.raises(KeyframeError, match="trained on whole poses"):
        player.hand_over(Whole(Timing(max_steps=10)), partial.with_timing(Timing(max_steps=10), split=True))
    assert player.sequence is partial
    assert play(player).scores == play(undisturbed).scores


def test_a_robot_whose_simulation_diverges_fell_from_there_on(sequence):
    player = play(Player(G1, Kicking(30), sequence))
    told = "at 0.60 s: the simulation diverged 0.60 s after its start: targets or pushes are too large"
    assert player.ended == f"{told}; it fell from there on"
    assert [keyframe.outcome for keyframe in player.scores] == ["late or off", "fell"]
    assert player.times[-1] == pytest.approx(0.6)
    np.testing.assert_array_equal(player.pose_at(9.0), player.steps[-1].after.qpos)
    assert score(G1, Kicking(30), sequence)[1] == player.ended
    player.restart()
    assert (player.ended, player.finished) == ("", False)
