import subprocess
import sys

import mujoco
import numpy as np
import pytest
import torch

from plat.envs import BatchedPhysics
from plat.envs.physics import available_cpus
from plat.errors import ConfigError
from plat.robots import G1


def started(num_sims: int) -> BatchedPhysics:
    physics = BatchedPhysics(G1.model(), num_sims, num_threads=1)
    qpos = torch.as_tensor(G1.default_qpos).expand(num_sims, -1)
    physics.set_state(torch.arange(num_sims), qpos, torch.zeros(num_sims, 35, dtype=torch.float64))
    return physics


def test_steps_equal_plain_mujoco():
    physics = started(3)
    model = G1.model()
    data = mujoco.MjData(model)
    data.qpos[:] = G1.default_qpos
    target = G1.default_joint_pos + 0.1
    for _ in range(10):
        physics.step(target.expand(3, -1), nstep=4)
        data.ctrl[:] = target
        mujoco.mj_step(model, data, 4)
    np.testing.assert_allclose(physics.read("qpos")[1], data.qpos, atol=1e-6)


def test_a_push_acts_as_in_plain_mujoco():
    # the batch goes on from stages that were computed before the push; it must notice the new velocity
    physics = started(1)
    model = G1.model()
    data = mujoco.MjData(model)
    data.qpos[:] = G1.default_qpos
    delta = torch.zeros(1, 6, dtype=torch.float64)
    delta[0, 0] = 0.5
    for push in (False, True, False):
        if push:
            physics.push(torch.tensor([0]), delta)
            data.qvel[:6] += delta[0].numpy()
        physics.step(G1.default_joint_pos[None], nstep=4)
        data.ctrl[:] = G1.default_joint_pos
        mujoco.mj_step(model, data, 4)
    np.testing.assert_allclose(physics.read("qvel")[0], data.qvel, atol=1e-5)


def test_reads_are_copies():
    physics = started(1)
    before = physics.read("qpos")
    kept = before.clone()
    physics.step(G1.default_joint_pos[None] + 0.5, nstep=4)
    assert torch.equal(before, kept)
    assert not torch.equal(physics.read("qpos"), kept)


def test_state_of_some_leaves_the_others():
    physics = started(3)
    before = physics.read("qpos")
    moved = torch.as_tensor(G1.default_qpos)[None].clone()
    moved[:, 0] = 5.0
    physics.set_state(torch.tensor([1]), moved, torch.zeros(1, 35, dtype=torch.float64))
    after = physics.read("qpos")
    assert after[1, 0] == 5.0
    assert torch.equal(after[[0, 2]], before[[0, 2]])
    # body poses are those of the new state at once
    assert physics.read("xpos", [1])[1, 0, 0] == 5.0


def test_model_fields_are_per_simulation():
    physics = started(2)
    physics.model_field("actuator_gainprm")[1, :, 0] = 0.0
    physics.model_field("actuator_biasprm")[1, :, 1:3] = 0.0
    for _ in range(25):
        physics.step(G1.default_joint_pos.expand(2, -1), nstep=4)
    height = physics.read("qpos")[:, 2]
    assert height[0] > 0.7  # the one with motors stands
    assert height[1] < 0.6


@pytest.mark.parametrize("threads", [1, 2])
def test_threads_do_not_change_the_numbers(threads):
    physics = BatchedPhysics(G1.model(), 4, num_threads=threads)
    qpos = torch.as_tensor(G1.default_qpos).expand(4, -1)
    physics.set_state(torch.arange(4), qpos, torch.zeros(4, 35, dtype=torch.float64))
    targets = G1.default_joint_pos + 0.2 * torch.randn(4, 29, generator=torch.Generator().manual_seed(0))
    for _ in range(5):
        physics.step(targets, nstep=4)
    reference = started(4)
    for _ in range(5):
        reference.step(targets, nstep=4)
    assert torch.equal(physics.read("qpos"), reference.read("qpos"))


def test_a_state_that_is_set_remembers_nothing():
    used, fresh = started(2), started(2)
    for _ in range(5):
        used.step(G1.default_joint_pos.expand(2, -1) + 0.4, nstep=4)
    qpos = torch.as_tensor(G1.default_qpos).expand(2, -1)
    for physics in (used, fresh):
        physics.set_state(torch.arange(2), qpos, torch.full((2, 35), 0.1, dtype=torch.float64))
        for _ in range(5):
            physics.step(G1.default_joint_pos.expand(2, -1), nstep=4)
    for field in ("qpos", "qvel", "time", "sensordata", "actuator_force", "cvel"):
        assert torch.equal(used.read(field), fresh.read(field)), field


