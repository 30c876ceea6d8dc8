import numpy as np
import pytest
import torch
from tensordict.nn import TensorDictModule
from torchrl.envs.utils import ExplorationType, set_exploration_type

from plat.control import PolicyController, Simulator
from plat.deploy import RobotState
from plat.envs import make_keyframe_env
from plat.errors import ActionError, PlatError, StateError
from plat.keyframes import Keyframe, standing
from plat.modules import Expert, ExpertConfig, LatentPolicy, LatentPolicyConfig, PlainPolicy
from plat.modules.policies.student import STUDENT_KEYS
from plat.robots import G1

SMALL = LatentPolicyConfig(backbone=(16,), hidden_size=8, decoder=(8,), prior=(8,), posterior=(8,), latent_size=4)


def policies():
    torch.manual_seed(0)
    return [LatentPolicy(G1, SMALL), PlainPolicy(G1), Expert(G1, ExpertConfig(hidden=(16,)))]


class Recorder(torch.nn.Module):
    """A policy that keeps what it is shown and answers with noise."""

    def __init__(self):
        super().__init__()
        self.seen = []

    def forward(self, tensordict):
        self.seen.append({key: tensordict[key].clone() for key in STUDENT_KEYS})
        tensordict["action"] = 0.3 * torch.randn(1, 29)
        return tensordict


def state_of(env, row: int) -> RobotState:
    """The environment's robot, as a simulator of its own shows it."""
    simulator = Simulator(G1.model())
    simulator.reset(standing(G1))
    simulator.data.qpos[:] = env.base_env.physics.read("qpos")[row]
    simulator.data.qvel[:] = env.base_env.physics.read("qvel")[row]
    return simulator.state()


def keyframe_of(library, frame: torch.Tensor) -> Keyframe:
    pose = library.poses(frame)
    parts = (pose["keypoint_pos"][0], pose["keypoint_quat"][0], pose["joint_pos"])
    return Keyframe.from_qpos(1.0, torch.cat(parts).numpy())


def test_what_no_policy_can_follow_is_one_line():
    with pytest.raises(PlatError, match="controller: timing is 0.02, expected a Timing"):
        PolicyController(PlainPolicy(G1).deployed(), G1, 0.02)
    controller, simulator = PolicyController(PlainPolicy(G1).deployed(), G1), Simulator(G1.model())
    for steps_left in (0, 51, None, "10", np.nan):
        with pytest.raises(StateError, match="steps_left is .*, expected above 0 and at most 50"):
            controller(simulator.state(), standing(G1), steps_left)
    with pytest.raises(StateError, match="joint_target is 'rest', expected 29 numbers"):
        controller.reset("rest")


def test_a_policy_sees_what_the_training_environment_shows(library):
    env = make_keyframe_env(library, num_envs=2)
    recorder = Recorder()
    controller = PolicyController(recorder, G1)
    tensordict = env.reset()
    target = None
    for _ in range(30):
        controller.reset(target)
        keyframe = keyframe_of(library, tensordict["command", "target_frame"][0])
        target = controller(state_of(env, 0), keyframe, int(tensordict["command", "steps_left"][0]))
        for key, value in recorder.seen[-1].items():
            np.testing.assert_allclose(value[0], tensordict[key][0], atol=2e-5, err_msg=str(key))
        action = (torch.from_numpy(target).float() - G1.default_joint_pos) / G1.action_scale
        tensordict["action"] = action.expand(2, -1)
        tensordict, following = env.step_and_maybe_reset(tensordict)
        if tensordict["next", "done"][0]:
            target = None
        tensordict = following
    env.close()


@pytest.mark.parametrize("policy", policies(), ids=lambda policy: type(policy).__name__)
def test_targets_are_those_of_the_action(policy, library):
    env = make_keyframe_env(library, num_envs=1)
    tensordict = env.reset()
    with torch.no_grad(), set_exploration_type(ExplorationType.DETERMINISTIC):
        action = policy.deployed()(tensordict.clone())["action"][0]
    keyframe = keyframe_of(library, tensordict["command", "target_frame"][0])
    controller = PolicyController(policy.deployed(), G1)
    target = controller(state_of(env, 0), keyframe, int(tensordict["command", "steps_left"][0]))
    np.testing.assert_allclose(target, G1.default_joint_pos + G1.action_scale * action, atol=1e-5)
    env.close()


def test_the_last_action_is_remembered_until_a_reset_and_can_be_handed_over():
    simulator = Simulator(G1.model())
    simulator.reset(standing(G1))
    state, recorder = simulator.state(), Recorder()
    controller = PolicyController(recorder, G1)
    target = controller(state, standing(G1), 5)
    controller(state, standing(G1), 4)
    controller.reset()
    controller(state, standing(G1), 3)
    controller.reset(target)
    controller(state, standing(G1), 2)
    zero, kept, forgotten, handed = (seen["robot", "last_action"][0] for seen in recorder.seen)
    assert not zero.any()
    assert kept.any()
    assert not forgotten.any()
    np.testing.assert_allclose(handed, kept, atol=1e-6)


def test_an_action_that_is_not_finite_is_not_remembered():
    simulator = Simulator(G1.model())
    simulator.reset(standing(G1))

    class Broken(Recorder):
        def forward(self, tensordict):
            tensordict = super().forward(tensordict)
            if len(self.seen) == 2:
                tensordict["action"][0, 3] = torch.nan
            return tensordict

    recorder = Broken()
    controller = PolicyController(recorder, G1)
    target = controller(simulator.state(), standing(G1), 5)
    with pytest.raises(ActionError, match="the policy's action for joint 'left_knee' is nan"):
        controller(simulator.state(), standing(G1), 4)
    controller(simulator.state(), standing(G1), 3)
    kept = G1.default_joint_pos + G1.action_scale * recorder.seen[-1]["robot", "last_action"][0]
    np.testing.assert_allclose(kept, target, atol=1e-6)


@pytest.mark.parametrize("width", [1, 28])
def test_an_action_of_another_size_is_refused(width):
    simulator = Simulator(G1.model())
    simulator.reset(standing(G1))
    policy = TensorDictModule(lambda joint_pos: joint_pos[:, :width], [("robot", "joint_pos")], ["action"])
    with pytest.raises(ActionError, match=rf"shape \(1, {width}\) for one robot, expected \[\*B, 29\]"):
        PolicyController(policy, G1)(simulator.state(), standing(G1), 5)
