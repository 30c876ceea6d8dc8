from dataclasses import replace

import pytest
import torch
from tensordict import TensorDict

import plat
from plat.baselines import Tracker
from plat.baselines.tracker import tuned_robot
from plat.envs.transforms import HORIZONS
from plat.errors import BundleError, ConfigError
from plat.evaluation import Entrant, EvaluationSetting, evaluate
from plat.evaluation.bundle_policy import BundlePolicy
from plat.modules import Expert, ExpertConfig
from plat.motions import MotionLibrary
from plat.robots import G1
from plat.runs import load_policy
from plat.spec.observation import observation_size
from tests.conftest import standing_clip
from tests.export.runs import small_policy, write_run


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


def test_a_bundle_scores_what_its_policy_scores(clips: MotionLibrary, tmp_path) -> None:
    pytest.importorskip("onnxscript")
    pytest.importorskip("onnxruntime")
    from plat.export import export_bundle

    run = write_run(tmp_path / "plat", small_policy("residual_latent"))
    bundle = tmp_path / "bundle"
    export_bundle(run, bundle)
    setting = EvaluationSetting(num_threads=1)
    of_run = Entrant.of_run(run).evaluate(clips, "long", setting)
    for path in (bundle, bundle / "policy.onnx"):
        entrant = Entrant.of_bundle(path)
        assert (entrant.robot, entrant.tracks, entrant.timing.max_steps) == (G1, False, 50)
        found = entrant.evaluate(clips, "long", setting)
        assert torch.equal(found.length, of_run.length)
        torch.testing.assert_close(found.steps, of_run.steps)
        torch.testing.assert_close(found.step["action_change"], of_run.step["action_change"], rtol=0.02, atol=1e-3)
        assert Entrant.of_bundle(path, dense=True).view == Entrant.of_run(run, dense=True).view
    acts, trained = BundlePolicy(bundle, G1), load_policy(run).deployed()
    for shape in ((), (0,), (1,), (2, 3)):  # of a robot alone, of none, and of rollouts as well
        seen = TensorDict({}, shape)
        for key in acts.in_keys:
            seen[key] = torch.rand(*shape, observation_size([key], G1))
        torch.testing.assert_close(acts(seen.clone())["action"], trained(seen)["action"], rtol=1e-3, atol=1e-3)


def test_a_bundle_of_a_robot_with_other_motors_is_refused(tmp_path) -> None:
    pytest.importorskip("onnxscript")
    pytest.importorskip("onnxruntime")
    from plat.export import export_bundle

    bundle = tmp_path / "bundle"
    export_bundle(write_run(tmp_path / "plat", small_policy("residual_latent")), bundle)
    for what, factors in {"stiffness": (2, 1, 1), "damping": (1, 2, 1), "effort_limit": (1, 1, 2)}.items():
        motors = (G1.stiffness, G1.damping, G1.effort_limit)
        tuned = tuned_robot(G1, "other", *(factor * values for factor, values in zip(factors, motors, strict=True)))
        with pytest.raises(BundleError, match=f"its {what} is not that of robot"):
            Entrant.of_bundle(bundle, tuned)
    with pytest.raises(BundleError, match="its default_joint_pos is not that of robot"):
        Entrant.of_bundle(bundle, replace(G1, name="upright", default_pose={}))
    # of as many keypoints, in another order
    with pytest.raises(BundleError, match="its keypoints are not those of robot"):
        Entrant.of_bundle(bundle, replace(G1, name="other", keypoints=(G1.keypoints[0], *G1.keypoints[:0:-1])))


def test_a_module_that_acts_is_no_policy_that_could_be_an_entrant() -> None:
    with pytest.raises(ConfigError, match=r"policy is a DeployedPolicy, expected one as plat.load and load_policy"):
        Entrant.of_policy(small_policy("latent").deployed())
