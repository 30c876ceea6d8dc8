import pytest
import torch

from plat.envs import GeneralizedState
from plat.errors import CheckpointError
from plat.modules import DynamicsConfig, DynamicsModel
from plat.robots import G1
from plat.runs import load_dynamics, save_dynamics, write_json

SHAPE = DynamicsConfig(hidden=(16, 16))


def run_of(folder, hidden=(16, 16)):
    write_json(folder / "config.json", {"recipe": {"settings": {"model": {"hidden": list(hidden)}}}})
    model = DynamicsModel(G1, SHAPE)
    model.spread.fill_(0.5)
    save_dynamics(folder, model)
    return model


def test_a_saved_model_says_the_same(tmp_path):
    model, state = run_of(tmp_path), GeneralizedState.unpack(torch.randn(3, 71))
    target = torch.randn(3, 29)
    for ours, theirs in zip(load_dynamics(tmp_path, G1)(state, target), model(state, target), strict=True):
        assert ours.equal(theirs)


@pytest.mark.parametrize("name", ["imagined-g1", "expert-model-g1"])
def test_models_come_with_plat(name):
    """A robot at rest with the targets of its pose moves little in a control step, in the model as in simulation."""
    standing = torch.tensor(G1.default_qpos, dtype=torch.float32)
    state = GeneralizedState.unpack(torch.cat((standing, torch.zeros(35)))[None])
    after = load_dynamics(name, G1)(state, standing[None, 7:])
    assert (after.joint_pos - state.joint_pos).abs().max() < 0.02
    assert (after.root_pos_w - state.root_pos_w).norm() < 0.01


def test_what_is_wrong_is_named(tmp_path):
    run_of(tmp_path, hidden=(16,))
    with pytest.raises(CheckpointError, match=r"dynamics.safetensors': not a model of robot 'g1'"):
        load_dynamics(tmp_path, G1)
    (tmp_path / "dynamics.safetensors").unlink()
    with pytest.raises(CheckpointError, match=r"dynamics.safetensors': no such file"):
        load_dynamics(tmp_path, G1)
