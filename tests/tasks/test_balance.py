import mujoco
import pytest
import torch

from plat.envs import GeneralizedState
from plat.robots import G1
from plat.tasks.balance import Balance


def standing(**changes):
    qpos = torch.as_tensor(G1.default_qpos, dtype=torch.float32)[None]
    state = GeneralizedState.unpack(torch.cat((qpos, torch.zeros(1, 6 + G1.num_joints)), -1))
    return state._replace(**changes)


def unbalance(state):
    return float(Balance(G1)(state))


def test_a_robot_that_stands_is_in_balance():
    assert unbalance(standing()) == 0


def test_it_is_the_velocity_over_the_pendulums_rate():
    model = G1.model()
    data = mujoco.MjData(model)
    data.qpos[:] = G1.default_qpos
    mujoco.mj_forward(model, data)
    com, soles = data.subtree_com[1], data.geom_xpos[G1.sole_geoms(model)].mean(1)
    rate = (9.81 / (com[2] - soles[:, 2].min())) ** 0.5
    ahead = com[0] + 0.7 / rate - soles[0, 0]
    falling = standing(root_lin_vel_w=torch.tensor([[0.7, 0.0, 0.0]]))
    assert unbalance(falling) == pytest.approx(ahead - 0.04, abs=2e-3)


def test_the_feet_hold_more_along_the_line_between_them():
    forward, sideways = (
        unbalance(standing(root_lin_vel_w=velocity))
        for velocity in (torch.tensor([[0.5, 0.0, 0.0]]), torch.tensor([[0.0, 0.5, 0.0]]))
    )
    assert forward > 0.05
    assert sideways == 0


def test_a_turn_about_the_root_moves_the_center_of_mass():
    assert unbalance(standing(root_ang_vel_b=torch.tensor([[0.0, 40.0, 0.0]]))) > 0


def test_it_can_be_learned_from():
    velocity = torch.tensor([[0.6, 0.0, 0.0]], requires_grad=True)
    Balance(G1)(standing(root_lin_vel_w=velocity)).sum().backward()
    assert velocity.grad[0, 0] > 0.1


def test_a_rotated_world_changes_nothing():
    half = torch.tensor([0.5**0.5, 0.0, 0.0, 0.5**0.5])
    turned = standing(root_quat_w=half[None], root_lin_vel_w=torch.tensor([[0.0, 0.6, 0.0]]))
    assert unbalance(turned) == pytest.approx(
        unbalance(standing(root_lin_vel_w=torch.tensor([[0.6, 0.0, 0.0]]))), abs=1e-5
    )
