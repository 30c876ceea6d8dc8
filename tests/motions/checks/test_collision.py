import mujoco
import numpy as np
import pytest

from plat.motions.checks.collision import self_penetration
from plat.robots import G1


@pytest.fixture
def data() -> mujoco.MjData:
    return mujoco.MjData(G1.shared_model)


def test_standing_touches_only_the_floor(data):
    pose = G1.default_qpos.copy()
    pose[2] -= 0.05
    assert self_penetration(G1.shared_model, pose, data) == 0
    assert data.ncon > 0


def test_in_the_air_there_is_no_contact_at_all(data):
    pose = G1.default_qpos.copy()
    pose[2] += 1
    assert self_penetration(G1.shared_model, pose, data) == 0
    assert data.ncon == 0


def test_the_deepest_contact_counts_and_earlier_poses_do_not(data):
    pose = G1.default_qpos.copy()
    pose[7 + G1.joint_names.index("left_shoulder_roll")] = -1.2
    depth = self_penetration(G1.shared_model, pose, data)
    links = (G1.shared_model.geom_bodyid[data.contact.geom] > 0).all(-1)
    assert depth == -data.contact.dist[links].min() > 0.01
    np.testing.assert_array_equal(data.qpos, pose)
    assert self_penetration(G1.shared_model, G1.default_qpos, data) == 0
