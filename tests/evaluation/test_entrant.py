import pytest
import torch

import plat
from plat.baselines import Tracker
from plat.envs.transforms import HORIZONS
from plat.evaluation import Entrant, EvaluationSetting, evaluate
from plat.modules import Expert, ExpertConfig
from plat.motions import MotionLibrary
from plat.robots import G1
from tests.conftest import standing_clip


@pytest.fixture(scope="module")
def clips() -> MotionLibrary:
    return MotionLibrary.from_clips([standing_clip(frames=61)])


def test_an_expert_with_the_dense_reference_is_shown_all_frames_it_asks_for() -> None:
    expert = Expert(G1, ExpertConfig(ahead=(1, 6)))
    assert dict(Entrant.of_policy(expert, dense=True).view.goals) == expert.goals
    sparse = Entrant.of_policy(expert)
    assert not sparse.view.dense
    assert dict(sparse.view.goals) == {"goal": 1}


def test_a_policy_scores_as_entrant_what_it_scores_by_hand(clips: MotionLibrary) -> None:
    policy = plat.load("dagger-g1")
    setting = EvaluationSetting(seed=4, num_envs=1)
    ours = Entrant.of_policy(policy).evaluate(clips, "mixed", setting)
    by_hand = evaluate(policy.deployed(), clips, HORIZONS["mixed"], seed=4)
    assert torch.equal(ours.arrival_error, by_hand.arrival_error)
    other = Entrant.of_policy(policy).evaluate(clips, "mixed", setting, seed=5)
    assert not torch.equal(ours.length, other.length)


def test_a_tracker_brings_its_own_view_and_robot(clips: MotionLibrary) -> None:
    seen = []

    class Holder(Tracker):
        def targets(self, tensordict, joint_pos, starting):
            seen.append(tensordict["tracker_reference", "joint_vel"].abs().max().item())
            return tensordict["tracker_reference", "joint_pos"]

    entrant = Entrant.of_tracker(Holder(G1), dense=True)
    assert entrant.robot is G1
    playback = entrant.play(clips, HORIZONS["long"])
    assert len(seen) == len(playback.qpos)


def test_a_condition_that_there_is_none_of(clips: MotionLibrary) -> None:
    with pytest.raises(TypeError, match="decimaton"):
        evaluate(Expert(G1).deployed(), clips, HORIZONS["long"], decimaton=4)
