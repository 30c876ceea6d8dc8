import torch

from plat.envs.transforms import NoiseLevels, ObservationNoise
from plat.robots import G1


def test_noise_is_within_its_bounds_and_nowhere_else(library):
    from plat.envs import MotionTrackingEnv

    state = MotionTrackingEnv(library, 64).reset()
    clean = state["robot"].clone()
    levels = NoiseLevels()
    noisy = ObservationNoise(G1, levels)._call(state)["robot"]
    for name in ("joint_pos", "joint_vel", "root_ang_vel_b", "root_lin_vel_b", "gravity_b"):
        difference = (noisy[name] - clean[name]).abs()
        bound = getattr(levels, name)
        assert difference.max() <= bound + 1e-6
        assert difference.max() > 0.8 * bound
    assert torch.equal(noisy["last_action"], clean["last_action"])
