import numpy as np
import pytest

from plat.errors import MotionError
from plat.motions import MotionClip, read_motion_files
from plat.robots import G1
from tests.motions.formats.writers import body_poses, bowing_clip

BACKWARDS = list(G1.joint_names)[::-1]


def arrays(clip: MotionClip | None = None, names: list[str] = BACKWARDS) -> dict[str, object]:
    """Arrays of a tracker with named bodies; joints stand in an order of nobody, called by these names."""
    clip = clip or bowing_clip(heading=0.7)
    pos, quat = body_poses(clip)
    bodies = {"body_pos_w": pos, "body_quat_w": quat, "body_names": G1.keypoints}
    return {"fps": 50, "joint_pos": clip.qpos[:, :6:-1], "joint_names": names, **bodies}


def read(path, arrays: dict[str, object], **options):
    np.savez(path, **arrays)
    (file,) = read_motion_files(path, **options)
    return file


def qpos_of(file) -> np.ndarray:
    return file.clips[0].qpos


def test_names_that_lead_elsewhere_than_the_bodies_are_refused(tmp_path):
    np.testing.assert_allclose(qpos_of(read(tmp_path / "a.npz", arrays())), bowing_clip(heading=0.7).qpos, atol=1e-5)
    exchanged = {"left_knee": "left_hip_pitch", "left_hip_pitch": "left_knee"}
    wrong = arrays(names=[exchanged.get(name, name) for name in BACKWARDS])
    told = r"a.npz': joints as named put 'left_\w+' 0.\d\d m from 'body_pos_w'; correct 'joint_names', or leave"
    with pytest.raises(MotionError, match=told):
        read(tmp_path / "a.npz", wrong)
    del wrong["body_names"]  # bodies that nothing names say less
    assert len(qpos_of(read(tmp_path / "a.npz", wrong)))


def test_links_of_another_description_are_said(tmp_path):
    other = arrays()
    other["body_pos_w"] = other["body_pos_w"] + 0.012 * np.random.default_rng(0).normal(size=(1, 14, 3))
    file = read(tmp_path / "a.npz", other)
    np.testing.assert_allclose(qpos_of(file)[:, 7:], bowing_clip().qpos[:, 7:], atol=1e-5)
    assert "joints as named put" in file.facts
    assert "the root puts" not in file.facts


def test_bodies_without_places_say_nothing(tmp_path):
    clip = bowing_clip(heading=0.7)
    broken = {**arrays(), "root_pos": clip.qpos[:, :3], "root_quat": clip.qpos[:, 3:7]}
    broken["body_pos_w"][:, 5] = np.nan
    file = read(tmp_path / "a.npz", broken)
    np.testing.assert_allclose(qpos_of(file), clip.qpos, atol=1e-5)
    assert "places in 'body_pos_w' that are none" in file.facts


def test_joints_that_a_file_lacks_are_no_wrong_names(tmp_path):
    clip, waist = bowing_clip(), BACKWARDS.index("waist_pitch")
    clip.qpos[:, -1 - waist] = 0.4
    cut = arrays(clip)
    cut["joint_pos"], cut["joint_names"] = np.delete(cut["joint_pos"], waist, 1), np.delete(BACKWARDS, waist)
    assert "joints as named put" in read(tmp_path / "a.npz", cut).facts


def test_a_root_beside_the_bodies_root_is_said(tmp_path):
    clip = bowing_clip(heading=0.7)
    root = {"root_pos": clip.qpos[:, :3] + [0, 0, 0.1], "root_quat": clip.qpos[:, 3:7]}
    file = read(tmp_path / "a.npz", {**arrays(), **root})
    np.testing.assert_allclose(qpos_of(file)[:, 7:], clip.qpos[:, 7:], atol=1e-5)
    assert "the root puts bodies 0.10 m from 'body_pos_w'" in file.facts


def test_a_stated_order_of_quaternions_overrides_the_bodies(tmp_path):
    file = read(tmp_path / "a.npz", arrays(), quat_order="xyzw")
    assert "quaternion xyzw, the root puts bodies" in file.facts


@pytest.mark.parametrize("named", [True, False])
def test_bodies_tell_the_order_of_joints_in_degrees(tmp_path, named):
    degrees = arrays()
    degrees["joint_pos"] = np.rad2deg(degrees["joint_pos"])
    if not named:
        degrees["joint_pos"] = degrees["joint_pos"][:, ::-1]
        del degrees["joint_names"]
    file = read(tmp_path / "a.npz", degrees)
    np.testing.assert_allclose(qpos_of(file), bowing_clip(heading=0.7).qpos, atol=1e-5)
    assert "joint angles in degrees" in file.facts
    assert "from 'body_pos_w'" not in file.facts


@pytest.mark.parametrize("named", [True, False])
@pytest.mark.parametrize(
    ("field", "at", "told"),
    [
        ("joint_pos", (20, 3), r"'joint_pos'\[20, 3\] is nan"),
        ("body_pos_w", (20, 0, 2), r"'body_pos_w\[:, 0\]'\[20, 2\] is nan"),
        ("body_quat_w", (20, 0, 1), r"'body_quat_w\[:, 0\]'\[20, 1\] is nan"),
    ],
)
def test_what_is_no_number_is_named(tmp_path, named, field, at, told):
    """It was said that no order of joints fits."""
    broken = arrays()
    broken[field] = np.array(broken[field])
    broken[field][at] = np.nan
    if not named:
        broken["joint_pos"] = broken["joint_pos"][:, ::-1]
        del broken["joint_names"]
    column = at[-1] if named or field != "joint_pos" else 28 - at[-1]
    with pytest.raises(MotionError, match=f"a.npz': {told.replace('3', str(column), 1) if 'joint' in field else told}"):
        read(tmp_path / "a.npz", broken)


def test_places_of_bodies_that_are_no_numbers_are_said_where_they_are_needed(tmp_path):
    broken = arrays()
    broken["joint_pos"] = broken["joint_pos"][:, ::-1]
    broken["body_pos_w"][:, 5] = np.nan
    del broken["joint_names"]
    with pytest.raises(
        MotionError, match="'body_pos_w' has places that are not finite, expected numbers, or 'joint_na"
    ):
        read(tmp_path / "a.npz", broken)


@pytest.mark.parametrize("named", [True, False])
def test_a_torso_before_the_root_is_no_root(tmp_path, named):
    clip = bowing_clip(heading=0.7)
    pos, quat = body_poses(clip)
    torso = G1.keypoints.index("torso_link")
    listed = [torso, *(n for n in range(len(G1.keypoints)) if n != torso)]
    names = {"joint_names": G1.joint_names} if named else {}
    file = read(
        tmp_path / "a.npz",
        {
            "fps": 50,
            "joint_pos": clip.qpos[:, 7:],
            "body_pos_w": pos[:, listed],
            "body_quat_w": quat[:, listed],
            **names,
        },
    )
    np.testing.assert_allclose(qpos_of(file), clip.qpos, atol=1e-5)
    assert "body 1 is the root: it leads to the others" in file.notes
