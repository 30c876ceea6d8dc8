import numpy as np

import plat
from plat.control.authored import Authored, author
from plat.envs.settings import ReachLimits
from plat.envs.transforms.settings import TerminationLimits
from plat.evaluation.authored_playback import play_authored
from plat.evaluation.authored_scores import evaluate_authored
from plat.keyframes import KeyframeSequence, standing
from plat.robots import G1
from tests.evaluation.test_authored_scores import limp, wild

STAND = standing(G1)
CHAINS = [
    Authored("long", KeyframeSequence(G1, STAND, (STAND.at(0.2), STAND.at(0.5))), 0.3),
    Authored("short", KeyframeSequence(G1, STAND, (STAND.at(0.1), STAND.at(0.2))), 0.1),
]


def test_the_hold_is_one_more_command() -> None:
    long, short = play_authored(plat.load("plat-g1").deployed(), G1, CHAINS)
    assert long.steps_left.tolist() == [*range(10, 0, -1), *range(15, 0, -1), *range(15, 0, -1)]
    assert short.steps_left.tolist() == [*range(5, 0, -1), *range(5, 0, -1), *range(5, 0, -1)]
    assert short.command_length.tolist() == [5] * 15
    assert not long.failed.any()
    np.testing.assert_array_equal(long.qpos[1:], long.reached_qpos[:-1])
    np.testing.assert_allclose(long.qpos[0], G1.default_qpos, atol=1e-6)


def test_a_fall_shows_at_the_end_of_the_hold() -> None:
    falling = Authored("still", KeyframeSequence(G1, STAND, (STAND.at(0.1),)), 1.5)
    (playback,) = play_authored(limp(), G1, [falling])
    assert playback.failed.nonzero()[0].tolist()[-1] == 79


def test_after_an_absurd_action_every_command_has_failed() -> None:
    still = Authored("still", KeyframeSequence(G1, STAND, (STAND.at(0.2), STAND.at(0.5))), 0.3)
    (playback,) = play_authored(wild(), G1, [still])
    assert playback.failed.nonzero()[0].tolist() == [24, 39]  # the first command was met in step 10


def test_a_keyframe_has_failed_where_the_scores_say_so() -> None:
    policy = plat.load("dagger-g1").deployed()
    chains = [*author("arms", G1, 3, seed=0), *author("steps", G1, 2, seed=0)]
    limits = ReachLimits(window=TerminationLimits(end_effector_height=0.03))  # near enough, and yet off in the window
    records = evaluate_authored(policy, G1, chains, limits=limits)
    assert 0 < int(records.fell_before.sum()) < int((~records.reached).sum()) < records.reached.numel()
    for playback, reached, fell in zip(
        play_authored(policy, G1, chains, limits=limits), records.reached, records.fell, strict=True
    ):
        *keyframes, hold = (playback.steps_left == 1).nonzero()[0]
        assert playback.failed[keyframes].tolist() == (~reached).tolist()
        assert playback.failed[hold] or not fell
