"""Policies of different timings live in one process, and each is right; a timing travels from training to the robot."""

import copy
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
import torch
from tensordict.nn import TensorDictModule, TensorDictSequential

from plat.collectors import ExpertLabels, MixedPolicy, dagger_buffer, rollouts
from plat.control import Chase, PolicyController, Simulator
from plat.deploy import PolicyRunner
from plat.envs import make_keyframe_env
from plat.envs.transforms import Horizon
from plat.envs.transforms.settings import NoiseLevels
from plat.errors import BundleError, KeyframeError, PlatError, StateError
from plat.evaluation import evaluate
from plat.evaluation.entrant import Entrant
from plat.keyframes import KeyframeSequence, standing
from plat.modules import STUDENT_KEYS, Expert, ExpertConfig, LatentPolicy, ResidualLatentPolicy
from plat.motions import MotionLibrary
from plat.objectives import LatentImitationLoss, exploring
from plat.robots import G1
from plat.runs import load_policy, policy_spec, save_weights, write_json
from plat.spec.timing import Timing, timing_of
from plat.tasks.disturbed import measuring
from tests.modules.policies.test_student import SMALL

SLOW, QUICK = Timing(max_steps=150), Timing(max_steps=50)
POSE = standing(G1)


def student(timing: Timing) -> LatentPolicy:
    return LatentPolicy(G1, replace(SMALL, timing=timing))


class Watched(torch.nn.Module):
    """A deployed policy, and the horizons that it observed."""

    def __init__(self, policy: LatentPolicy):
        super().__init__()
        self.policy, self.timing, self.horizons = policy.deployed(), policy.timing, []

    def forward(self, tensordict):
        self.horizons += tensordict["command", "horizon"].flatten().tolist()
        return self.policy(tensordict)


@pytest.mark.parametrize("timing", [QUICK, SLOW], ids=["50", "150"])
def test_each_environment_scales_time_by_its_own_timing(library, timing):
    env = make_keyframe_env(library, 64, timing=timing)
    command = env.reset()["command"]
    torch.testing.assert_close(command["horizon"], command["steps_left"] / timing.max_steps)
    assert (command["steps_left"] > 50).any() == (timing is SLOW)


def test_environments_of_two_timings_side_by_side(library):
    quick, slow = (make_keyframe_env(library, 4, horizon=Horizon(30, 40), timing=timing) for timing in (QUICK, SLOW))
    for env, longest in ((quick, 50), (slow, 150), (quick, 50)):
        command = env.reset()["command"]
        torch.testing.assert_close(command["horizon"], command["steps_left"] / longest)


def test_evaluation_takes_the_timing_of_the_policy(library):
    seen = {}
    for timing in (QUICK, SLOW):
        watched = Watched(student(timing))
        evaluate(watched, library, Horizon(50, 50))
        seen[timing.max_steps] = max(watched.horizons)
    assert seen == pytest.approx({50: 1.0, 150: 1 / 3})
    with pytest.raises(PlatError, match="horizon of 51 to 150 steps: 150 control steps, expected at most .* 50"):
        evaluate(student(QUICK).deployed(), library, Horizon(51, 150))


def test_what_is_put_around_a_policy_keeps_its_timing(library):
    policy, same = student(SLOW), TensorDictModule(torch.nn.Identity(), ["action"], ["action"])
    expert = Expert(G1, ExpertConfig(hidden=(8,), timing=SLOW))
    refined = ResidualLatentPolicy(policy)
    views = (policy.deployed(), policy.sampled(), policy.imagined(), expert.actor(), refined.actor())
    for view in views:
        for around in (view, TensorDictSequential(view, same), exploring(view, 0.0), measuring(view, NoiseLevels())):
            assert timing_of(around) == SLOW
            assert timing_of(copy.deepcopy(around)) == SLOW
    teacher = Expert(G1, ExpertConfig(hidden=(8,))).labels()
    assert timing_of(MixedPolicy(policy.sampled(), teacher)) == SLOW
    assert timing_of(TensorDictSequential(same)) is None
    around = exploring(policy.deployed(), 0.0)
    assert PolicyController(around, G1).timing == SLOW
    evaluate(around, library.only(0), Horizon(51, 150), num_envs=1)  # the default would refuse so long a horizon
    with pytest.raises(PlatError, match="TensorDictSequential of parts with .*max_steps=150.* and .*max_steps=50"):
        evaluate(TensorDictSequential(policy.deployed(), teacher), library, Horizon(1, 5))


class Smooth(LatentPolicy):
    """Of a user, whose deployed() is of parts without a timing."""

    def deployed(self):
        return TensorDictSequential(self.features(), self.decoder.using("hidden", self.mode))


class OwnExpert(Expert):
    """The same of an expert."""

    def deployed(self, *goals, **options):
        return TensorDictSequential(*super().deployed(*goals, **options).module)


def test_an_entrant_has_the_timing_of_its_policy():
    smooth = Smooth(G1, replace(SMALL, timing=SLOW))
    expert = OwnExpert(G1, ExpertConfig(hidden=(8,), timing=SLOW))
    assert timing_of(smooth.deployed()) is timing_of(expert.deployed()) is None
    for entrant in (Entrant.of_policy(smooth), Entrant.of_policy(expert), Entrant.of_policy(expert, dense=True)):
        assert entrant.timing == timing_of(entrant.policy) == SLOW


