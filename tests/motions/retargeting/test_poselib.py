"""Motions of poselib, against the same human in BVH."""

from collections import OrderedDict

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from plat.errors import MotionError
from plat.motions import read_motion_files
from plat.motions.retargeting import bvh_paths, read_bvh
from plat.motions.retargeting.poselib import holds_poselib, read_poselib

from .human import write_human

TURNS = {"LeftUpLeg": (0, 0, 30), "RightForeArm": (40, 0, 0), "Hips": (0, 40, 0)}
# the humanoid of AMP and ASE: joint, parent, place (m) in the parent's axes
HUMANOID = [
    ("pelvis", -1, (0, 0, 0)),
    ("torso", 0, (0, 0, 0.236)),
    ("head", 1, (0, 0, 0.224)),
    ("right_upper_arm", 1, (-0.02, -0.18, 0.25)),
    ("right_lower_arm", 3, (0, 0, -0.27)),
    ("right_hand", 4, (0, 0, -0.26)),
    ("left_upper_arm", 1, (-0.02, 0.18, 0.25)),
    ("left_lower_arm", 6, (0, 0, -0.27)),
    ("left_hand", 7, (0, 0, -0.26)),
    ("right_thigh", 0, (0, -0.08, 0)),
    ("right_shin", 9, (0, 0, -0.42)),
    ("right_foot", 10, (0, 0, -0.41)),
    ("left_thigh", 0, (0, 0.08, 0)),
    ("left_shin", 12, (0, 0, -0.42)),
    ("left_foot", 13, (0, 0, -0.41)),
]


def tensor(array) -> dict[str, object]:
    return {"arr": np.asarray(array), "context": {"dtype": "float32"}}


def content(names, parents, offsets, quat, place, *, local=True, fps=30) -> OrderedDict[str, object]:
    tree = {
        "node_names": list(names),
        "parent_indices": tensor(parents),
        "local_translation": tensor(np.float32(offsets)),
    }
    return OrderedDict(
        rotation=tensor(np.float32(quat)),
        root_translation=tensor(np.float32(place)),
        skeleton_tree=OrderedDict(tree),
        is_local=local,
        fps=fps,
        __name__="SkeletonMotion",
    )


def humanoid(frames: int = 40, local: bool = True) -> OrderedDict[str, object]:
    """It bends both elbows, there and back, and turns about the vertical."""
    names, parents, offsets = zip(*HUMANOID, strict=True)
    share = np.sin(np.pi * np.arange(frames) / (frames - 1)) ** 2
    quat = np.tile([0.0, 0, 0, 1], (frames, len(names), 1))
    turn = Rotation.from_rotvec(0.6 * share[:, None] * [0, 0, 1]).as_quat()
    bend = Rotation.from_rotvec(-0.9 * share[:, None] * [0, 1, 0]).as_quat()
    quat[:, 0] = turn
    for side in ("left", "right"):
        quat[:, names.index(f"{side}_lower_arm")] = bend
    if not local:
        world = [turn if "lower_arm" not in name and "hand" not in name else None for name in names]
        both = (Rotation.from_quat(turn) * Rotation.from_quat(bend)).as_quat()
        quat = np.stack([both if one is None else one for one in world], 1)
    place = np.tile([0.3, -0.2, 0.89], (frames, 1))
    return content(names, parents, offsets, quat, place, local=local)


