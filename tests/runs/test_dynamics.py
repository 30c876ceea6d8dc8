from dataclasses import replace

import pytest
import torch
from safetensors.torch import load_file, save_file

from plat.envs import GeneralizedState
from plat.errors import CheckpointError
from plat.modules import DynamicsConfig, DynamicsModel, Expert, ExpertConfig
from plat.robots import G1
from plat.runs import load_dynamics, policy_spec, save_dynamics, write_json

SHAPE = DynamicsConfig(hidden=(16, 16))


def run_of(folder, hidden=(16, 16), policy=None):
    write_json(folder / "config.json", {"recipe": {"settings": {"model": {"hidden": list(hidden)}}}, "policy": policy})
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


def test_a_robot_that_changed_under_its_name_is_told(tmp_path):
    model = run_of(tmp_path, policy=policy_spec(Expert(G1, ExpertConfig(hidden=(8,)))))
    assert load_dynamics(tmp_path, G1).config == model.config
    bent = {**G1.default_pose, "left_knee": 0.5}
    with pytest.raises(CheckpointError, match="default_pose of 'left_knee' is 0.669, and 0.5 as robot 'g1' is now"):
        load_dynamics(tmp_path, replace(G1, default_pose=bent))
    # of another name it is gone on from
    assert load_dynamics(tmp_path, replace(G1, name="bent", default_pose=bent)).config == model.config


def test_what_is_wrong_is_named(tmp_path):
    run_of(tmp_path)
    weights = load_file(tmp_path / "dynamics.safetensors")
    save_file({**weights, "network.2.weight": torch.zeros(16, 15)}, tmp_path / "dynamics.safetensors")
    with pytest.raises(CheckpointError, match=r"dynamics.safetensors': not a model of robot 'g1'"):
        load_dynamics(tmp_path, G1)
    save_file({**weights, "mean": weights["mean"] * torch.nan}, tmp_path / "dynamics.safetensors")
    with pytest.raises(CheckpointError, match=r"dynamics.safetensors': .*'mean' holds NaN or infinity"):
        load_dynamics(tmp_path, G1)
    save_file({}, tmp_path / "dynamics.safetensors")
    with pytest.raises(CheckpointError, match=r"dynamics.safetensors': not a model of robot 'g1'"):
        load_dynamics(tmp_path, G1)
    (tmp_path / "dynamics.safetensors").unlink()
    with pytest.raises(CheckpointError, match=r"dynamics.safetensors': no such file"):
        load_dynamics(tmp_path, G1)


@pytest.mark.parametrize("hidden", [(16,), (512, 512, 512)])
def test_a_model_has_the_shape_of_its_weights_whatever_the_settings_say(tmp_path, hidden):
    run_of(tmp_path, hidden)
    assert load_dynamics(tmp_path, G1).config == SHAPE


@pytest.mark.parametrize(
    ("policy", "dt"),
    [
        (None, 0.02),  # of a plat before timings
        ({"kind": "expert", "config": {"hidden": [16]}}, 0.02),
        ({"kind": "expert", "config": {"timing": {"control_dt": 0.01, "max_steps": 100, "window": 3}}}, 0.01),
        ({"kind": "finetuned", "config": {}, "student": {"config": {"timing": {"control_dt": 0.04}}}}, 0.04),
    ],
)
def test_a_model_has_the_control_step_of_its_run(tmp_path, policy, dt):
    run_of(tmp_path, policy=policy)
    assert load_dynamics(tmp_path, G1).dt == dt
    # one that is told more of the physics as well
    assert load_dynamics(tmp_path, G1, num_parameters=4).dt == dt


@pytest.mark.parametrize(
    ("timing", "message"),
    [({"control_dt": 0}, "control_dt is 0, expected a number from 0.001 to 1"), ([0.02], "mapping"), (None, "mapping")],
)
def test_a_control_step_that_is_none_is_named(tmp_path, timing, message):
    run_of(tmp_path, policy={"config": {"timing": timing}})
    with pytest.raises(CheckpointError, match=rf"config.json': policy: .*{message}"):
        load_dynamics(tmp_path, G1)
