from dataclasses import replace

import torch

from plat.envs import MotionTrackingEnv
from plat.envs.transforms import NoiseLevels, ObservationNoise
from plat.robots import G1
from plat.spec.observation import OBSERVATION, ObservationTable, observing


def test_noise_is_within_its_bounds_and_nowhere_else(library):
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


def test_noise_is_the_same_in_physical_units_however_a_table_scales(library):
    def noisy(entries):
        with observing(ObservationTable({**OBSERVATION.groups, "robot": entries})):
            torch.manual_seed(3)
            state = MotionTrackingEnv(library, 8).reset()
            return ObservationNoise(G1, NoiseLevels())._call(state)["robot"]

    robot = OBSERVATION.entries("robot")
    plain = noisy(robot)
    factors = {entry.name: factor for entry, factor in zip(robot, (2.0, 0.05, -0.25, 1.0, 3.0, 0.5), strict=True)}
    scaled = noisy(tuple(replace(entry, scale=factors[entry.name]) for entry in robot))
    for name, factor in factors.items():
        torch.testing.assert_close(scaled[name] / factor, plain[name], msg=name)
    kept = tuple(entry for entry in robot if entry.name != "root_lin_vel_b")
    assert set(noisy(kept).keys()) == {entry.name for entry in kept}  # a robot that has no such estimate
