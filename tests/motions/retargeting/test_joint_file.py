"""Joint positions of humans in archives, against the same human in BVH."""

import numpy as np
import pytest

from plat.errors import MotionError
from plat.motions import read_motion_files
from plat.motions.retargeting import builtin_maps, read_bvh, retarget
from plat.motions.retargeting.builtin import find_map
from plat.motions.retargeting.geometry import RobotGeometry
from plat.motions.retargeting.human import read_human
from plat.motions.retargeting.joint_file import _SMPL_TREE, holds_human_joints, read_joint_file
from plat.motions.retargeting.targets import robot_targets
from plat.robots import G1

from .human import write_human

MAPS = {skeleton.name: skeleton for skeleton in builtin_maps()}
TURNS = {"LeftUpLeg": (0, 0, 30), "RightForeArm": (40, 0, 0), "Hips": (0, 40, 0)}
# number of joints, map by which they are known, columns of hips, left toe and right wrist
LAYOUTS = {
    77: ("soma", 0, 70, 42),
    30: ("soma", 0, 25, 19),
    27: ("animated_drawings", 0, 26, 10),
    22: ("amass", 0, 10, 21),
}


@pytest.fixture(scope="module")
def person(tmp_path_factory):
    """A human that is retargeted from BVH."""
    pytest.importorskip("mink")
    path = write_human(tmp_path_factory.mktemp("bvh") / "person.bvh", frames=12, turns=TURNS)
    return read_bvh(path), retarget(path)


def joints(mocap, name: str, count: int) -> np.ndarray:
    """The human's joints in the columns of a layout, in meters."""
    from plat.motions.retargeting.joint_file import _LAYOUTS

    places = np.zeros((len(mocap.positions), count, 3))
    for role, joint in MAPS[name].joints.items():
        places[:, _LAYOUTS[count][joint][0]] = 0.01 * mocap.positions[:, mocap.names.index(MAPS["lafan1"].joints[role])]
    return places


@pytest.mark.parametrize("count", LAYOUTS)
def test_the_number_of_joints_tells_the_skeleton(tmp_path, person, count):
    mocap, made = person
    name, *columns = LAYOUTS[count]
    places = joints(mocap, name, count)
    for role, column in zip(("hips", "left_toe", "right_wrist"), columns, strict=True):
        index = mocap.names.index(MAPS["lafan1"].joints[role])
        np.testing.assert_allclose(places[:, column], 0.01 * mocap.positions[:, index])
    np.savez(tmp_path / "joints.npz", posed_joints=places, fps=30)
    (file,) = read_motion_files(tmp_path)
    assert file.format == "human NPZ, retargeted"
    assert f"map {name}" in file.facts
    assert f"joints by their number, {count}" in file.facts
    # the pitch of pelvis and trunk is the map's, all else is the human's
    difference = np.abs(file.clips[0].qpos - made.clip.qpos)
    legs = [7 + index for index in (3, 4, 9, 10)]
    assert difference[:, legs].max() < 0.2
    assert difference[:, :3].max() < 0.06


def test_who_stands_upright_in_smpl_is_an_upright_robot(tmp_path):
    """Its lines from pelvis to spine1 and from spine3 to neck lean back by 10 to 14 degrees in the rest pose."""
    body = {  # rest pose of the mean body: x left, y up, z forward (m)
        "pelvis": (0, 0, 0),
        "spine1": (0, 0.109, -0.027),
        "spine2": (0, 0.244, -0.026),
        "spine3": (0, 0.297, 0),
        "neck": (0, 0.511, -0.043),
        "head": (0, 0.576, 0.008),
        "hip": (0.069, -0.091, -0.006),
        "knee": (0.105, -0.47, -0.013),
        "ankle": (0.09, -0.868, -0.056),
        "foot": (0.116, -0.92, 0.065),
        "collar": (0.08, 0.417, -0.037),
        "shoulder": (0.173, 0.448, -0.046),
        "elbow": (0.43, 0.435, -0.073),
        "wrist": (0.68, 0.444, -0.074),
    }
    names = [row.split()[0] for row in _SMPL_TREE]
    sides = np.array([-1 if "right" in name else 1 for name in names])
    rest = np.array([body[name.split("_")[-1]] for name in names]) * np.column_stack((sides, np.ones((22, 2))))
    rest[:, 1] += 0.95
    np.savez(tmp_path / "stand.npz", joints=np.tile(rest, (5, 1, 1)), fps=20)
    mocap = read_joint_file(tmp_path / "stand.npz")
    skeleton = find_map(mocap, "stand.npz")
    targets = robot_targets(read_human(mocap, skeleton, "stand.npz"), skeleton, RobotGeometry.of(G1), mocap.fps)
    for role in ("pelvis", "torso"):
        assert np.degrees(np.arccos(targets.rotations[role][:, 2, 2])).max() < 2


