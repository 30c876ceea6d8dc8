import numpy as np
import pytest

from plat.errors import MotionError
from plat.motions.formats.unnamed_joints import unnamed_joints
from plat.robots import G1
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
    from plat.motions import load_motions

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
