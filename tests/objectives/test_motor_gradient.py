import pytest
import torch
from tensordict import TensorDict

from plat.objectives import MotorGradientConfig, motor_gradient
from plat.robots import G1

PLAIN = MotorGradientConfig(weight=1.0, legs=1.0)


@pytest.fixture
def rollout() -> TensorDict:
    """Two robots, twelve steps; the reference stands in the default pose, and so do the robots."""
    batch = [2, 12]
    return TensorDict(
        {
            "robot": {"joint_pos": torch.zeros(*batch, 29)},
            "goal": {"joint_pos": G1.default_joint_pos.expand(*batch, 29).clone()},
            "next": {"done": torch.zeros(*batch, 1, dtype=torch.bool)},
        },
        batch,
    )


def test_an_error_answers_for_the_action_some_steps_before(rollout):
    rollout["robot", "joint_pos"][0, 7, 20] = 0.3
    gradient = motor_gradient(rollout, G1, MotorGradientConfig(weight=2.0, steps=3))
    assert gradient.nonzero().tolist() == [[0, 4, 20]]
    torch.testing.assert_close(gradient[0, 4, 20] * G1.action_scale[20], torch.tensor(0.6))


def test_the_reference_is_that_of_the_same_frame(rollout):
    times = torch.arange(12.0)[None, :, None]
    rollout["robot", "joint_pos"] = (0.01 * times).expand(2, 12, 29).clone()
    for ahead in (1, 3):  # a goal that is shown now is where the robot will be
        rollout["goal", "joint_pos"] = G1.default_joint_pos + 0.01 * (times + ahead).expand(2, 12, 29)
        torch.testing.assert_close(motor_gradient(rollout, G1, PLAIN, ahead=ahead), torch.zeros(2, 12, 29))


def test_nothing_is_learnt_across_an_end(rollout):
    rollout["robot", "joint_pos"] += 0.1
    rollout["next", "done"][1, 5] = True
    gradient = motor_gradient(rollout, G1, PLAIN)
    learnt = gradient.abs().sum(-1) > 0
    assert learnt[0].tolist() == [True] * 8 + [False] * 4
    assert learnt[1].tolist() == [True] * 2 + [False] * 4 + [True] * 2 + [False] * 4


def test_a_rollout_that_is_too_short_teaches_nothing(rollout):
    rollout["robot", "joint_pos"] += 0.1
    assert not motor_gradient(rollout, G1, MotorGradientConfig(steps=12)).any()


def test_legs_have_a_factor_of_their_own(rollout):
    rollout["robot", "joint_pos"] += 0.1
    config = MotorGradientConfig(weight=1.0, legs=0.25)
    ratio = motor_gradient(rollout, G1, config)[0, 0] / motor_gradient(rollout, G1, PLAIN)[0, 0]
    torch.testing.assert_close(ratio, torch.tensor([0.25] * 12 + [1.0] * 17))


def test_a_reference_that_is_not_in_the_rollout_is_an_error(rollout):
    with pytest.raises(ValueError, match="steps is 1: the reference of fewer than 2 steps"):
        motor_gradient(rollout, G1, MotorGradientConfig(steps=1), ahead=2)
