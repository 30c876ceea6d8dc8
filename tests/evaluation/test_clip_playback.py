import numpy as np
import pytest
import torch

from plat.baselines import Tracker
from plat.envs.transforms import HORIZONS
from plat.evaluation import evaluate, play
from plat.modules import Expert
from plat.motions import MotionLibrary
from plat.robots import G1
from tests.conftest import standing_clip


@pytest.fixture(scope="module")
def library() -> MotionLibrary:
    return MotionLibrary.from_clips([standing_clip()])


def test_a_step_ends_where_the_next_one_begins(library):
    playback = play(Expert(G1).deployed(), library, 0, HORIZONS["long"])
    goes_on = ~playback.failed[:-1]
    assert goes_on.any()
    assert np.array_equal(playback.reached_qpos[:-1][goes_on], playback.qpos[1:][goes_on])
    assert not np.array_equal(playback.reached_qpos, playback.qpos)


def test_a_failed_command_leaves_the_robot_where_it_fell(library):
    def collapse(tensordict):
        return tensordict.set("action", torch.full((*tensordict.shape, 29), 9.0))

    playback = play(collapse, library, 0, HORIZONS["long"])
    (end,) = np.flatnonzero(playback.failed)[:1]
    assert playback.qpos[end + 1, 2] == pytest.approx(0.76, abs=1e-3)  # put back on the reference
    assert np.abs(playback.reached_qpos[end] - playback.qpos[end + 1]).max() > 0.1


def test_a_tracker_is_shown_what_it_reads(library):
    seen: list[np.ndarray] = []

    class Holder(Tracker):
        def targets(self, tensordict, joint_pos, starting):
            seen.append(tensordict["tracker_reference", "root_pos_w"][0].numpy())
            return tensordict["tracker_reference", "joint_pos"]

    tracker = Holder(G1)
    playback = play(tracker, library, 0, HORIZONS["long"], observe=tracker.observe)
    np.testing.assert_allclose(playback.target_qpos[:, :3], seen)


def test_the_dense_reference_in_the_goals_of_an_expert(library):
    seen: list[set[str]] = []

    def policy(tensordict):
        seen.append(set(tensordict.keys()))
        return tensordict.set("action", torch.zeros(*tensordict.shape, 29))

    play(policy, library, 0, HORIZONS["long"], dense=True, goals={"goal": 1, "goal_6": 6})
    assert {"goal", "goal_6", "keyframe"} <= seen[0]


def test_commands_are_those_of_the_evaluation():
    """Clip 1 had those of clip 0."""
    library = MotionLibrary.from_clips([standing_clip("a"), standing_clip("b")])

    def still(tensordict):
        return tensordict.set("action", torch.zeros(*tensordict.shape, 29))

    records = evaluate(still, library, HORIZONS["mixed"])
    for clip in (0, 1):
        playback = play(still, library, clip, HORIZONS["mixed"])
        begins = np.flatnonzero(np.append(True, (playback.steps_left <= 1) | playback.failed)[:-1])
        assert playback.command_length[begins].tolist() == records.of_clips([clip]).length.tolist()
