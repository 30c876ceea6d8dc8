import math

import pytest
import torch

from plat.envs import MotionTrackingEnv
from plat.envs.drift import drifted, estimated_root
from plat.envs.transforms import DomainRandomization, Horizon, KeyframeClock, KeyframeCommand, RandomizationRanges
from plat.envs.transforms.command import CommandSchedule
from plat.rotations import quat_from_rotvec, quat_rotate_inverse, quat_to_matrix


def headed(yaw: float) -> torch.Tensor:
    return quat_from_rotvec(torch.tensor([0.0, 0.0, yaw]))


def test_a_robot_that_stands_drifts_in_heading_alone():
    before = torch.tensor([0.2, -0.1, 0.01, 0.3])
    after = drifted(before, torch.tensor([0.05, 0.05, 0.01]), headed(1.0), torch.zeros(3), 0.02)
    torch.testing.assert_close(after, before + torch.tensor([0.0, 0.0, 0.0, 0.0002]))


def test_a_straight_walk_drifts_by_a_share_of_its_way_in_the_robots_own_direction():
    drift, facing = torch.zeros(4), headed(math.pi / 2)
    for _ in range(500):
        drift = drifted(drift, torch.tensor([0.03, -0.02, 0.0]), facing, torch.tensor([0.0, 1.0, 0.4]), 0.02)
    # 10 m to the north: 0.3 m too far, and 0.2 m to the right; a jump is no way
    torch.testing.assert_close(drift, torch.tensor([0.2, 0.3, 0.0, 0.0]), atol=1e-4, rtol=0)


def test_a_heading_that_is_off_turns_the_way_that_is_reckoned():
    off, position = torch.tensor([0.0, 0.0, 0.0, 0.5]), torch.zeros(3)
    for _ in range(100):
        position = position + 0.02 * torch.tensor([1.0, 0.0, 0.0])
        off = drifted(off, torch.zeros(3), headed(0.0), torch.tensor([1.0, 0.0, 0.0]), 0.02)
    pos, quat = estimated_root(off, position, headed(0.0))
    torch.testing.assert_close(pos, 2 * torch.tensor([math.cos(0.5), math.sin(0.5), 0.0]), atol=1e-4, rtol=0)
    torch.testing.assert_close(quat_to_matrix(quat), quat_to_matrix(headed(0.5)))


def test_no_gradient_is_to_be_had_from_walking_less():
    velocity = torch.zeros(3, requires_grad=True)
    assert not drifted(torch.zeros(4), torch.ones(3), headed(0.0), velocity, 0.02).requires_grad


def test_a_simulation_that_diverged_leaves_the_drift_finite():
    velocity = torch.tensor([math.nan, math.inf, 1.0])
    assert drifted(torch.zeros(4), torch.ones(3), headed(0.0), velocity, 0.02).isfinite().all()


RANGES = RandomizationRanges(position_drift=0.5, heading_drift=0.5, height_error=0.02, control_delay=0.0)


def test_simulated_robots_see_keyframes_from_where_they_take_themselves_to_be(library):
    torch.manual_seed(0)
    env = MotionTrackingEnv(library, 20)
    schedule = CommandSchedule(library, Horizon(50, 50), seed=0)
    env = env.append_transform(KeyframeClock()).append_transform(KeyframeCommand(library, schedule.horizon, schedule))
    env = env.append_transform(DomainRandomization(env.base_env, RANGES))
    out = env.rollout(30, break_when_any_done=False)
    base = env.base_env
    assert 0.3 < base.drift_rate[:, :2].abs().max() <= 0.5
    assert 0.3 < base.drift_rate[:, 2].abs().max() <= 0.5
    assert 0.01 < out["estimate", "root_pos_w"][:, 0, 2].sub(out["state", "root_pos_w"][:, 0, 2]).abs().max() <= 0.02
    last = out[:, -1]
    off = last["estimate", "root_pos_w"] - last["state", "root_pos_w"]
    assert off[:, :2].norm(dim=-1).max() > 0.05
    target = library.poses(last["command", "target_frame"])["keypoint_pos"][:, 0]
    seen = quat_rotate_inverse(last["estimate", "root_quat_w"], target - last["estimate", "root_pos_w"])
    torch.testing.assert_close(last["goal", "root_pos_b"], seen, atol=1e-5, rtol=0)
    # scores are of where the robot is: the state is the simulation's
    torch.testing.assert_close(out["next", "state", "root_pos_w"][:, -1], base.qpos[:, :3])


def test_without_drift_the_estimate_is_the_truth(library):
    out = MotionTrackingEnv(library, 3).rollout(3)
    for entry in ("root_pos_w", "root_quat_w"):
        assert out["estimate", entry].equal(out["state", entry])


@pytest.mark.parametrize("name", ["position_drift", "heading_drift", "height_error"])
def test_ranges_scale(name):
    assert getattr(RANGES.scaled(0.5), name) == 0.5 * getattr(RANGES, name)
