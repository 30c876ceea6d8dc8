import copy

import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torch import nn

from plat.collectors import collect
from plat.control import PolicyController
from plat.entries import check_entries, expects
from plat.envs import make_keyframe_env
from plat.envs.transforms import HORIZONS
from plat.errors import ConfigError, ObservationError
from plat.evaluation import evaluate, evaluate_clips
from plat.modules import Critic, Expert, ExpertConfig, LatentPolicy, PlainPolicy
from plat.robots import G1
from plat.spec.observation import observation_widths, student_keys
from tests.modules.policies.test_student import SMALL

SHAPES = {("robot", "joint_pos"): (3,), "frames": ("L", 4), "points": ("3 K",)}


def entries(**changed: torch.Tensor) -> TensorDict:
    values = {"frames": torch.zeros(2, 5, 4), "points": torch.zeros(2, 6), **changed}
    return TensorDict({"robot": {"joint_pos": values.pop("joint_pos", torch.zeros(2, 3))}, **values}, [2])


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"joint_pos": torch.zeros(2, 4)}, r"entry \('robot', 'joint_pos'\) has shape \(2, 4\), expected \[\*B, 3\]"),
        ({"joint_pos": torch.zeros(2)}, r"has shape \(2,\), expected \[\*B, 3\]|has batch"),
        ({"joint_pos": torch.zeros(2, 3).int()}, "is int32, expected float32"),
        ({"frames": torch.zeros(2, 5, 3)}, r"entry 'frames' has shape \(2, 5, 3\), expected \[\*B, L, 4\]"),
        (
            {"frames": torch.zeros(2, 4)},
            r"entry 'frames' .* batch \(\), expected \(2,\) as of .*joint_pos",
        ),
        ({"points": torch.zeros(2, 7)}, r"entry 'points' has shape \(2, 7\), expected \[\*B, 3 K\]"),
    ],
)
def test_wrong_entries_are_named(changed, message):
    with pytest.raises(ObservationError, match=f"^step: .*(?:{message})"):
        check_entries(entries(**changed), SHAPES, "step")


def test_right_entries_pass_whatever_their_batch():
    check_entries(entries(), SHAPES, "step")
    check_entries(entries()[0], SHAPES, "step")
    check_entries(entries().expand(7, 2), SHAPES, "step")
    check_entries(entries(joint_pos=torch.zeros(2, 3).double()), SHAPES, "step")


def test_missing_entries_are_named():
    with pytest.raises(ObservationError, match=r"step: no entry 'points', expected one of shape \[\*B, 3 K\]"):
        check_entries(entries().exclude("points"), SHAPES, "step")
    with pytest.raises(ObservationError, match="step: got a dict, expected a TensorDict"):
        check_entries({}, SHAPES, "step")


@pytest.mark.parametrize(
    ("policy", "message"),
    [
        (None, "policy is a NoneType, expected a module of a TensorDict that writes 'action'$"),
        (
            LatentPolicy(G1, SMALL),
            r"policy is a LatentPolicy, .* that writes 'action', as its deployed\(\) and sampled",
        ),
        (TensorDictModule(nn.Linear(3, 2), in_keys=["x"], out_keys=["y"]), "policy writes 'y', expected a module"),
    ],
)
def test_what_cannot_act_is_named(library, policy, message):
    with pytest.raises(ConfigError, match=f"^evaluate: {message}"):
        evaluate(policy, library, HORIZONS["long"])
    with pytest.raises(ConfigError, match=f"^evaluate_clips: {message}"):
        evaluate_clips(policy, library, "humantracker")
    with pytest.raises(ConfigError, match=f"^controller: {message}"):
        PolicyController(policy, G1)
    for workers in (0, 1):
        with pytest.raises(ConfigError, match=f"^rollouts: {message}"):
            collect(make_keyframe_env, library, 2, policy, steps=2, workers=workers)


def test_a_module_checks_what_it_is_called_with():
    layer = expects(TensorDictModule(nn.Linear(3, 2), in_keys=["x"], out_keys=["y"]), {"x": (3,)}, "layer")
    for module in (layer, copy.deepcopy(layer)):
        with pytest.raises(ObservationError, match="layer: entry 'x' has shape"):
            module(TensorDict({"x": torch.zeros(5, 4)}, [5]))
        with pytest.raises(ObservationError, match="layer: entry 'x' is float64, expected float32"):
            module(TensorDict({"x": torch.zeros(5, 3).double()}, [5]))
        assert module(torch.zeros(5, 3)).shape == (5, 2)
    assert layer.double()(TensorDict({"x": torch.zeros(5, 3).double()}, [5]))["y"].dtype == torch.float64


@pytest.mark.parametrize(
    "make",
    [
        lambda: Expert(G1, ExpertConfig(hidden=(8,))).deployed(),
        lambda: Expert(G1, ExpertConfig(hidden=(8,), ahead=(1, 2), lead=0.1, action="reference_velocity")).actor(),
        lambda: LatentPolicy(G1, SMALL).deployed(),
        lambda: LatentPolicy(G1, SMALL).sampled(),
        lambda: PlainPolicy(G1, SMALL).deployed(),
        lambda: Critic(G1, student_keys(), (8,)).observe(),
    ],
)
def test_policies_name_every_wrong_entry(make):
    module = make()
    widths = observation_widths(module.in_keys, G1)
    right = TensorDict({}, [2])
    for key, width in zip(module.in_keys, widths, strict=True):
        right[key] = torch.zeros(2, width)
    module(right.clone())
    for key, width in zip(module.in_keys, widths, strict=True):
        for wrong in (torch.zeros(2, width + 1), torch.zeros(2, width).long(), torch.zeros(2, width).double()):
            with pytest.raises(ObservationError, match=key[1]):
                module(right.clone().set(key, wrong))
        with pytest.raises(ObservationError, match=f"no entry .*{key[1]}"):
            module(right.clone().exclude(key))
