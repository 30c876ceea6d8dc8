"""MuJoCo Warp against MuJoCo, on Warp's CPU device. Kernels are compiled at the first use, which takes minutes."""

import sys

import mujoco
import pytest
import torch
from torch import Tensor

from plat.envs import MotionTrackingEnv
from plat.envs.physics import BatchedPhysics, WarpPhysics, get_physics
from plat.errors import ConfigError, StateError
from plat.recipes.options import ExpertRecipe
from plat.robots import G1

STANDING = torch.as_tensor(G1.default_qpos, dtype=torch.float64)


# About a hundred times what was found: processors round differently, and contacts amplify it.
TOLERANCES = {
    "qpos": 1e-4,  # m, rad
    "qvel": 1e-2,  # m/s, rad/s
    "body_pos_w": 1e-4,
    "body_quat_w": 1e-4,
    "body_lin_vel_w": 1e-3,
    "body_ang_vel_w": 1e-2,
    "joint_torque": 2e-2,  # N m
    "left_foot_contact": 5.0,  # N
    "right_foot_contact": 5.0,
    "ground_contact": 0.5,  # contacts
    "self_contact": 0.5,
}


def moved(count: int) -> tuple[Tensor, Tensor]:
    """States about on the ground, moving."""
    random = torch.Generator().manual_seed(3)
    qpos, qvel = STANDING.repeat(count, 1), 0.1 * torch.randn(count, 35, generator=random, dtype=torch.float64)
    qpos[:, 7:] += 0.03 * torch.randn(count, 29, generator=random, dtype=torch.float64)
    return qpos, qvel


def both(count: int) -> tuple[BatchedPhysics, WarpPhysics]:
    pytest.importorskip("mujoco_warp")
    model = G1.model(timestep=0.005)
    pair = BatchedPhysics(model, count, num_threads=1), WarpPhysics(model, count)
    for physics in pair:
        physics.set_state(torch.arange(count), *moved(count))
    return pair


def differences(ours: BatchedPhysics, theirs: WarpPhysics) -> dict[str, float]:
    """Largest differences of what an environment reads."""
    pairs = dict(zip(("qpos", "qvel"), zip(ours.state(), theirs.state(), strict=True), strict=True))
    one, other = (vars(physics.kinematics(G1.keypoints)) for physics in (ours, theirs))
    pairs |= {name: (one[name], other[name]) for name in one}
    feet, also = ours.sensors(), theirs.sensors()
    assert feet.keys() == also.keys()
    pairs |= {name: (feet[name], also[name]) for name in feet}
    return {name: float((a - b).abs().max()) for name, (a, b) in pairs.items()}


@pytest.mark.slow
def test_a_hundred_steps_are_those_of_mujoco():
    ours, theirs = both(3)
    ids = torch.tensor([0, 2])
    for physics in (ours, theirs):
        physics.set_friction(ids, G1.feet, torch.tensor([0.4, 0.9]))
        physics.set_com(ids, "torso_link", torch.tensor([[0.02, 0, 0], [0, 0.02, 0.01]]))
        physics.set_mass(ids, "torso_link", torch.tensor([1.0, -0.5]))
        physics.set_gains(ids, torch.full((2, 29), 0.9), torch.full((2, 29), 1.1))
    random = torch.Generator().manual_seed(1)
    found: list[dict[str, float]] = []
    force = 0.0
    for number in range(25):  # of four steps
        target = G1.default_joint_pos + 0.1 * torch.randn(3, 29, generator=random)
        for physics in (ours, theirs):
            if number == 10:
                physics.push(torch.tensor([1]), torch.tensor([[0.3, 0.2, 0.0, 0.1, 0.0, 0.2]]))
            physics.step(target, nstep=4)
        found.append(differences(ours, theirs))
        force = max(force, float(theirs.sensors()["left_foot_contact"].max()))
    assert force > 50  # feet are on the ground
    assert not theirs.overflowed().any()
    assert not theirs.diverged().any()
    for name, bound in TOLERANCES.items():
        assert max(each[name] for each in found) < bound, name