def test_forces_are_not_those_of_the_state_before():
    physics = started(3)
    for _ in range(20):
        physics.step(G1.default_joint_pos.expand(3, -1), nstep=4)
    feet = ("left_foot_contact", "right_foot_contact")
    standing = {name: value.clone() for name, value in physics.sensors().items()}
    torque = physics.kinematics(("pelvis",)).joint_torque
    state = physics.state_dict()
    physics.set_state(torch.tensor([1]), torch.as_tensor(G1.default_qpos)[None], torch.zeros(1, 35))
    readings = physics.sensors()
    for name in feet:
        assert standing[name][:, 1:].any(-1).all()
        assert not readings[name][1].any()
        assert torch.equal(readings[name][[0, 2]], standing[name][[0, 2]])
    after = physics.kinematics(("pelvis",)).joint_torque
    assert not after[1].any()
    assert torch.equal(after[[0, 2]], torque[[0, 2]])
    assert not physics.kinematics(("pelvis",), torch.tensor([1])).joint_torque.any()
    physics.load_state_dict(state)
    assert not physics.sensors()["left_foot_contact"].any()
    physics.step(G1.default_joint_pos.expand(3, -1), nstep=4)
    assert physics.sensors()["left_foot_contact"][:, 1:].any(-1).all()


def test_parameters_are_those_of_the_model_in_mujoco():
    physics = started(3)
    ids = torch.tensor([0, 2])
    physics.set_friction(ids, G1.feet, torch.tensor([0.2, 0.4]))
    physics.set_com(ids, "torso_link", torch.tensor([[0.1, 0, 0], [0, 0.2, 0]]))
    physics.set_gains(ids, torch.full((2, 29), 0.5), torch.full((2, 29), 2.0))
    model = G1.model()
    soles = G1.sole_geoms(model)
    torso = model.body("torso_link").id
    friction = physics.model_field("geom_friction")
    np.testing.assert_allclose(friction[:, soles.ravel(), 0], np.array([[0.2], [0.8], [0.4]]).repeat(8, 1), atol=1e-7)
    others = np.delete(np.arange(model.ngeom), soles.ravel())
    np.testing.assert_array_equal(friction[0, others], model.geom_friction[others])
    shift = physics.model_field("body_ipos")[:, torso] - model.body_ipos[torso]
    np.testing.assert_allclose(shift, [[0.1, 0, 0], [0, 0, 0], [0, 0.2, 0]], atol=1e-7)
    gain, bias = physics.model_field("actuator_gainprm"), physics.model_field("actuator_biasprm")
    factor = np.array([[0.5], [1.0], [0.5]])
    np.testing.assert_allclose(gain[:, :, 0], factor * model.actuator_gainprm[:, 0])
    np.testing.assert_allclose(bias[:, :, 1], factor * model.actuator_biasprm[:, 1])
    np.testing.assert_allclose(bias[:, :, 2], np.array([[2.0], [1.0], [2.0]]) * model.actuator_biasprm[:, 2])


def test_sensors_have_their_names():
    physics = started(2)
    for _ in range(20):
        physics.step(G1.default_joint_pos.expand(2, -1), nstep=4)
    sensors = physics.sensors()
    assert {name: value.shape[1] for name, value in sensors.items()} == {
        "left_foot_contact": 4,
        "right_foot_contact": 4,
        "ground_contact": 1,
        "self_contact": 1,
    }
    weight = 9.81 * G1.model().body_mass.sum()
    force = (sensors["left_foot_contact"] + sensors["right_foot_contact"])[:, 1:].norm(dim=-1)
    np.testing.assert_allclose(force, weight, rtol=0.2)  # it stands
    np.testing.assert_array_equal(physics.sensors(torch.tensor([1]))["ground_contact"], sensors["ground_contact"][1:])


def test_body_velocities_are_the_change_of_their_poses():
    physics = started(1)
    qvel = torch.zeros(1, 35, dtype=torch.float64)
    qvel[0, :6] = torch.tensor([0.3, 0, 0, 0, 0, 2.0])
    physics.set_state(torch.tensor([0]), torch.as_tensor(G1.default_qpos)[None], qvel)
    before = physics.kinematics(("left_wrist_yaw_link", "pelvis"))
    pos, pelvis = before.body_pos_w[0]
    lever = pos - pelvis
    expected = torch.tensor([0.3, 0, 0]) + torch.linalg.cross(torch.tensor([0, 0, 2.0]), lever)
    torch.testing.assert_close(before.body_lin_vel_w[0, 0], expected, atol=1e-5, rtol=0)
    torch.testing.assert_close(before.body_ang_vel_w[0, 0], torch.tensor([0, 0, 2.0]), atol=1e-5, rtol=0)


def test_plat_is_imported_without_mujocos_batch():
    # the MuJoCo of another pool may be older
    code = "import sys; sys.modules['mujoco.batch'] = None; import plat.envs; print('imported')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "imported\n"


def test_a_share_of_the_cpus(monkeypatch):
    monkeypatch.setenv("PLAT_CPUS", "1")
    assert available_cpus() == 1
    monkeypatch.setenv("PLAT_CPUS", "1000000")
    there = available_cpus()
    monkeypatch.delenv("PLAT_CPUS")
    assert available_cpus() == there
    for wrong in ("abc", "0", "-2", "1.5", "\u00b2"):
        monkeypatch.setenv("PLAT_CPUS", wrong)
        with pytest.raises(ConfigError, match=f"PLAT_CPUS is '{wrong}', expected a whole number from 1"):
            available_cpus()
