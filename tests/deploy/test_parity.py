"""The same keyframes through torch and through an exported policy: the same trajectory."""

from pathlib import Path

import numpy as np
import pytest

from plat.control import Chase, PolicyController, Simulator
from plat.deploy import PolicyRunner
from plat.export import export_bundle
from plat.keyframes import KeyframeSequence
from plat.motions.generation import generate_named
from plat.robots import G1
from plat.runs import load_policy

STEPS = 500
WEIGHTS = Path(__file__).parents[2] / "plat" / "weights" / "plat"


@pytest.fixture(scope="module")
def sequence() -> KeyframeSequence:
    """Kicks, a keyframe every half second."""
    clip = generate_named("generated:val/kick@6")[0]
    return KeyframeSequence.from_motion(clip, np.arange(0.5, clip.duration, 0.5).tolist(), G1)


@pytest.fixture(scope="module", params=["random", "trained"])
def policy(request, run, bundle, tmp_path_factory) -> tuple[Path, Path]:
    """Run and bundle: one that falls, and one that does not."""
    if request.param == "random":
        return run, bundle
    folder = tmp_path_factory.mktemp("bundles") / "trained"
    export_bundle(WEIGHTS, folder)
    return WEIGHTS, folder


@pytest.fixture(scope="module")
def torch_steps(policy, sequence):
    controller = PolicyController(load_policy(policy[0]).deployed(), G1)
    chase = Chase(controller, sequence, Simulator(G1.model()), hold=STEPS * 0.02)
    return [step for step, _ in zip(chase, range(STEPS), strict=False)]


def test_joint_targets_agree_at_every_state(policy, torch_steps):
    runner = PolicyRunner(policy[1], G1.joint_names)
    assert len(torch_steps) == STEPS
    for step in torch_steps:
        target = runner(step.before, step.command.keyframe, step.command.steps_left)
        np.testing.assert_allclose(target, step.joint_target, atol=1e-5)


def test_trajectories_agree(policy, sequence, torch_steps):
    chase = Chase(PolicyRunner(policy[1]), sequence, Simulator(G1.model()), hold=STEPS * 0.02)
    for step, expected in zip(chase, torch_steps, strict=False):
        # a foot that lands a physics step earlier makes a thousandth of 1e-6
        np.testing.assert_allclose(step.after.root_pos_w, expected.after.root_pos_w, atol=5e-3)
        np.testing.assert_allclose(step.after.joint_pos, expected.after.joint_pos, atol=5e-3)