@pytest.mark.slow
def test_resets_of_some_leave_the_others_and_returned_tensors():
    _, physics = both(3)
    physics.step(G1.default_joint_pos.expand(3, -1), nstep=1)
    before, velocity = physics.state()
    bodies = physics.kinematics(G1.keypoints)
    kept = before.clone(), bodies.body_pos_w.clone()
    qpos = STANDING[None].clone()
    qpos[:, 0] = 5.0
    physics.set_state(torch.tensor([1]), qpos, torch.zeros(1, 35, dtype=torch.float64))
    after, _ = physics.state()
    assert after[1, 0] == 5.0
    assert after[[0, 2]].equal(before[[0, 2]])
    assert float(physics.kinematics(("pelvis",)).body_pos_w[1, 0, 0]) == 5.0
    assert before.equal(kept[0])
    assert bodies.body_pos_w.equal(kept[1])
    assert physics.state(torch.tensor([1]))[0].equal(after[1:2])
    assert velocity.shape == (3, 35)


@pytest.mark.slow
def test_a_state_comes_back_and_a_wrong_one_is_refused():
    _, physics = both(2)
    physics.set_gains(torch.tensor([1]), torch.full((1, 29), 0.5), torch.ones(1, 29))
    physics.step(G1.default_joint_pos.expand(2, -1), nstep=2)
    state = physics.state_dict()
    ends = []
    for _ in range(2):
        physics.load_state_dict(state)
        physics.step(G1.default_joint_pos.expand(2, -1) + 0.1, nstep=2)
        ends.append(physics.state()[0])
    assert ends[0].equal(ends[1])
    with pytest.raises(StateError, match=r"qpos of the state is missing, expected \(2, 36\)"):
        physics.load_state_dict({"state": torch.zeros(2, 3), "fields": {}})


@pytest.mark.slow
def test_a_robot_that_diverges_is_told_of_and_comes_back():
    _, physics = both(2)
    velocity = torch.zeros(1, 35)
    velocity[0, 0] = torch.nan
    physics.set_state(torch.tensor([1]), STANDING[None], velocity)
    physics.step(G1.default_joint_pos.expand(2, -1), nstep=1)
    assert physics.diverged().tolist() == [False, True]
    assert all(
        values.isfinite().all() for values in (*physics.state(), *vars(physics.kinematics(G1.keypoints)).values())
    )
    physics.set_state(torch.tensor([1]), STANDING[None], torch.zeros(1, 35))
    physics.step(G1.default_joint_pos.expand(2, -1), nstep=1)
    assert physics.diverged().tolist() == [False, False]


@pytest.mark.slow
def test_an_environment_runs_on_it(library):
    pytest.importorskip("mujoco_warp")
    env = MotionTrackingEnv(library, 2, physics=get_physics("warp"))
    rollout = env.rollout(2)
    assert torch.isfinite(rollout["next", "robot", "joint_pos"]).all()
    assert rollout["next", "state", "foot_force"].shape == (2, 2, 2)


class FewFields(WarpPhysics):
    """Physics of two robots without a simulator, the second of which diverges."""

    def __init__(self):
        self.model, self.device, self._stale = G1.shared_model, torch.device("cpu"), False
        shapes = {"qpos": 36, "qvel": 35, "ctrl": 29, "qacc_warmstart": 35, "actuator_force": 29}
        self._state = {name: torch.zeros(2, size) for name, size in shapes.items()}
        self._felt = torch.zeros(2, 3)
        self._diverged = torch.zeros(2, dtype=torch.bool)

    def _run(self, key, queue):
        if key:
            self._state["qpos"][0] = 0.5
            for values in (*self._state.values(), self._felt):
                values[1] = torch.nan


def test_a_robot_that_diverged_is_put_back_to_its_start():
    physics = FewFields()
    physics.step(torch.zeros(2, 29), nstep=1)
    assert physics.diverged().tolist() == [False, True]
    qpos, qvel = physics.state()
    torch.testing.assert_close(qpos[1], torch.from_numpy(G1.shared_model.qpos0).float())
    assert (qpos[0] == 0.5).all()
    assert (qvel == 0).all()
    assert all(values.isfinite().all() for values in (*physics._state.values(), physics._felt))


def test_without_the_extra_one_line_says_what_it_needs(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco_warp", None)
    with pytest.raises(ConfigError, match=r"--physics warp needs: pip install 'plat-rl\[warp\]'"):
        get_physics("warp")
    with pytest.raises(ConfigError, match=r"physics 'warp' needs: pip install 'plat-rl\[warp\]'"):
        WarpPhysics(mujoco.MjModel.from_xml_string("<mujoco/>"), 1)


def test_mujoco_by_its_name():
    assert get_physics("mujoco") is BatchedPhysics


def test_warp_is_not_spread_over_workers(tmp_path):
    with pytest.raises(ConfigError, match="physics is 'warp', which is on one device: expected workers to be 0"):
        ExpertRecipe(motions=("x",), out=tmp_path, physics="warp", workers=2)
