import numpy as np

from plat.envs import G1
from plat.keyframes import KeyframeSequence, standing
from plat.playing import Chase, KeyframeScorer, Simulator
from plat.rendering import record
from tests.playing.puppets import Limp, Puppet

SEQUENCE = KeyframeSequence(G1, standing(G1), (standing(G1).at(0.3), standing(G1).at(1.3)))


def recorded(controller):
    scorer = KeyframeScorer(G1)
    chase = Chase(controller, SEQUENCE, Simulator(G1.model()), hold=0.1)
    return record((step, scorer.add(step)) for step in chase)


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
