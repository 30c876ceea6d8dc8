import torch

from plat.envs import GeneralizedState, MotionTrackingEnv, ResetNoise


def test_entries_are_the_simulators_own_state(library):
    env = MotionTrackingEnv(library, 3, reset_noise=ResetNoise())
    state = GeneralizedState.from_entries(env.rollout(4)[:, -1])
    after = GeneralizedState.from_entries(env.reset())
    torch.testing.assert_close(after.qpos, env.physics.read("qpos"))
    torch.testing.assert_close(after.qvel, env.physics.read("qvel"), atol=1e-5, rtol=1e-5)
    assert state.pack().shape == (3, 71)


def test_pack_and_unpack_are_inverse():
    values = torch.randn(2, 5, 71)
    assert GeneralizedState.unpack(values).pack().equal(values)
    state = GeneralizedState.unpack(values)
    assert torch.cat((state.qpos, state.qvel), -1).equal(values)


def test_a_motion_starts_the_simulator_in_its_state(library):
    env = MotionTrackingEnv(library, 4)
    entries = env.reset()
    wanted = GeneralizedState.from_motion(library.states(entries["motion", "frame"]))
    for ours, theirs in zip(GeneralizedState.from_entries(entries), wanted, strict=True):
        torch.testing.assert_close(ours, theirs, atol=1e-4, rtol=1e-4)


def test_root_frame_of_a_robot_on_its_side():
    values = torch.zeros(1, 71)
    values[0, 3:7] = torch.tensor([0.5**0.5, 0.5**0.5, 0, 0])  # a quarter turn about x
    values[0, 36:39] = torch.tensor([1.0, 0, 2.0])
    gravity_b, lin_vel_b = GeneralizedState.unpack(values).in_root_frame()
    torch.testing.assert_close(gravity_b, torch.tensor([[0.0, -1.0, 0.0]]))
    torch.testing.assert_close(lin_vel_b, torch.tensor([[1.0, 2.0, 0.0]]))
