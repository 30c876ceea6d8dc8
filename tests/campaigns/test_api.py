"""A part of the campaign: every field of every configuration, and calls without sense."""

import pytest
import torch

from plat.modules import (
    FinetunedPolicy,
    LatentNoisePolicy,
    LatentPolicy,
    ResidualActionPolicy,
    ResidualLatentPolicy,
)
from plat.objectives import LatentImitationLoss
from plat.robots import G1
from tests.campaigns.api import Misuse, calls, faults, settings
from tests.campaigns.arguments import misplaced, trips
from tests.modules.policies.test_student import SMALL


def test_settings_without_sense_are_refused():
    misuses = list(settings())
    assert len(misuses) >= 200
    assert [misuse.name for misuse in misuses if faults(misuse)[0]] == []


def test_calls_without_sense_are_refused(tmp_path):
    misuses = list(calls(tmp_path))
    assert len(misuses) >= 100
    assert {misuse.name: faults(misuse) for misuse in misuses if faults(misuse)[0]} == {}


@pytest.mark.slow
def test_arguments_of_another_kind_are_taken_or_refused_in_one_line(tmp_path):
    found = {name: trips(call) for name, call in misplaced(tmp_path)}
    assert len(found) >= 600
    assert {name: fault for name, fault in found.items() if fault} == {}


def test_a_trip_is_found():
    assert trips(lambda: torch.zeros(2).nothing) == "AttributeError: 'Tensor' object has no attribute 'nothing'"
    assert trips(lambda: G1.joint_names[-1]) == ""


def test_a_fault_is_found():
    assert faults(Misuse("fine", "", lambda: None))[0] == "was not refused"
    assert faults(Misuse("torch's words", "", lambda: torch.zeros(2) + torch.zeros(3)))[0] == "raises RuntimeError"


@pytest.mark.parametrize("wrap", [FinetunedPolicy, LatentNoisePolicy, ResidualActionPolicy, ResidualLatentPolicy])
def test_wrapping_a_policy_leaves_it_as_it_was(wrap):
    latent = LatentPolicy(G1, SMALL).train()
    before = {name: value.clone() for name, value in latent.state_dict().items()}
    wrapped = wrap(latent)
    wrapped.eval()
    LatentImitationLoss(latent.training_graph())
    assert all(parameter.requires_grad for parameter in latent.parameters())
    assert all(module.training for module in latent.modules())
    assert all(torch.equal(value, before[name]) for name, value in latent.state_dict().items())