def test_motions_of_another_control_step_are_refused(library):
    policy = student(Timing(control_dt=0.01)).deployed()
    with pytest.raises(PlatError, match=r"motion library of \d+ clips: control step of 0.02 s, expected .* 0.01 s"):
        evaluate(policy, library, Horizon(1, 5))


def test_sequences_are_as_long_as_their_timing_allows():
    far = POSE.at(2.0)
    with pytest.raises(KeyframeError, match=r"100 control steps after 0 s, expected at most 50 \(1 s\)"):
        KeyframeSequence(G1, POSE, (far,), QUICK)
    slow = KeyframeSequence(G1, POSE, (far,), SLOW)
    assert slow.command(0.5).steps_left == 75
    with pytest.raises(KeyframeError, match="expected at most 50"):
        slow.with_timing(QUICK)
    assert slow.with_timing(QUICK, split=True).arrival_steps == (50, 100)
    assert slow.with_timing(Timing(control_dt=0.05, max_steps=40)).arrival_steps == (40,)


def test_a_chase_goes_by_the_timing_of_its_policy():
    sequence = KeyframeSequence(G1, POSE, (POSE.at(2.0),), SLOW)
    chase = Chase(PolicyController(student(SLOW).deployed(), G1), sequence, Simulator(G1.model()))
    assert next(chase).command.steps_left == 100
    quick = PolicyController(student(QUICK).deployed(), G1)
    with pytest.raises(KeyframeError, match="expected at most 50"):
        Chase(quick, sequence, Simulator(G1.model()))
    with pytest.raises(KeyframeError, match="expected at most 50"):
        chase.controller = quick
    assert next(chase).command.steps_left == 99  # the policy before goes on
    faster = PolicyController(student(Timing(control_dt=0.01, max_steps=300, window=5)).deployed(), G1)
    with pytest.raises(PlatError, match=r"simulator: control step of 0.02 s, expected the policy's 0.01 s"):
        Chase(faster, sequence, Simulator(G1.model()))
    steps = [next(fast) for fast in [Chase(faster, sequence, Simulator(G1.model(), control_dt=0.01))] for _ in range(2)]
    assert [(step.time, step.command.steps_left) for step in steps] == [(0.01, 200), (0.02, 199)]


def test_an_arrival_window_is_that_of_the_policy():
    controller = PolicyController(student(replace(QUICK, window=4)).deployed(), G1)
    chase = Chase(controller, KeyframeSequence(G1, POSE, (POSE.at(0.12),)), Simulator(G1.model()))
    assert [step.in_window for step in chase] == [False, False, True, True, True, True]


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A student of 100 steps that was trained for two iterations, and its run."""
    torch.manual_seed(0)
    from plat.motions import generate_motions

    library = MotionLibrary.from_clips(generate_motions("train", seconds=8))
    policy = student(Timing(max_steps=100, window=4))
    expert = Expert(G1, ExpertConfig(hidden=(8,)))
    labels = expert.deployed(tuple(expert.dense_goals), out_key="expert_action")
    env = make_keyframe_env(library, 8, timing=policy.timing, dense_goals=expert.dense_goals)
    buffer = dagger_buffer(library, 200, 32, 5, "cpu")
    loss = LatentImitationLoss(policy.training_graph(), prior_weight=1.0, beta=0.01)
    optimizer = torch.optim.Adam(policy.parameters(), lr=1e-3)
    label = ExpertLabels(labels, STUDENT_KEYS)
    for rollout in islice(rollouts(env, MixedPolicy(policy.sampled(), labels, 0.5), steps=4), 2):
        states = label(rollout)
        buffer.extend(states)
        policy.update_normalizers(states)
        losses = loss(buffer.sample())
        optimizer.zero_grad()
        sum(value for name, value in losses.items() if name.startswith("loss_")).backward()
        optimizer.step()
    run = tmp_path_factory.mktemp("runs") / "toy"
    run.mkdir()
    write_json(run / "config.json", {"policy": policy_spec(policy)})
    save_weights(run / "model.safetensors", policy)
    return policy.eval(), run


def test_a_timing_travels_from_training_to_the_runner(trained, tmp_path):
    for package in ("onnx", "onnxscript", "onnxruntime"):
        pytest.importorskip(package)
    from plat.export import export_bundle

    policy, run = trained
    loaded = load_policy(run)
    assert loaded.timing == policy.timing == Timing(max_steps=100, window=4)
    export_bundle(run, tmp_path / "bundle")
    runner = PolicyRunner(tmp_path / "bundle", control_dt=0.02)
    assert runner.timing == policy.timing
    simulator = Simulator(G1.model())
    simulator.reset(POSE)
    torch_policy = PolicyController(loaded.deployed(), G1)
    for steps_left in (100, 37):
        ours, theirs = (make(simulator.state(), POSE, steps_left) for make in (runner, torch_policy))
        np.testing.assert_allclose(ours, theirs, atol=1e-4)
    with pytest.raises(StateError, match=r"101 control steps \(2.02 s\), expected more than 0 and at most 100 \(2 s\)"):
        runner(simulator.state(), POSE, 101)
    sequence = KeyframeSequence(G1, POSE, (POSE.at(2.0),), SLOW)
    assert next(Chase(runner, sequence, Simulator(G1.model()))).command.steps_left == 100
    with pytest.raises(BundleError, match="control step of 0.02 s, not the 0.01 s of this robot"):
        PolicyRunner(tmp_path / "bundle", control_dt=0.01)
