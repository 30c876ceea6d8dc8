import torch
from torch import nn

from plat.modules import (
    DynamicsConfig,
    DynamicsModel,
    Expert,
    ExpertConfig,
    LatentPolicy,
    PlainPolicy,
    PlainPolicyConfig,
)
from plat.objectives import hidden_matrices, muon_and_adam
from plat.robots import G1


def shapes(optimizer):
    return [tuple(parameter.shape) for parameter in optimizer.param_groups[0]["params"]]


def test_the_last_layer_is_adams():
    network = DynamicsModel(G1, DynamicsConfig(hidden=(8, 8))).network
    muon, adam = muon_and_adam(network, 1e-3, 1e-3)
    assert shapes(muon) == [(8, 97), (8, 8)]
    assert len(adam.param_groups[0]["params"]) == 4


def test_what_a_policy_answers_is_adams():
    policy = PlainPolicy(G1, PlainPolicyConfig(backbone=(24,), hidden_size=16, decoder=(12,)))
    muon, adam = muon_and_adam(policy, 1e-2, 1e-3)
    # features of the backbone are no answer: its last layer is a hidden one
    assert [shape[0] for shape in shapes(muon)] == [24, 16, 12]
    assert (29, 12) in shapes(adam)
    expert = Expert(G1, ExpertConfig(hidden=(16, 8)))
    assert [shape[0] for shape in shapes(muon_and_adam(expert, 1e-2, 1e-3)[0])] == [16, 8]


def test_recurrent_weights_and_distributions_are_adams():
    policy = LatentPolicy(G1)
    hidden = {id(matrix) for matrix in hidden_matrices(policy)}
    left = {name for name, value in policy.named_parameters() if value.ndim == 2 and id(value) not in hidden}
    assert any("weight_hh" in name for name in left)
    rows = {len(value) for name, value in policy.named_parameters() if name in left and "_l0" not in name}
    assert rows == {G1.num_joints, 2 * policy.config.latent_size}


def test_only_what_learns_has_an_optimizer():
    network = nn.Sequential(nn.Linear(3, 4), nn.ReLU(), nn.Linear(4, 5), nn.ReLU(), nn.Linear(5, 2))
    muon, adam = muon_and_adam(network, 1e-2, 1e-3, learning=list(network[2:].parameters()))
    assert shapes(muon) == [(5, 4)]
    assert shapes(adam) == [(5,), (2, 5), (2,)]


def test_without_a_rate_or_a_hidden_matrix_adam_is_alone():
    network = nn.Sequential(nn.Linear(3, 4), nn.ReLU(), nn.Linear(4, 2))
    (adam,) = muon_and_adam(network, 0.0, 1e-3)
    assert len(adam.param_groups[0]["params"]) == 4
    (adam,) = muon_and_adam(nn.Linear(3, 2), 1e-2, 1e-3)
    assert isinstance(adam, torch.optim.Adam)
