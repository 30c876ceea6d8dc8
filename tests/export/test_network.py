import pytest
import torch
from tensordict import TensorDict

from plat.export import JointTargetNetwork
from plat.modules import STUDENT_KEYS
from plat.robots import G1
from plat.spec.observation import entry_shapes
from tests.export.runs import KINDS, small_policy


@pytest.mark.parametrize("kind", [*KINDS, "expert", "expert_with_lead"])
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


def test_shares_the_policys_weights():
    policy = small_policy("latent")
    network, observation = JointTargetNetwork(policy), torch.randn(177)
    before = network(observation)
    with torch.no_grad():
        policy.decoder.network[-1].bias.add_(1.0)
    torch.testing.assert_close(network(observation), before + G1.action_scale)
