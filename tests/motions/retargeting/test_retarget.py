import importlib
import re

import numpy as np
import pytest

from plat.errors import MotionError
from plat.motions.retargeting import bvh_paths, read_bvh, retarget, retarget_all
from plat.robots import G1

from .human import write_human

CLIPS = ["dataset-1_bow_active_001", "dataset-1_walk_normal_001", "dataset-2_wave-both-hands_normal_001"]


def test_a_human_of_lafan1(tmp_path):
    turns = {"RightArm": (0, 70, 0), "LeftForeArm": (60, 0, 0), "Hips": (0, 0, 30)}
    result = retarget(write_human(tmp_path / "turn.bvh", turns=turns))
    clip = result.clip
    assert (clip.name, clip.fps, clip.qpos.shape) == ("turn", 30.0, (30, 36))
    assert clip.qpos[0, 2] == pytest.approx(0.78, abs=0.02)
    assert result.error < 0.01
    assert result.penetration < 1e-4
    assert result.floating < 2e-3
    assert result.slip < 5e-3


@pytest.mark.parametrize("name", CLIPS)
def test_humans_of_bandai_namco(shared_data, name):
    result = retarget(shared_data / "formats" / "bvh" / f"{name}.bvh")
    assert result.error < 0.01
    assert result.penetration < 1e-4
    assert result.floating < 3e-3
    assert result.slip < 5e-3
    joints = result.clip.qpos[:, 7:]
    low, high = G1.joint_range.numpy().T
    assert ((joints >= low - 1e-5) & (joints <= high + 1e-5)).all()
    assert abs(np.diff(joints, axis=0)).max() * 30.0 < 15.01


@pytest.mark.parametrize("name", CLIPS[:2])
def test_the_result_is_near_that_of_others(shared_data, name):
    with np.load(shared_data / "motions" / "bandai_train.npz") as archive:
        reference = archive[name]
    qpos = retarget(shared_data / "formats" / "bvh" / f"{name}.bvh").clip.qpos
    assert abs(qpos[:, 7:] - reference[:, 7:]).mean() < 0.08
    np.testing.assert_allclose(abs((qpos[:, 3:7] * reference[:, 3:7]).sum(1)), 1, atol=0.01)
    path, expected = qpos[:, :2] - qpos[0, :2], reference[:, :2] - reference[0, :2]
    np.testing.assert_allclose(path, expected, atol=0.15)


def test_many_files_in_processes_are_as_in_one(tmp_path, monkeypatch):
    # the package's function of that name hides the module from a plain import
    module = importlib.import_module("plat.motions.retargeting.retarget")
    monkeypatch.setattr(module, "_FILES_PER_WORKER", 1)
    paths = [write_human(tmp_path / f"{name}.bvh", frames=3) for name in "ab"]
    paths.append(tmp_path / "broken.bvh")
    paths[-1].write_text("HIERARCHY\n")
    alone, spread = list(retarget_all(paths)), list(retarget_all(paths, workers=2))
    assert str(alone[2]) == str(spread[2])
    assert "broken.bvh': ends where the rest of the hierarchy" in str(alone[2])
    for one, other in zip(alone[:2], spread[:2], strict=True):
        np.testing.assert_array_equal(one.clip.qpos, other.clip.qpos)


def test_a_single_frame_is_refused(tmp_path):
    path = write_human(tmp_path / "a.bvh", frames=2)
    lines = path.read_text().replace("Frames: 2", "Frames: 1").splitlines()
    path.write_text("\n".join(lines[:-1]))
    with pytest.raises(MotionError, match=r"a.bvh': 1 frame, expected at least 2"):
        retarget(path)


def test_folders_globs_and_names(tmp_path):
    (tmp_path / "deep").mkdir()
    for name in ("b.bvh", "deep/c.bvh", "d.txt"):
        (tmp_path / name).touch()
    assert [path.name for path in bvh_paths([tmp_path])] == ["b.bvh", "c.bvh"]
    assert bvh_paths([tmp_path / "*.bvh", tmp_path / "b.bvh"]) == [tmp_path / "b.bvh"]
    with pytest.raises(MotionError, match=r"'nowhere/\*.bvh': no such file, folder"):
        bvh_paths(["nowhere/*.bvh"])
    with pytest.raises(MotionError, match="motion capture files: none given"):
        bvh_paths([])
    # of archives in folders, those of robots are left out
    np.savez(tmp_path / "robot.npz", qpos=np.zeros((3, 36)), fps=30)
    with pytest.raises(MotionError, match=r"none of 1 found, such as '.*robot.npz', holds a human's motion"):
        bvh_paths([tmp_path / "*.npz"])
    np.savez(tmp_path / "people.npz", posed_joints=np.zeros((3, 30, 3)))
    assert [path.name for path in bvh_paths([tmp_path])] == ["b.bvh", "c.bvh", "people.npz"]


