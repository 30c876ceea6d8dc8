"""Rotations of links against the robot's own kinematics."""

import mujoco
import numpy as np

from plat.motions.formats.links import link_count, links_of_qpos, qpos_of_links
from plat.robots import G1
from plat.rotations_np import quat_to_matrix

from .writers import bowing_clip, link_arrays


def test_world_rotations_give_the_motion_back():
    clip = bowing_clip(heading=2.5)
    arrays = link_arrays(clip)
    assert arrays["global_rot_mats"].shape == (40, 34, 3, 3) == (40, link_count(G1), 3, 3)
    qpos = qpos_of_links(arrays["global_rot_mats"], arrays["root_positions"], G1)
    np.testing.assert_allclose(qpos, clip.qpos, atol=1e-5)


def test_local_rotations_lead_to_the_bodies():
    clip = bowing_clip(heading=-1.0)
    local, root_pos = links_of_qpos(clip.qpos.astype(float), G1)
    np.testing.assert_allclose(root_pos[0], clip.qpos[0, [1, 2, 0]], atol=1e-6)
    # down the left leg, parent after parent, to the foot's own rotation
    model = G1.shared_model
    data = mujoco.MjData(model)
    data.qpos[:] = clip.qpos[20]
    mujoco.mj_kinematics(model, data)
    rotation = np.eye(3)
    for link in (0, 1, 2, 3, 4, 5, 6):
        rotation = rotation @ quat_to_matrix(local[20, link])
    axes = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]])
    foot = data.body("left_ankle_roll_link").xmat.reshape(3, 3)
    np.testing.assert_allclose(rotation, axes @ foot @ axes.T, atol=1e-6)
    # ends of feet and hands turn with what they end
    np.testing.assert_array_equal(local[:, 7], np.tile([1, 0, 0, 0], (40, 1)))
