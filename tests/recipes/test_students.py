"""Recipes that go on from a policy of a class of one's own."""

from dataclasses import dataclass, replace

import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torch import nn

from plat.errors import CheckpointError
from plat.modules import Expert, ExpertConfig, LatentPolicy, LatentPolicyConfig
from plat.recipes.experts import make_expert, trained_expert
from plat.recipes.options import DistillRecipe, ExpertRecipe
from plat.recipes.students import make_student, trained_student
from plat.robots import G1
from plat.runs import policies, register_policy
from plat.spec.observation import entry_shapes
from plat.spec.timing import Timing
from tests.recipes.runs import save_run

ANY = {"motions": ("a",), "steps": 1, "device": "cpu"}


class OwnExpert(Expert):
    """An expert with another network."""

    @classmethod
    def build(cls, robot, config):
        layers = (nn.LazyLinear(8), nn.ReLU(), nn.LazyLinear(robot.num_joints))
        return cls(robot, config, network=nn.Sequential(nn.Identity(), *layers))


@dataclass(frozen=True)
class OwnConfig(LatentPolicyConfig):
    """A config with a setting more."""

    slope: float = 0.5


class OwnStudent(LatentPolicy):
    """A student with another backbone."""

    @classmethod
    def build(cls, robot, config):
        layers = nn.Sequential(nn.LazyLinear(config.hidden_size), nn.LeakyReLU(config.slope))
        return cls(robot, config, backbone=TensorDictModule(layers, ["observation"], ["hidden"]))


@pytest.fixture(autouse=True)
def _registered(monkeypatch):
    monkeypatch.setattr(policies, "_KINDS", dict(policies._KINDS))
    register_policy("own_expert", OwnExpert, ExpertConfig)
    register_policy("own_student", OwnStudent, OwnConfig)


def observed(count: int = 4) -> TensorDict:
    groups = {
        group: {name: torch.randn(count, *shape) for name, shape in entry_shapes(group, G1).items()}
        for group in ("robot", "goal", "command")
    }
    return TensorDict(groups, [count])


def saved(folder, policy):
    policy.deployed()(observed())
    return save_run(folder, policy)


def going_on(make, load, recipe):
    shaped, trained = load(recipe)
    return make(shaped, G1, trained)


def test_an_expert_of_ones_own_goes_on_as_one(tmp_path):
    run = saved(tmp_path / "own", OwnExpert.build(G1, ExpertConfig(hidden=(8,))))
    recipe, trained = trained_expert(ExpertRecipe(**ANY, out=tmp_path, init=run))
    expert = make_expert(recipe, G1, trained)
    assert type(expert) is OwnExpert
    shown = observed()
    torch.testing.assert_close(expert.deployed()(shown.clone())["action"], trained.deployed()(shown)["action"])


def test_an_expert_of_ones_own_sees_the_same_frames(tmp_path):
    run = saved(tmp_path / "own", OwnExpert.build(G1, ExpertConfig()))
    recipe = ExpertRecipe(**ANY, out=tmp_path, init=run, policy=ExpertConfig(ahead=(1, 2)))
    with pytest.raises(CheckpointError, match="its network is its own: expected the same frames"):
        going_on(make_expert, trained_expert, recipe)


def test_a_student_of_ones_own_goes_on_as_one(tmp_path):
    config = OwnConfig(hidden_size=16, latent_size=4, slope=0.1)
    run = saved(tmp_path / "own", OwnStudent.build(G1, config))
    recipe = DistillRecipe(**ANY, out=tmp_path, init=run, expert=tmp_path)
    shaped, trained = trained_student(recipe)
    student = make_student(shaped, G1, trained)
    assert type(student) is OwnStudent
    assert student.config == config
    shown = observed()
    torch.testing.assert_close(student.deployed()(shown.clone())["action"], trained.deployed()(shown)["action"])
    # settings that only its own class has stay where others are given
    wider = replace(recipe, policy=LatentPolicyConfig(hidden_size=16, latent_size=6))
    assert going_on(make_student, trained_student, wider).config == replace(config, latent_size=6)


def test_a_student_with_a_backbone_of_its_own_observes_the_same(tmp_path):
    run = saved(tmp_path / "own", OwnStudent.build(G1, OwnConfig()))
    policy = LatentPolicyConfig(timing=Timing(max_steps=150))
    recipe = DistillRecipe(**ANY, out=tmp_path, init=run, expert=tmp_path, policy=policy)
    with pytest.raises(CheckpointError, match="backbone is its own: expected the same also and timing.max_steps"):
        going_on(make_student, trained_student, recipe)
