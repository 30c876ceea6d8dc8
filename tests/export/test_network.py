import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule, TensorDictModuleBase, TensorDictSequential

from plat.errors import BundleError
from plat.export import JointTargetNetwork
from plat.modules import (
    STUDENT_KEYS,
    LatentPolicy,
    LatentPolicyConfig,
    RefinementConfig,
    ResidualLatentPolicy,
)
from plat.robots import G1
from plat.spec.observation import entry_shapes
from tests.export.runs import KINDS, small_policy


@pytest.mark.parametrize("kind", [*KINDS, "expert", "expert_of_frames", "expert_with_lead"])
def test_agrees_with_the_policy_on_tensordicts(kind):
    policy = small_policy(kind)
    observation = torch.randn(5, 177)
    entries = TensorDict({}, [5])
    widths = [entry_shapes(group, G1)[name][0] for group, name in STUDENT_KEYS]
    for key, values in zip(STUDENT_KEYS, observation.split(widths, -1), strict=True):
        entries[key] = values
    expected = G1.default_joint_pos + G1.action_scale * policy.deployed()(entries)["action"]
    network = JointTargetNetwork(policy)
    assert network.num_features == 177
    torch.testing.assert_close(network(observation), expected)
    torch.testing.assert_close(network(observation[0]), expected[0], rtol=1e-5, atol=1e-5)


def test_a_lead_of_a_policy_that_sees_parts_agrees():
    student = LatentPolicy(G1, LatentPolicyConfig(backbone=(32,), hidden_size=16, also=("parts",)))
    policy = ResidualLatentPolicy(student, RefinementConfig(lead=0.5))
    network = JointTargetNetwork(policy)
    entries = TensorDict({key: torch.randn(5, *entry_shapes(key[0], G1)[key[1]]) for key in network.keys}, [5])
    entries["parts", "bodies"] = (torch.arange(70).view(5, 14) % 3 == 0).float()
    observation = torch.cat([entries[key] for key in network.keys], -1)
    expected = G1.default_joint_pos + G1.action_scale * policy.deployed()(entries)["action"]
    torch.testing.assert_close(network(observation), expected)


def test_shares_the_policys_weights():
    policy = small_policy("latent")
    network, observation = JointTargetNetwork(policy), torch.randn(177)
    before = network(observation)
    with torch.no_grad():
        policy.decoder.network[-1].bias.add_(1.0)
    torch.testing.assert_close(network(observation), before + G1.action_scale)


class Own:
    """A policy of a user's."""

    robot, config = G1, None

    def __init__(self, *parts):
        self.parts = parts

    def deployed(self):
        return TensorDictSequential(*self.parts)


class Bare(TensorDictModuleBase):
    in_keys, out_keys = [("goal", "joint_pos")], ["action"]


IDENTITY = torch.nn.Identity()


def test_a_policy_of_ones_own():
    network = JointTargetNetwork(Own(TensorDictModule(IDENTITY, [("goal", "joint_pos")], ["action"])))
    assert network(torch.zeros(2, 177)).shape == (2, 29)


@pytest.mark.parametrize(
    ("part", "message"),
    [
        (Bare(), "holds a Bare; only TensorDictModule"),
        (TensorDictModule(IDENTITY, [("state", "root_pos_w")], ["action"]), "reads \\('state', 'root_pos_w'\\), which"),
        (TensorDictModule(IDENTITY, [("goal", "joint_pos")], ["act"]), "writes no 'action'"),
    ],
)
def test_what_cannot_be_exported_is_named(part, message):
    with pytest.raises(BundleError, match=message):
        JointTargetNetwork(Own(part))
