from dataclasses import replace

import mujoco
import numpy as np
import pytest
import torch

from plat.control import Simulator
from plat.envs import BatchedPhysics
from plat.errors import ActionError, RobotError, StateError
from plat.keyframes import Keyframe, standing
from plat.robots import G1


@pytest.fixture
def simulator() -> Simulator:
    simulator = Simulator(G1.model())
    simulator.reset(standing(G1))
    return simulator


def test_it_moves_as_the_training_physics_do(simulator):
    physics = BatchedPhysics(G1.model(), 2)
    physics.set_state(torch.arange(2), torch.from_numpy(G1.default_qpos).expand(2, -1), torch.zeros(2, 35))
    generator = torch.Generator().manual_seed(0)
    for _ in range(10):
        target = G1.default_joint_pos + 0.2 * torch.randn(29, generator=generator)
        simulator.step(target.double().numpy())
        physics.step(target.expand(2, -1), nstep=4)
    np.testing.assert_allclose(simulator.data.qpos, physics.read("qpos")[0], atol=1e-5)
    np.testing.assert_allclose(simulator.data.qvel, physics.read("qvel")[0], atol=1e-4)


def test_velocities_of_the_state_are_in_the_root_frame(simulator):
    # a quarter turn to the left: what goes along the world's y is forward to the robot
    turned = np.array([0.5**0.5, 0.0, 0.0, 0.5**0.5])
    simulator.reset(Keyframe(0.0, np.array([1.0, 2.0, 0.9]), turned, G1.default_joint_pos.numpy()))
    simulator.data.qvel[:] = np.arange(35)
    simulator.data.qvel[:3] = [0.0, 0.7, 0.1]
    state = simulator.state()
    np.testing.assert_allclose(state.root_lin_vel_b, [0.7, 0.0, 0.1], atol=1e-12)
    np.testing.assert_array_equal(state.root_ang_vel_b, [3.0, 4.0, 5.0])
    np.testing.assert_array_equal(state.root_pos_w, [1.0, 2.0, 0.9])
    np.testing.assert_array_equal(state.joint_vel, np.arange(6, 35))


def test_a_state_does_not_change_when_the_robot_moves_on(simulator):
    before = simulator.state()
    kept = before.joint_pos.copy()
    simulator.step(np.zeros(29))
    np.testing.assert_array_equal(before.joint_pos, kept)
    assert np.abs(simulator.state().joint_pos - kept).max() > 1e-3


def test_a_push_moves_the_whole_robot_alike(simulator):
    simulator.push(np.array([0.3, -0.2, 0.0]))
    mujoco.mj_forward(simulator.model, simulator.data)
    velocity = np.zeros(6)
    for body in ("pelvis", "torso_link", "left_wrist_yaw_link"):
        index = simulator.model.body(body).id
        mujoco.mj_objectVelocity(simulator.model, simulator.data, mujoco.mjtObj.mjOBJ_BODY, index, velocity, 0)
        np.testing.assert_allclose(velocity[3:], [0.3, -0.2, 0.0], atol=1e-9)


def test_reset_forgets_everything(simulator):
    first = []
    for _ in range(2):
        simulator.reset(standing(G1))
        for _ in range(5):
            simulator.step(np.full(29, 0.1))
        first.append(simulator.data.qpos.copy())
    np.testing.assert_array_equal(*first)


def test_a_start_under_the_floor_is_refused(simulator):
    for depth, said in ((0.2, None), (2.0, r"pose: the robot is 2\d\d cm inside the floor")):
        pose = standing(G1)
        pose.root_pos[2] -= depth
        if said is None:
            simulator.reset(pose)
        else:
            with pytest.raises(StateError, match=said):
                simulator.reset(pose)


def test_finer_physics_take_more_steps_and_time_steps_that_do_not_fit_are_refused():
    model = G1.model()
    model.opt.timestep = 0.001
    assert Simulator(model).substeps == 20
    model.opt.timestep = 0.003
    with pytest.raises(RobotError, match=r"physics time step of 0.003 s, expected a whole fraction of .* 0.02 s"):
        Simulator(model)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_target_that_is_not_finite(simulator, value):
    target, before = np.zeros(29), simulator.data.qpos.copy()
    target[3] = value
    with pytest.raises(ActionError, match="target of joint 'left_knee_joint' is (nan|inf), expected a finite angle"):
        simulator.step(target)
    np.testing.assert_array_equal(simulator.data.qpos, before)


@pytest.mark.parametrize("steps", [0, 1, 3])
@pytest.mark.parametrize("speed", [1e12, np.nan])
def test_a_simulation_that_diverges(simulator, steps, speed):
    for _ in range(2):  # it tells so again after a reset
        simulator.reset(standing(G1))
        for _ in range(steps):
            simulator.step(np.zeros(29))
        simulator.push(np.array([speed, 0.0, 0.0]))
        with pytest.raises(ActionError, match=f"the simulation diverged {0.02 * steps:.2f} s after its start"):
            simulator.step(np.zeros(29))
        simulator.step(np.zeros(29))


def test_a_target_beyond_all_bounds_is_not_left_out(simulator):
    """MuJoCo would move no motor."""
    with pytest.raises(ActionError, match=r"the simulation diverged 0.00 s after its start: targets or pushes are too"):
        simulator.step(np.full(29, 1e12))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"root_pos": np.full(3, np.nan)}, r"pose: root_pos\[0\] is nan, expected a finite number"),
        ({"root_pos": np.zeros(2)}, r"pose: root_pos has shape \(2,\), expected \(3,\)"),
        ({"root_quat": np.zeros(4)}, "pose: root_quat has length 0, expected a unit quaternion wxyz"),
        ({"joint_pos": np.full(29, np.inf)}, r"pose: joint_pos\[0\] is inf"),
    ],
)
def test_a_start_that_is_no_pose_is_refused(simulator, changes, message):
    with pytest.raises(StateError, match=message):
        simulator.reset(replace(standing(G1), **changes))


@pytest.mark.parametrize("velocity", [1.0, [0.5], [0.5, 0.0]])
def test_a_push_has_three_components(simulator, velocity):
    with pytest.raises(StateError, match="push: velocity_w has shape"):
        simulator.push(velocity)


def test_targets_and_pushes_may_be_tensors(simulator):
    target, velocity = torch.full((29,), 0.1), torch.tensor([0.5, 0.0, 0.0])
    ends = []
    for given in ((target.numpy(), velocity.numpy()), (target, velocity)):
        simulator.reset(standing(G1))
        simulator.push(given[1])
        simulator.step(given[0])
        ends.append(simulator.data.qpos.copy())
    np.testing.assert_array_equal(*ends)
    target[3] = torch.nan
    with pytest.raises(ActionError, match="target of joint 'left_knee_joint' is nan"):
        simulator.step(target)