@pytest.mark.parametrize("local", [True, False])
def test_joints_are_where_those_of_the_same_human_in_bvh_are(tmp_path, local):
    mocap = read_bvh(write_human(tmp_path / "person.bvh", frames=12, turns=TURNS))
    local_turns = mocap.rotations.copy()
    for joint, parent in enumerate(mocap.parents):
        if parent >= 0:
            local_turns[:, joint] = mocap.rotations[:, parent].transpose(0, 2, 1) @ mocap.rotations[:, joint]
    offsets = [
        np.zeros(3) if parent < 0 else mocap.rest[joint] - mocap.rest[parent]
        for joint, parent in enumerate(mocap.parents)
    ]
    turns = local_turns if local else mocap.rotations
    quat = Rotation.from_matrix(turns.reshape(-1, 3, 3)).as_quat().reshape(*turns.shape[:2], 4)
    stored = content(mocap.names, mocap.parents, offsets, quat, mocap.positions[:, 0], local=local)
    np.save(tmp_path / "person.npy", stored)
    read = read_poselib(tmp_path / "person.npy")
    assert (read.names, read.parents, read.fps) == (mocap.names, mocap.parents, 30)
    np.testing.assert_allclose(read.positions, mocap.positions, atol=1e-3)
    np.testing.assert_allclose(read.rotations, mocap.rotations, atol=1e-5)


@pytest.mark.parametrize("local", [True, False])
def test_the_humanoid_of_amp_is_retargeted(tmp_path, local):
    pytest.importorskip("mink")
    np.save(tmp_path / "wave.npy", humanoid(local=local))
    np.save(tmp_path / "other.npy", np.zeros((3, 2)))
    assert [path.name for path in bvh_paths([tmp_path])] == ["wave.npy"]
    (file,) = read_motion_files(tmp_path / "wave.npy")
    assert file.format == "human NPY, retargeted"
    assert "map amp" in file.facts
    clip = file.clips[0]
    assert (clip.fps, len(clip.qpos)) == (30, 40)
    forward = Rotation.from_quat(clip.qpos[:, [4, 5, 6, 3]]).apply([1.0, 0, 0])
    heading = np.arctan2(forward[:, 1], forward[:, 0])
    np.testing.assert_allclose(heading[[0, 20]], [0, 0.6], atol=0.05)
    assert 0.6 < clip.qpos[0, 2] < 0.85


def test_feet_without_toes_get_a_ball_in_front(tmp_path):
    np.save(tmp_path / "wave.npy", humanoid())
    mocap = read_poselib(tmp_path / "wave.npy")
    ball = mocap.positions[:, mocap.names.index("left_foot_end")]
    ankle = mocap.positions[:, mocap.names.index("left_foot")]
    np.testing.assert_allclose(ball[0] - ankle[0], [0.16 * 0.83, 0, -0.05 * 0.83], atol=1e-3)
    np.testing.assert_allclose(np.linalg.norm(ball - ankle, axis=1), np.linalg.norm(ball[0] - ankle[0]), atol=1e-6)


def changed(**fields) -> OrderedDict[str, object]:
    return OrderedDict(humanoid(), **fields)


def without(field: str) -> OrderedDict[str, object]:
    return OrderedDict((name, value) for name, value in humanoid().items() if name != field)


@pytest.mark.parametrize(
    ("stored", "message"),
    [
        (without("fps"), "a pose of poselib and no motion"),
        (
            np.zeros((40, 22, 3)),
            r"an array of shape \(40, 22, 3\): if these are joint positions of a human, write them",
        ),
        (without("rotation"), "no motion of poselib, expected a dictionary with rotation"),
        (changed(root_translation=tensor(np.zeros(3))), r"'root_translation' has shape \(3,\)"),
        (changed(rotation=tensor(np.zeros((40, 15, 4)))), "quaternions that are not of length 1"),
        (changed(rotation=tensor(np.full((40, 15, 4), np.nan))), "'rotation' holds a value that is not finite"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, stored, message):
    np.save(tmp_path / "skeleton_tree.npy", stored)
    with pytest.raises(MotionError, match=f"NPY file '.*': .*{message}"):
        read_poselib(tmp_path / "skeleton_tree.npy")


def test_only_skeletons_are_taken_for_poselib(tmp_path):
    np.save(tmp_path / "a.npy", humanoid(5))
    np.save(tmp_path / "b.npy", np.zeros((5, 36)))
    (tmp_path / "c.npy").write_bytes(b"skeleton_tree")
    assert [holds_poselib(tmp_path / f"{name}.npy") for name in "abc"] == [True, False, False]
