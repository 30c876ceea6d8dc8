"""Constraints of Kimodo, against the robot's own kinematics."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plat.errors import KeyframeError
from plat.keyframes import Keyframe, only
from plat.keyframes.kimodo import read_constraints, write_constraints
from plat.motions.formats.links import qpos_of_links, world_rotations
from plat.robots import G1
from tests.motions.formats.writers import bowing_clip, link_arrays

CLIP = bowing_clip(heading=0.7)
POSES = [Keyframe.from_qpos(frame / 30, CLIP.qpos[frame]) for frame in (9, 21, 30)]


def test_round_trip(tmp_path):
    write_constraints(tmp_path / "c.json", G1, POSES)
    (entry,) = json.loads((tmp_path / "c.json").read_text())
    assert (entry["type"], entry["frame_indices"]) == ("fullbody", [9, 21, 30])
    assert np.shape(entry["local_joints_rot"]) == (3, 34, 3)
    assert entry["smooth_root_2d"][0] == [entry["root_positions"][0][0], entry["root_positions"][0][2]]
    found, left_out = read_constraints(tmp_path / "c.json", G1)
    assert left_out == []
    for pose, again in zip(POSES, found, strict=True):
        np.testing.assert_allclose(again.qpos, pose.qpos, atol=1e-5)
        assert again.time == pytest.approx(pose.time)


def test_local_rotations_are_those_of_the_links(tmp_path):
    # the same rotations by scipy, link after link along the left leg
    write_constraints(tmp_path / "c.json", G1, POSES)
    (entry,) = json.loads((tmp_path / "c.json").read_text())
    world = link_arrays(CLIP)["global_rot_mats"][[9, 21, 30]]
    turned = np.eye(3)
    for link in range(7):
        turned = turned @ Rotation.from_rotvec(np.array(entry["local_joints_rot"])[:, link]).as_matrix()
    np.testing.assert_allclose(turned, world[:, 6], atol=1e-5)


def test_ends_follow_their_links():
    from plat.motions.formats.links import links_of_qpos

    local, root_pos = links_of_qpos(CLIP.qpos.astype(float), G1)
    world = world_rotations(local, G1)
    np.testing.assert_allclose(world, link_arrays(CLIP)["global_rot_mats"], atol=1e-5)
    np.testing.assert_allclose(qpos_of_links(world, root_pos, G1), CLIP.qpos, atol=1e-5)


def test_what_is_left_out_and_what_is_refused(tmp_path):
    write_constraints(tmp_path / "c.json", G1, POSES, fps=60)
    content = json.loads((tmp_path / "c.json").read_text())
    path = {"type": "root2d", "frame_indices": [0], "smooth_root_2d": [[0, 0]]}
    (tmp_path / "c.json").write_text(json.dumps([path, *content]))
    found, left_out = read_constraints(tmp_path / "c.json", G1, fps=60)
    assert left_out == ["constraint 0 of type 'root2d'"]
    assert [round(pose.time, 3) for pose in found] == [0.3, 0.7, 1.0]
    for text, message in (
        ([path], "no constraint of type 'fullbody'"),
        ({}, "expected a list of objects"),
        (
            [{**content[0], "local_joints_rot": np.zeros((3, 77, 3)).tolist()}],
            r"has shape \(3, 77, 3\).*expected \(3, 34, 3\)",
        ),
        ([{"type": "fullbody"}], "constraint 0: no 'frame_indices'"),
        ([{**content[0], "root_positions": "x"}], "'root_positions' is no array of numbers"),
        ([{**content[0], "frame_indices": [10**400]}], "'frame_indices' is no array of numbers"),
        ([{**content[0], "frame_indices": 3}], r"'frame_indices' has shape \(\), expected one number for each pose"),
    ):
        (tmp_path / "c.json").write_text(json.dumps(text))
        with pytest.raises(KeyframeError, match=message):
            read_constraints(tmp_path / "c.json", G1)
    with pytest.raises(KeyframeError, match="two keyframes on one frame"):
        write_constraints(tmp_path / "c.json", G1, [POSES[0], POSES[0].at(POSES[0].time + 0.001)])
    with pytest.raises(KeyframeError, match=r"c.json': keyframe 0 commands parts of .* these constraints have"):
        write_constraints(tmp_path / "c.json", G1, [only(G1, 0.5, height=0.7)])
