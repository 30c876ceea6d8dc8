import numpy as np
import pytest
import torch

from plat.envs import G1, ForwardKinematics
from plat.envs.motions import generate_motions
from plat.envs.motions.generation.families import FAMILIES
from plat.envs.motions.generation.whole_body import WholeBody
from plat.errors import MotionError


@pytest.fixture(scope="module", params=sorted(FAMILIES))
def clips(request) -> list:
    return generate_motions("train", seconds=30, families=(request.param,))


def feet(qpos: np.ndarray) -> tuple[torch.Tensor, torch.Tensor]:
    kinematics = ForwardKinematics(G1, G1.feet)
    return kinematics(*torch.from_numpy(qpos).double().split((3, 4, 29), -1))


def test_joint_limits_hold(clips):
    for clip in clips:
        low, high = G1.joint_range.numpy().T
        assert (clip.qpos[:, 7:] >= low - 1e-6).all(), clip.name
        assert (clip.qpos[:, 7:] <= high + 1e-6).all(), clip.name


def test_joint_speeds_are_human(clips):
    for clip in clips:
        assert np.abs(np.diff(clip.qpos[:, 7:], axis=0)).max() * clip.fps < 8.0, clip.name


def test_feet_are_planted(clips):
    for clip in clips:
        pos, _ = feet(clip.qpos)
        height = pos[..., 2] - 0.035
        assert height.min() > -1e-3, clip.name
        # one sole at least is on the floor in every frame, and a sole on the floor does not slide
        assert (height.amin(-1) < 1e-3).all(), clip.name
        down = (height[1:] < 1e-3) & (height[:-1] < 1e-3)
        slide = (pos[1:, :, :2] - pos[:-1, :, :2]).norm(dim=-1)
        assert slide[down].max() < 1e-3, clip.name


def test_weight_is_over_the_feet(clips):
    body = WholeBody(G1)
    for clip in clips:
        pos, _ = feet(clip.qpos)
        com = body.center_of_mass(torch.from_numpy(clip.qpos).double())[:, :2]
        acceleration = torch.zeros_like(com)
        acceleration[1:-1] = (com[2:] - 2 * com[1:-1] + com[:-2]) * clip.fps**2
        zmp = com - 0.67 / 9.81 * acceleration
        low, high = pos[..., :2].amin(1), pos[..., :2].amax(1)
        # a box around both soles; in single support the walk's own plan keeps it over the standing foot
        outside = torch.maximum(low - torch.tensor([0.07, 0.05]) - zmp, zmp - high - torch.tensor([0.14, 0.05])).amax(
            -1
        )
        assert (outside[5:-5] <= 0).float().mean() > 0.99, clip.name


def test_clips_begin_and_end_at_rest_in_the_default_posture(clips):
    for clip in clips:
        if clip.name.startswith("walk"):
            continue  # walks lower the pelvis a little throughout
        np.testing.assert_allclose(clip.qpos[0, 7 + 12 :], G1.default_joint_pos[12:], atol=0.02)
        np.testing.assert_allclose(clip.qpos[-1, 7 + 12 :], G1.default_joint_pos[12:], atol=0.02)


def test_same_seed_same_motion():
    first, second = generate_motions("val", seconds=20), generate_motions("val", seconds=20)
    assert all(np.array_equal(a.qpos, b.qpos) for a, b in zip(first, second, strict=True))


def test_a_longer_set_holds_the_same_clips():
    short, long = generate_motions("val", seconds=20), generate_motions("val", seconds=40)
    assert all(np.array_equal(a.qpos, b.qpos) for a, b in zip(short, long, strict=False))


def test_splits_share_no_motion():
    train, val = (generate_motions(split, seconds=12, families=("reach",)) for split in ("train", "val"))
    assert not any(a.qpos.shape == b.qpos.shape and np.allclose(a.qpos, b.qpos) for a in train for b in val)


def test_families_cover_the_set():
    assert {clip.name.split("_")[0] for clip in generate_motions("test", seconds=35)} == set(FAMILIES)


def test_every_seed_of_the_demo_works():
    assert sum(clip.duration for clip in generate_motions("train")) >= 240


def test_unknown_family():
    with pytest.raises(MotionError, match="no family \\['fly'\\]"):
        generate_motions("train", families=("fly",))
