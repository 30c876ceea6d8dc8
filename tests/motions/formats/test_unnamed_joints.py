import pickle

import numpy as np
import pytest

from plat.errors import MotionError
from plat.motions import load_motions, read_motion_files
from plat.motions.formats.joint_orders import usual_orders, with_sides_exchanged
from plat.motions.formats.unnamed_joints import unnamed_joints
from plat.robots import G1
from tests.motions.formats.test_layouts import clip_with_arms
from tests.motions.formats.writers import WITHOUT_WRISTS, bowing_clip

JOINTS = bowing_clip().qpos[:, 7:].astype(np.float64)
CUT = [name for name in G1.joint_names if "wrist" not in name]
SMALL = [
    name
    for name in G1.joint_names
    if ("wrist" not in name or name.endswith("roll")) and name not in ("waist_roll", "waist_pitch")
]


def columns(names: list[str], poses: np.ndarray = JOINTS) -> np.ndarray:
    return poses[:, [G1.joint_names.index(name) for name in names]]


def test_all_joints_are_in_the_robots_order():
    assert unnamed_joints(JOINTS, G1, "joints") == list(G1.joint_names)


def test_23_joints_are_of_either_robot():
    assert len(CUT) == len(SMALL) == 23
    assert unnamed_joints(columns(CUT), G1, "joints") == CUT == [G1.joint_names[index] for index in WITHOUT_WRISTS]
    assert unnamed_joints(columns(SMALL), G1, "joints") == SMALL


@pytest.mark.parametrize("kind", [CUT, SMALL], ids=["without wrists", "smaller G1"])
@pytest.mark.parametrize("label", ["breadth first", "in alphabetical order", "with arms, then legs, then waist"])
def test_23_joints_in_another_order_are_told_from_the_poses(tmp_path, kind, label):
    """They were read in the robot's order, and some were called use."""
    poses = clip_with_arms(0.7).qpos.astype(np.float64)
    order = [name for name in usual_orders(G1)[label] if name in kind]
    joints = columns(order, poses[:, 7:])
    assert unnamed_joints(joints, G1, "joints") == order
    assert unnamed_joints(np.rad2deg(joints), G1, "joints") == order
    rows = np.concatenate((poses[:, :7], joints), 1)
    np.savez(tmp_path / "a.npz", qpos=rows, fps=50)
    np.savetxt(tmp_path / "b_50fps.csv", rows, delimiter=",")
    (tmp_path / "c.pkl").write_bytes(pickle.dumps({"qpos": rows, "fps": 50}))
    for name in ("a.npz", "b_50fps.csv", "c.pkl"):
        (file,) = read_motion_files(tmp_path / name)
        np.testing.assert_allclose(columns(kind, file.clips[0].qpos[:, 7:]), columns(kind, poses[:, 7:]), atol=1e-6)
        assert "joints in another order than the robot's: only so are its poses likely" in file.facts
        assert "reordered by name" not in file.facts


def test_another_number_is_refused():
    with pytest.raises(MotionError, match="'joints' has 25 joints, expected the 29 joints of 'g1', or 23 without"):
        unnamed_joints(JOINTS[:, :25], G1, "joints")


def test_poses_that_tell_nothing_are_refused():
    refused = 0
    for share in np.linspace(0, 1, 30):  # from one robot's columns to the other's
        mixed = (1 - share) * columns(CUT) + share * columns(SMALL)
        try:
            unnamed_joints(mixed, G1, "joints")
        except MotionError as error:
            refused += "Both are plausible; name them" in str(error)
    assert 0 < refused < 28


def test_real_motions_of_both_robots(shared_data):
    clips = load_motions(shared_data / "motions" / "bandai_val.npz")
    wrong = refused = 0
    for clip in clips:
        for names in (CUT, SMALL):
            try:
                wrong += unnamed_joints(columns(names, clip.qpos[:, 7:].astype(np.float64)), G1, "joints") != names
            except MotionError:
                refused += 1
    assert wrong == 0
    assert refused < 0.12 * 2 * len(clips)


def test_degrees_tell_what_radians_tell(shared_data):
    """In degrees, raised arms were the smaller G1's."""
    for clip in load_motions(shared_data / "motions" / "bandai_val.npz")[::8]:
        for names in (CUT, SMALL):
            radians = columns(names, clip.qpos[:, 7:].astype(np.float64))
            assert told(np.rad2deg(radians)) == told(radians)


@pytest.mark.parametrize("kind", [CUT, SMALL], ids=["without wrists", "smaller G1"])
@pytest.mark.parametrize("label", ["", "breadth first"])
def test_23_joints_with_the_right_side_first(tmp_path, kind, label):
    """Left and right were exchanged."""
    poses = clip_with_arms(0.7).qpos.astype(np.float64)
    order = with_sides_exchanged([name for name in usual_orders(G1).get(label, G1.joint_names) if name in kind])
    rows = np.concatenate((poses[:, :7], columns(order, poses[:, 7:])), 1)
    np.savetxt(tmp_path / "a_50fps.csv", rows, delimiter=",")
    (file,) = read_motion_files(tmp_path / "a_50fps.csv")
    np.testing.assert_allclose(columns(kind, file.clips[0].qpos[:, 7:]), columns(kind, poses[:, 7:]), atol=1e-6)
    assert "joints in another order than the robot's" in file.facts


def test_23_joints_some_of_which_are_on_the_other_side_are_refused(tmp_path):
    poses = clip_with_arms(0.7).qpos.astype(np.float64)
    poses[:, [7 + G1.joint_names.index(f"{side}_hip_roll") for side in ("left", "right")]] *= 2
    legs = [name for name in with_sides_exchanged(CUT) if any(part in name for part in ("hip", "knee", "ankle"))]
    rows = np.concatenate((poses[:, :7], columns([*legs, *CUT[12:]], poses[:, 7:])), 1)
    (tmp_path / "a.pkl").write_bytes(pickle.dumps({"qpos": rows, "fps": 50}))
    with pytest.raises(MotionError, match="its legs have left and right exchanged and its arms do not"):
        read_motion_files(tmp_path / "a.pkl")


@pytest.mark.parametrize("kind", [CUT, SMALL], ids=["without wrists", "smaller G1"])
def test_a_broken_frame_makes_no_degrees_of_23_joints(kind):
    joints = columns(kind).copy()
    joints[20] = 50.0
    assert unnamed_joints(joints, G1, "joints") == kind


def told(joints: np.ndarray) -> list[str] | None:
    try:
        return unnamed_joints(joints, G1, "joints")
    except MotionError:
        return None
