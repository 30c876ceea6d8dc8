from pathlib import Path

import pytest
import torch
from tensordict import TensorDict

from plat.errors import ConfigError
from plat.modules import (
    Expert,
    ExpertConfig,
    LatentPolicy,
    LatentPolicyConfig,
    PlainPolicy,
    PlainPolicyConfig,
    take_over,
)
from plat.robots import G1, get_robot
from plat.spec.observation import entry_shapes
from plat.spec.timing import Timing


def observation(count=16, steps_left=10, timing=None):
    torch.manual_seed(0)
    groups = {
        group: {name: torch.randn(count, *shape) for name, shape in entry_shapes(group, G1).items()}
        for group in ("robot", "goal", "parts", "clock")
    }
    tau = steps_left / (timing or Timing()).max_steps
    return TensorDict({**groups, "command": {"horizon": torch.full((count, 1), tau)}}, [count])


@pytest.mark.parametrize("kind", [(PlainPolicy, PlainPolicyConfig), (LatentPolicy, LatentPolicyConfig)])
def test_a_student_that_sees_more_acts_like_the_trained_one(kind):
    policy, config = kind
    torch.manual_seed(1)
    trained = policy(G1)
    trained.normalizer.update(observation(64))
    trained.normalizer.var[-1] = 0.09
    student = policy(G1, config(also=("parts", "clock"), timing=Timing(max_steps=150)))
    take_over(student, trained)
    for steps in (1, 10, 50):
        wanted = trained.deployed()(observation(steps_left=steps))["action"]
        actual = student.deployed()(observation(steps_left=steps, timing=student.timing))["action"]
        torch.testing.assert_close(actual, wanted, atol=1e-4, rtol=1e-4)


def test_wider_layers_change_nothing_at_first():
    trained = PlainPolicy(G1)
    student = PlainPolicy(G1, PlainPolicyConfig(backbone=(700,), hidden_size=300, decoder=(300, 200), also=("clock",)))
    take_over(student, trained)
    shown = observation()
    torch.testing.assert_close(student.deployed()(shown)["action"], trained.deployed()(shown)["action"])
    # and the new units can learn
    student.deployed()(shown)["action"].square().sum().backward()
    assert (student.decoder.network[-1].weight.grad[:, 128:] != 0).any()


@pytest.mark.parametrize("wider", [{"latent_size": 48}, {"encoder_size": 192}, {"latent_size": 40, "prior": (300,)}])
def test_a_wider_latent_teaches_and_explores_as_the_narrower_one(wider):
    torch.manual_seed(1)
    trained = LatentPolicy(G1)
    student = LatentPolicy(G1, LatentPolicyConfig(**wider))
    take_over(student, trained)
    shown = observation()
    goals = {"frames": torch.randn(16, 7, 80), "length": torch.randint(1, 8, (16,))}
    shown["privileged_goal"] = TensorDict(goals, [16])
    ours, theirs = (policy.training_graph()(shown.clone()) for policy in (student, trained))
    for group in ("prior", "posterior"):
        for name in ("loc", "scale"):
            torch.testing.assert_close(ours[group, name][:, :32], theirs[group, name])
    # what only the wider one has moves nothing yet
    ours = student.decoder.using("hidden", "z")(ours.set("z", ours["posterior", "loc"]))
    theirs = trained.decoder.using("hidden", "z")(theirs.set("z", theirs["posterior", "loc"]))
    torch.testing.assert_close(ours["action"], theirs["action"])


@pytest.mark.parametrize("layers", [{"backbone": (256,)}, {"backbone": (512, 512)}, {"backbone": ()}])
def test_other_layers_are_refused(layers):
    student = PlainPolicy(G1, PlainPolicyConfig(**layers))
    with pytest.raises(ConfigError, match=r"backbone.module.0"):
        take_over(student, PlainPolicy(G1))


def test_a_latent_student_keeps_its_hidden_size():
    student = LatentPolicy(G1, LatentPolicyConfig(hidden_size=300))
    with pytest.raises(ConfigError, match="hidden_size"):
        take_over(student, LatentPolicy(G1))


def test_a_trained_student_that_sees_more_is_refused():
    with pytest.raises(ConfigError, match="'clock'"):
        take_over(PlainPolicy(G1), PlainPolicy(G1, PlainPolicyConfig(also=("clock",))))


def test_weights_of_a_robot_with_other_joints_are_refused():
    toy = get_robot(str(Path(__file__).parents[1] / "robots" / "toy.json"))
    small = ExpertConfig(hidden=(8,))
    message = r"trained on '.*', which has \d+ joints, expected \d+ as '.*' has"
    for one, other in ((G1, toy), (toy, G1)):
        with pytest.raises(ConfigError, match=message):
            take_over(PlainPolicy(one), PlainPolicy(other))
        with pytest.raises(ConfigError, match=message):
            Expert(one, small).start_from(Expert(other, small))
