import io
import zipfile

import numpy as np
import pytest

from plat.errors import MotionError
from plat.motions import MotionClip, load_motions, read_motion_files
from plat.robots import G1
from tests.motions.formats.writers import ISAAC_ORDER, body_poses, bowing_clip, write_full_tracker, write_tracker


def test_joints_and_root_in_their_arrays(tmp_path):
    write_tracker(tmp_path / "bow.npz", bowing_clip(), ISAAC_ORDER)
    (file,) = read_motion_files(tmp_path / "bow.npz")
    np.testing.assert_allclose(file.clips[0].qpos, bowing_clip().qpos, atol=1e-6)
    assert file.clips[0].name == "bow"
    assert file.facts == "tracker npz, 50 fps, quaternion wxyz, joints reordered by name"


def test_joints_and_root_in_one_array(tmp_path):
    write_full_tracker(tmp_path / "bow.npz", bowing_clip())
    np.testing.assert_allclose(load_motions(tmp_path / "bow.npz")[0].qpos, bowing_clip().qpos, atol=1e-6)


@pytest.mark.parametrize(("order", "told"), [(None, "depth first"), (ISAAC_ORDER, "breadth first")])
def test_without_names_the_bodies_tell_the_order(tmp_path, order, told):
    write_tracker(tmp_path / "bow.npz", bowing_clip(), order, named=False)
    (file,) = read_motion_files(tmp_path / "bow.npz")
    np.testing.assert_allclose(file.clips[0].qpos, bowing_clip().qpos, atol=1e-6)
    assert f"the bodies fit joints numbered {told}" in file.facts


def test_an_order_that_nothing_tells_is_refused(tmp_path):
    backwards = list(G1.joint_names)[::-1]
    write_tracker(tmp_path / "a.npz", bowing_clip(), backwards, named=False)
    with pytest.raises(MotionError, match="no usual order of joints fits its 'body_pos_w'; add 'joint_names'"):
        load_motions(tmp_path / "a.npz")
    straight = np.tile(G1.default_qpos, (5, 1))
    straight[:, 7:] = 0
    write_tracker(tmp_path / "a.npz", MotionClip("straight", straight, 50.0), named=False)
    with pytest.raises(MotionError, match="more than one usual order"):
        load_motions(tmp_path / "a.npz")
    np.savez(tmp_path / "a.npz", fps=50, joint_pos=straight)
    with pytest.raises(MotionError, match="no array 'joint_names' and no 'body_pos_w'"):
        load_motions(tmp_path / "a.npz")


def test_the_root_is_found_by_name(tmp_path):
    clip = bowing_clip()
    pos, quat = body_poses(clip)
    arrays = {"fps": 50, "joint_pos": clip.qpos[:, 7:], "joint_names": G1.joint_names}
    world = np.zeros((len(pos), 1, 3)), np.tile([1.0, 0, 0, 0], (len(pos), 1, 1))
    arrays["body_pos_w"], arrays["body_quat_w"] = (
        np.concatenate(parts, 1) for parts in zip(world, (pos, quat), strict=True)
    )
    np.savez(tmp_path / "a.npz", **arrays, body_names=["world", *G1.keypoints])
    np.testing.assert_allclose(load_motions(tmp_path / "a.npz")[0].qpos, clip.qpos, atol=1e-6)
    np.savez(tmp_path / "a.npz", **arrays, body_names=["world", *["limb"] * 14])
    with pytest.raises(MotionError, match="'body_names' lacks 'pelvis'"):
        load_motions(tmp_path / "a.npz")


def test_a_clip_called_qpos_has_the_name_of_its_file(tmp_path):
    np.savez(tmp_path / "walk.npz", qpos=bowing_clip().qpos, fps=30)
    assert load_motions(tmp_path / "walk.npz")[0].name == "walk"


def test_wrists_may_be_missing(tmp_path):
    names = [name for name in G1.joint_names if "wrist" not in name]
    write_tracker(tmp_path / "a.npz", bowing_clip(), names)
    (clip,) = load_motions(tmp_path / "a.npz")
    wrists = [7 + index for index, name in enumerate(G1.joint_names) if "wrist" in name]
    assert (clip.qpos[:, wrists] == 0).all()
    assert (clip.qpos[:, 10:22] == bowing_clip().qpos[:, 10:22]).all()


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"joint_pos": np.zeros((5, 29))}, "array 'body_pos_w' has shape .*, expected .5, bodies, 3."),
        ({"joint_pos": np.zeros((5, 29)), "body_pos_w": np.zeros((4, 30, 3))}, "'body_pos_w' has shape .4, 30, 3."),
        ({"joint_pos": np.zeros(5)}, "'joint_pos' has shape"),
        ({"joint_pos": np.zeros((5, 36))}, "no array 'joint_names'"),
        ({"joint_pos": np.zeros((5, 36)), "joint_names": ["knee"] * 29}, "has the unknown .*knee"),
        ({"joint_pos": np.zeros((5, 36)), "joint_names": np.arange(29)}, "'joint_names' is not a list of names"),
        ({"joint_pos": np.zeros((5, 36)), "joint_names": G1.joint_names}, "quaternion of frame 0"),
    ],
)
def test_errors_name_file_and_field(tmp_path, arrays, message):
    np.savez(tmp_path / "bad.npz", fps=50, **arrays)
    with pytest.raises(MotionError, match=rf"bad.npz'.*{message}"):
        load_motions(tmp_path / "bad.npz")


def archive(path, content: bytes, compression: int = zipfile.ZIP_DEFLATED) -> None:
    with zipfile.ZipFile(path, "w", compression) as file:
        file.writestr("a.npy", content)


def array_bytes(value: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, value)
    return file.getvalue()


def test_bombs_are_refused(tmp_path, monkeypatch):
    path = tmp_path / "bomb.npz"
    monkeypatch.setattr("plat.motions.formats.decompress._GENEROUS", 1 << 20)
    archive(path, bytes(3 << 20))
    with pytest.raises(MotionError, match="unpacks to far more than its size"):
        load_motions(path)
    content = array_bytes(np.zeros((2, 36)))
    archive(path, content.replace(b"(2, 36), }      ", b"(2000000, 36), }"))
    with pytest.raises(MotionError, match=r"an array of shape .2000000, 36. does not have the bytes for it"):
        load_motions(path)
    archive(path, content, zipfile.ZIP_LZMA)
    with pytest.raises(MotionError, match="compressed in a way that NumPy does not use"):
        load_motions(path)
    # a directory that says less than there is
    archive(path, content + bytes(1 << 20))
    lying = path.read_bytes().replace(
        (len(content) + (1 << 20)).to_bytes(4, "little"), len(content).to_bytes(4, "little")
    )
    path.write_bytes(lying)
    with pytest.raises(MotionError, match="Bad CRC-32"):
        load_motions(path)