def test_rates_names_and_rotations(tmp_path, person):
    mocap, _ = person
    places = joints(mocap, "soma", 30)
    np.savez(tmp_path / "kimodo.npz", posed_joints=places, global_rot_mats=np.tile(np.eye(3), (12, 30, 1, 1)))
    found = read_joint_file(tmp_path / "kimodo.npz")
    assert found.fps == 30
    assert "fps as Kimodo writes it" in found.notes
    assert found.rotations.shape == (12, 23, 3, 3)
    np.savez(tmp_path / "smpl.npz", joints=joints(mocap, "amass", 22))
    with pytest.raises(MotionError, match="NPZ file '.*smpl.npz': no array 'fps'"):
        read_joint_file(tmp_path / "smpl.npz")
    assert read_joint_file(tmp_path / "smpl.npz", fps=20).fps == 20
    np.savez(tmp_path / "named.npz", joints=0.01 * mocap.positions, joint_names=mocap.names, mocap_framerate=60)
    named = read_joint_file(tmp_path / "named.npz")
    assert named.fps == 60
    assert named.names == mocap.names
    assert named.notes == ()


def test_which_archives_hold_a_human(tmp_path):
    np.savez(tmp_path / "robot.npz", qpos=np.zeros((3, 36)), human_joints=np.zeros((3, 22, 3)), fps=30)
    np.savez(tmp_path / "links.npz", posed_joints=np.zeros((3, 34, 3)))
    np.savez(tmp_path / "human.npz", joints=np.zeros((3, 52, 3)))
    (tmp_path / "broken.npz").write_bytes(b"no archive")
    found = [path.stem for path in sorted(tmp_path.iterdir()) if holds_human_joints(path)]
    assert found == ["human"]


@pytest.mark.parametrize("name", ["dof", "dof_positions", "ref_dof_pos", "robot_joint_pos"])
def test_human_joints_beside_a_motion_of_the_robot_are_not_retargeted(tmp_path, name):
    np.savez(tmp_path / "a.npz", posed_joints=np.zeros((4, 22, 3)), fps=30)
    assert holds_human_joints(tmp_path / "a.npz")
    np.savez(tmp_path / "a.npz", **{name: np.zeros((4, 29))}, posed_joints=np.zeros((4, 22, 3)), fps=30)
    assert not holds_human_joints(tmp_path / "a.npz")


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["a", *"bcdefghijklmnopqrstu", "a"], "'joint_names' has 'a' twice, expected each joint once"),
        ([*"abcdefghijklmnopqrstu"], "'joint_names' has 21 names, expected 22"),
    ],
)
def test_names_that_are_none_of_these_joints_are_refused(tmp_path, names, message):
    """The last of two columns was taken, and a list of another length ignored."""
    np.savez(tmp_path / "a.npz", joints=np.zeros((5, 22, 3)), joint_names=names, fps=30)
    with pytest.raises(MotionError, match=f"a.npz': {message}"):
        read_joint_file(tmp_path / "a.npz")
    np.savez(tmp_path / "a.npz", joints=np.zeros((5, 22, 3)), names=["a walk"], fps=30)  # of something else
    assert "joints by their number, 22" in read_joint_file(tmp_path / "a.npz").notes


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"poses": np.zeros((4, 156)), "trans": np.zeros((4, 3))}, "human motion of the SMPL family"),
        ({"joints": np.zeros((4, 17, 3))}, r"no joint positions .* in SMPL's order .*; it has 'joints' \(4, 17, 3\)"),
    ],
    ids=["AMASS", "other joints"],
)
def test_what_holds_no_joints_that_are_known_is_named(tmp_path, arrays, message):
    """AMASS was refused as lacking *joints*, and joints that are no SMPL's as if there were none."""
    np.savez(tmp_path / "a.npz", **arrays, fps=30)
    with pytest.raises(MotionError, match=f"a.npz': {message}"):
        read_joint_file(tmp_path / "a.npz")


def test_uneven_times_are_made_even(tmp_path):
    """Cameras have no steady rate: frames were taken as even, and what was fast became slow."""
    share = np.linspace(0, 1, 60)
    times = 2 * (share + 0.15 * np.sin(np.pi * share))
    path = np.zeros((60, 22, 3))
    path[..., 0] = times[:, None] + np.arange(22)
    np.savez(tmp_path / "a.npz", joints=path, timestamps=times)
    mocap = read_joint_file(tmp_path / "a.npz")
    assert mocap.fps == pytest.approx(59 / 2)
    np.testing.assert_allclose(np.diff(mocap.positions[..., 0], axis=0), 2 / 59, atol=1e-6)
    assert any("resampled to even ones" in note for note in mocap.notes)
    np.savez(tmp_path / "a.npz", joints=path, timestamps=np.linspace(0, 2, 60))
    assert (read_joint_file(tmp_path / "a.npz").positions == path).all()
    np.savez(tmp_path / "a.npz", joints=path, timestamps=times)
    assert (read_joint_file(tmp_path / "a.npz", fps=30).positions == path).all()
