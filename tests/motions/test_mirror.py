from dataclasses import replace

import numpy as np
import pytest
import torch

from plat.errors import RobotError
from plat.motions import MotionClip, load_motions, mirror_motion, validate_motion
from plat.robots import G1, ForwardKinematics
from tests.motions.formats.writers import bowing_clip


def random_clip() -> MotionClip:
    rng = np.random.default_rng(0)
    qpos = rng.normal(0, 0.5, (50, 36))
    qpos[:, 3:7] /= np.linalg.norm(qpos[:, 3:7], axis=1, keepdims=True)
    return MotionClip("random", qpos, 30.0)


def keypoints(clip: MotionClip) -> np.ndarray:
    return ForwardKinematics(G1)(*torch.from_numpy(clip.qpos).double().split((3, 4, 29), -1))[0].numpy()


def test_the_mirror_image_of_the_mirror_image_is_the_clip():
    clip = random_clip()
    twice = mirror_motion(mirror_motion(clip))
    np.testing.assert_array_equal(twice.qpos, clip.qpos)
    assert (twice.name, twice.fps) == (clip.name, clip.fps)
    assert mirror_motion(clip).name == "random_mirrored"


def is_mirror_image(clip: MotionClip) -> None:
    other = {"left": "right", "right": "left"}
    partner = [G1.keypoints.index("_".join(other.get(word, word) for word in name.split("_"))) for name in G1.keypoints]
    expected = keypoints(clip)[:, partner] * [1, -1, 1]
    # the G1's own shoulders are 0.01 mm apart from symmetric
    np.testing.assert_allclose(keypoints(mirror_motion(clip)), expected, atol=1.1e-5)


def test_keypoints_are_mirrored():
    is_mirror_image(random_clip())


def test_real_motions_are_mirrored(shared_data):
    for clip in load_motions(shared_data / "motions" / "pbhc_train.npz"):
        is_mirror_image(clip)


def test_a_mirrored_clip_is_as_good():
    clip = bowing_clip(heading=0.5)
    clip.qpos[:, 7 + G1.joint_names.index("left_elbow")] = 1.0
    report, mirrored = validate_motion(clip), validate_motion(mirror_motion(clip))
    assert mirrored.verdict == report.verdict
    assert mirrored.floating == pytest.approx(report.floating, abs=1e-5)
    assert mirrored.slip == pytest.approx(report.slip, abs=1e-3)


def test_the_robot_is_compiled_once_for_all_clips(monkeypatch):
    robot, compiled, compile_model = replace(G1), [], type(G1).model
    monkeypatch.setattr(type(G1), "model", lambda *args: compiled.append(args) or compile_model(*args))
    for _ in range(3):
        mirror_motion(random_clip(), robot)
    assert len(compiled) == 1


def test_a_robot_without_symmetry_is_refused(monkeypatch):
    lopsided = replace(G1, name="lopsided")
    model = G1.model()
    model.jnt_axis[1 + G1.joint_names.index("left_knee")] = [0, 0, 1]
    monkeypatch.setattr(type(lopsided), "model", lambda *_: model)
    with pytest.raises(RobotError, match="'lopsided': with all joints at 0, the axis of '(left|right)_knee' is not"):
        mirror_motion(random_clip(), lopsided)


def test_a_single_pose_has_a_mirror_image():
    qpos = G1.default_qpos[None].copy()
    qpos[0, 7 + G1.joint_names.index("left_knee")] = 0.9
    image = mirror_motion(MotionClip("pose", qpos, 1.0), G1).qpos[0]
    assert image[7 + G1.joint_names.index("right_knee")] == pytest.approx(0.9)
