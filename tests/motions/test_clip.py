import numpy as np
import pytest
import torch

from plat.errors import MotionError
from plat.motions import (
    MotionClip,
    MotionLibrary,
    load_motions,
    mirror_motion,
    save_csv,
    save_motions,
    validate_motions,
)
from plat.robots import G1


def good(frames: int = 5) -> np.ndarray:
    return np.tile(G1.default_qpos, (frames, 1))


def broken(**changes) -> MotionClip:
    qpos = good()
    for (row, column), value in changes.pop("cells", {}).items():
        qpos[row, column] = value
    return MotionClip("clip", changes.get("qpos", qpos), changes.get("fps", 30.0))


@pytest.mark.parametrize(
    ("clip", "message"),
    [
        (broken(qpos=good()[:, :35]), "35 columns, expected 36"),
        (broken(qpos=good()[0]), r"shape \(36,\)"),
        (broken(qpos=good().astype(str)), "expected numbers"),
        (broken(qpos=good(0)), "0 frames, expected at least 2"),
        (broken(qpos=good(1)), "1 frame, expected at least 2"),
        (broken(qpos=[[1, 2], [3]]), "qpos is .*, expected an array of numbers"),
        (MotionClip("clip", good(), 30.0, "stated"), "notes is 'stated', expected a tuple"),
        (broken(fps=0.0), "fps is 0.0"),
        (broken(fps="30"), "fps is '30', expected a positive number"),
        (broken(fps=True), "fps is True"),
        (broken(fps=float("nan")), "fps is nan"),
        (broken(fps=10**400), "fps is 1000.*000, expected a positive number"),
        (broken(cells={(2, 9): np.nan}), r"qpos\[2, 9\] is nan"),
        (broken(cells={(1, 0): np.inf}), r"qpos\[1, 0\] is inf"),
        (broken(cells={(3, 3): 0.5}), "quaternion of frame 3 .* has length 0.5, expected 1"),
    ],
)
def test_errors_name_clip_and_field(clip, message):
    with pytest.raises(MotionError, match=f"motion 'clip': .*{message}"):
        clip.checked(G1)


def test_a_name_is_a_text():
    with pytest.raises(MotionError, match="motion 3: its name is no text"):
        MotionClip(3, good(), 30.0).check(G1)


@pytest.mark.parametrize("make", [np.ndarray.tolist, torch.from_numpy, lambda qpos: tuple(map(tuple, qpos.tolist()))])
def test_what_is_no_array_becomes_one(make, tmp_path):
    clip = MotionClip("clip", make(good()), np.array(30.0), ["stated"])
    np.testing.assert_array_equal(clip.qpos, good())
    assert (clip.fps, clip.notes, clip.duration) == (30.0, ("stated",), 4 / 30)
    np.testing.assert_allclose(mirror_motion(mirror_motion(clip)).qpos, good())
    save_motions(tmp_path / "a.npz", [clip])
    np.testing.assert_allclose(load_motions(save_csv(tmp_path, clip))[0].qpos, good(), atol=1e-6)


def test_small_quaternion_errors_are_mended():
    qpos = good()
    qpos[:, 3:7] *= 1.005
    checked = MotionClip("clip", qpos, 30).checked(G1)
    np.testing.assert_allclose(np.linalg.norm(checked.qpos[:, 3:7], axis=1), 1, atol=1e-6)
    assert checked.qpos.dtype == np.float32


def test_duration_is_between_first_and_last_frame():
    assert MotionClip("clip", good(31), 30.0).duration == pytest.approx(1.0)


def test_a_clip_alone_is_a_list_of_one(tmp_path):
    clip = MotionClip("alone", good(31), 30.0)
    save_motions(tmp_path / "one.npz", clip)
    assert [found.name for found in load_motions(tmp_path / "one.npz")] == ["alone"]
    assert MotionLibrary.from_clips(clip).clip_names == ["alone"]
    assert [report.name for report in validate_motions(clip)] == ["alone"]
    assert MotionLibrary.from_clips(found for found in [clip, clip]).num_clips == 2


@pytest.mark.parametrize(("clips", "told"), [(["walk"], "'walk' among the clips"), (5, "5 in the place of clips")])
def test_what_are_no_clips_is_named(clips, told, tmp_path):
    for take in (MotionLibrary.from_clips, validate_motions, lambda clips: save_motions(tmp_path / "a.npz", clips)):
        with pytest.raises(MotionError, match=told):
            take(clips)


def test_no_clips_are_no_file_and_no_library(tmp_path):
    assert validate_motions([]) == []
    for take in (MotionLibrary.from_clips, lambda clips: save_motions(tmp_path / "a.npz", clips)):
        with pytest.raises(MotionError, match="no clips, expected at least one"):
            take([])