def joints_file(path, frames=5, **stated):
    """Joint positions of a human, by name."""
    mocap = read_bvh(write_human(path.with_suffix(".bvh"), frames=5))
    path.with_suffix(".bvh").unlink()
    np.savez(path, joints=mocap.positions[:frames], joint_names=list(mocap.names), **stated)
    return path


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        ({"fps": 0}, "it states 0 frames a second, expected 8 to 1000; state it: plat motions convert --fps"),
        ({"dt": 0.0}, "'dt' is 0, expected a positive time"),
        ({"fps": 30, "frames": 0}, "0 frames, expected at least 2"),
    ],
)
def test_a_capture_that_cannot_be_used_does_not_end_the_others(tmp_path, stated, message):
    paths = [joints_file(tmp_path / "a.npz", **stated), write_human(tmp_path / "b.bvh", frames=5)]
    bad, good = retarget_all(paths)
    assert isinstance(bad, MotionError)
    assert re.fullmatch(rf"NPZ file '.*a.npz': {message}.*", str(bad))
    assert good.clip.name == "b"


def test_whatever_goes_wrong_in_a_file_does_not_end_the_others(tmp_path, monkeypatch):
    module = importlib.import_module("plat.motions.retargeting.retarget")
    paths = [write_human(tmp_path / f"{name}.bvh", frames=5) for name in "ab"]

    def odd(*_):
        monkeypatch.undo()
        raise ZeroDivisionError("by zero")

    monkeypatch.setattr(module, "read_human", odd)
    bad, good = retarget_all(paths)
    assert str(bad).endswith("a.bvh': cannot be retargeted (ZeroDivisionError: by zero)")
    assert good.clip.name == "b"


def test_captures_that_are_not_there_are_named(tmp_path):
    pointer = "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n"
    for name in ("a.bvh", "b.npz", "c.amc"):
        (tmp_path / name).write_text(pointer)
    write_human(tmp_path / "d.bvh", frames=5)
    paths = bvh_paths([tmp_path])
    *bad, good = retarget_all(paths)
    assert [path.name for path in paths] == ["a.bvh", "b.npz", "c.amc", "d.bvh"]
    assert all(re.search(r"file '.*': a Git LFS pointer .* run 'git lfs pull'", str(error)) for error in bad)
    assert good.clip.name == "d"
    (tmp_path / "c.asf").write_text(pointer)
    (tmp_path / "c.amc").write_text(":DEGREES\n1\nroot 0 0 0 0 0 0\n")
    with pytest.raises(MotionError, match=r"ASF file '.*c.asf': a Git LFS pointer"):
        retarget(tmp_path / "c.amc")
    with pytest.raises(MotionError, match=r"FBX file 'a.fbx': not a motion capture file, expected one of .bvh"):
        retarget("a.fbx")


def test_the_rate_in_a_name_is_compared(tmp_path):
    result = retarget(write_human(tmp_path / "a_60fps.bvh", frames=5))
    assert result.clip.fps == 30
    assert "30 fps as it states, though the file name says 60 (else: plat motions convert --fps)" in result.clip.notes
    assert not any("though" in note for note in retarget(write_human(tmp_path / "a_30fps.bvh", frames=5)).clip.notes)
    assert "fps from the file name" in retarget(joints_file(tmp_path / "b_60fps.npz")).clip.notes


def test_a_clip_may_begin_with_the_arms_up(tmp_path):
    # seen from the default pose, raised arms lie behind poses with the shoulders turned inside out
    up = {"LeftArm": (0, 150, 0), "RightArm": (0, -150, 0)}
    path = write_human(tmp_path / "a.bvh", turns=up, frames=61)
    lines = path.read_text().splitlines()
    first = len(lines) - 61
    lines[first:] = lines[first + 30 :]
    path.write_text("\n".join(lines).replace("Frames: 61", "Frames: 31"))
    assert retarget(path).error < 0.013
