import math

import pytest
import torch

from plat.motions.resample import finite_difference, quat_finite_difference, resample_qpos
from plat.rotations import quat_from_rotvec, quat_to_rotvec


def spinning(frames: int, fps: float) -> torch.Tensor:
    """Root turning at 0.5 rad/s about x, joint 0 moving at 2 rad/s."""
    time = torch.arange(frames, dtype=torch.float64) / fps
    rotvec = torch.stack((0.5 * time, torch.zeros_like(time), torch.zeros_like(time)), -1)
    joints = torch.zeros(frames, 29, dtype=torch.float64)
    joints[:, 0] = 2 * time
    return torch.cat((torch.zeros(frames, 3), quat_from_rotvec(rotvec), joints), -1)


@pytest.mark.parametrize("fps", [24.0, 29.97, 30.0, 50.0, 60.0, 120.0])
def test_uniform_motion_stays_uniform(fps):
    out = resample_qpos(spinning(100, fps), fps, 0.02)
    time = torch.arange(len(out)) * 0.02
    torch.testing.assert_close(out[:, 7], 2 * time, check_dtype=False)
    torch.testing.assert_close(quat_to_rotvec(out[:, 3:7])[:, 0], 0.5 * time, check_dtype=False)
    assert abs((len(out) - 1) * 0.02 - 99 / fps) < 0.02


def test_same_rate_changes_nothing():
    qpos = spinning(40, 50.0)
    torch.testing.assert_close(resample_qpos(qpos, 50.0, 0.02), qpos)


def test_quaternions_of_opposite_sign_are_no_jump():
    qpos = spinning(20, 30.0)
    flipped = qpos.clone()
    flipped[1::2, 3:7] *= -1
    out = resample_qpos(flipped, 30.0, 0.02)
    torch.testing.assert_close(out[:, 3:7].abs(), resample_qpos(qpos, 30.0, 0.02)[:, 3:7].abs())


def test_differences_use_the_span_they_have():
    values = torch.tensor([0.0, 1.0, 4.0, 9.0])
    before, after = torch.tensor([0, 0, 1, 2]), torch.tensor([1, 2, 3, 3])
    assert finite_difference(values, before, after, 0.5).tolist() == [2.0, 4.0, 8.0, 10.0]


def test_angular_velocity_is_in_the_world():
    # turning about the world's z at 1 rad/s while lying on the side
    time = torch.arange(10, dtype=torch.float64) * 0.02
    lying = quat_from_rotvec(torch.tensor([math.pi / 2, 0, 0], dtype=torch.float64))
    from plat.rotations import quat_multiply

    about_z = quat_from_rotvec(torch.stack((0 * time, 0 * time, time), -1))
    quat = quat_multiply(about_z, lying.expand(10, 4))
    velocity = quat_finite_difference(quat, torch.arange(8), torch.arange(8) + 2, 0.02)
    torch.testing.assert_close(velocity, torch.tensor([0.0, 0, 1], dtype=torch.float64).expand(8, 3))
