import numpy as np
import pytest
import torch

from plat.robots import G1, ForwardKinematics
from plat.rotations import quat_from_rotvec, quat_multiply
from plat.studio.poses import Floor, mirrored, placed

LEFT_ROLL, RIGHT_ROLL = (7 + G1.joint_names.index(f"{side}_hip_roll") for side in ("left", "right"))


def turned(yaw: float, x: float = 0.0, y: float = 0.0) -> np.ndarray:
    """The default pose, leaning forward, somewhere else."""
    qpos = G1.default_qpos.copy()
    rotvec = torch.tensor([[0.0, 0.0, yaw], [0.0, 0.3, 0.0]], dtype=torch.float64)
    qpos[:2] = x, y
    qpos[3:7] = quat_multiply(*quat_from_rotvec(rotvec)).numpy()
    return qpos


def keypoints(qpos: np.ndarray) -> np.ndarray:
    return ForwardKinematics(G1)(*torch.from_numpy(qpos).split((3, 4, 29), -1))[0].numpy()


def test_the_origin_is_put_on_the_place():
    origin, place = turned(0.4, 1.0, -2.0), turned(-1.1, 0.5, 3.0)
    np.testing.assert_allclose(placed(origin, origin, place), place, atol=1e-9)


def test_all_poses_are_moved_alike():
    rng = np.random.default_rng(0)
    poses = np.stack([turned(*rng.normal(size=3)) for _ in range(5)])
    there = placed(poses, poses[0], turned(2.0, 1.0, 1.0))
    before = [keypoints(pose) - keypoints(poses[0])[0] for pose in poses]
    after = [keypoints(pose) - keypoints(there[0])[0] for pose in there]
    for old, new in zip(before, after, strict=True):
        np.testing.assert_allclose(np.linalg.norm(new, axis=-1), np.linalg.norm(old, axis=-1), atol=1e-6)
        np.testing.assert_allclose(new[:, 2], old[:, 2], atol=1e-6)


def test_mirroring_exchanges_sides_and_stays_in_place():
    qpos = turned(0.7, 2.0, 1.0)
    qpos[LEFT_ROLL] = 0.4
    image = mirrored(qpos, G1)
    np.testing.assert_allclose(image[:7], qpos[:7], atol=1e-9)
    assert image[RIGHT_ROLL] == pytest.approx(-0.4)
    assert image[LEFT_ROLL] == pytest.approx(0.0)
    np.testing.assert_allclose(mirrored(image, G1), qpos, atol=1e-9)


def test_mirroring_turns_a_lean_to_the_side_round():
    qpos = G1.default_qpos.copy()
    qpos[3:7] = quat_from_rotvec(torch.tensor([0.2, 0.0, 0.0], dtype=torch.float64)).numpy()
    np.testing.assert_allclose(mirrored(qpos, G1)[4], -qpos[4])


def test_any_part_of_the_body_can_be_the_lowest():
    qpos = turned(0.0)
    qpos[3:7] = quat_from_rotvec(torch.tensor([0.0, np.pi / 2, 0.0], dtype=torch.float64)).numpy()  # lying
    floor = Floor(G1)
    lying = floor.dropped(qpos)
    assert 0.03 < lying[2] < 0.25
    assert floor.clearance(lying) == pytest.approx(0.0, abs=1e-9)


def test_a_pose_in_the_floor_is_lifted():
    sunk = G1.default_qpos - 0.2 * np.eye(36)[2]
    floor = Floor(G1)
    assert floor.clearance(sunk) < -0.19
    assert floor.clearance(floor.dropped(sunk)) == pytest.approx(0.0, abs=1e-9)
