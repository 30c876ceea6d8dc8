from dataclasses import replace

import numpy as np
import pytest
import torch

from plat.errors import MotionError
from plat.motions import (
    MotionClip,
    clip_to_limits,
    ground_feet,
    level_feet,
    load_motions,
    smooth_steps,
    trim_motion,
    validate_motion,
    validate_motions,
)
from plat.motions.checks.feet import Soles
from plat.robots import G1
from tests.motions.formats.writers import bowing_clip


def lifted(height) -> MotionClip:
    clip = bowing_clip(100)
    clip.qpos[:, 2] += height
    return clip


@pytest.mark.parametrize("how", ["clip", "smooth"])
@pytest.mark.parametrize("height", [0.14, -0.08])
def test_feet_come_to_the_floor(how, height):
    grounded = ground_feet(lifted(height), how)
    np.testing.assert_allclose(grounded.qpos, ground_feet(bowing_clip(100), how).qpos, atol=2e-3)
    report = validate_motion(grounded)
    assert abs(report.floating) < 0.005
    assert report.penetration < 0.01
    assert validate_motion(lifted(height)).verdict == "repair"
    assert report.verdict == "use"


def test_a_floor_that_drifts_is_followed():
    drift = np.linspace(0.02, 0.12, 100)
    whole, smooth = ground_feet(lifted(drift), "clip"), ground_feet(lifted(drift), "smooth")
    low = [Soles(G1).points(torch.from_numpy(clip.qpos))[..., 2].amin((-1, -2)).numpy() for clip in (whole, smooth)]
    assert np.abs(low[0]).max() > 0.04
    assert np.abs(low[1][10:-10]).max() < 0.015


def test_feet_that_dip_between_rests_do_not_make_the_rests_float():
    clip = lifted(0.0)
    plain = validate_motion(clip)
    for start in range(5, 95, 15):  # the whole body sinks by 3 cm for 0.08 s, three times a second
        clip.qpos[start : start + 4, 2] -= 0.03
    before, after = validate_motion(clip), validate_motion(ground_feet(clip, "smooth"))
    assert before.verdict == after.verdict == "use"
    assert plain.floating < after.floating + 0.01 < 0.025
    assert after.penetration < before.penetration


def test_a_walk_whose_toes_dip_stays_fit_for_use(shared_data):
    (clip,) = load_motions(shared_data / "formats" / "kimodo_walk_wxyz_30fps.csv")
    clip = smooth_steps(clip).clip  # one ankle steps at 15 rad/s
    before, after = validate_motion(clip), validate_motion(ground_feet(clip, "smooth"))
    assert before.verdict == after.verdict == "use"
    assert after.floating < 0.012
    assert after.penetration < before.penetration - 0.008


def test_a_jump_stays_a_jump():
    flight = np.arange(0, 0.5, 0.02)
    hop = np.zeros(150)
    hop[60 : 60 + len(flight)] = flight * (0.5 - flight) * 9.81 / 2
    clip = bowing_clip(150)
    clip.qpos[:] = clip.qpos[:1]
    clip.qpos[:, 2] += hop + 0.1
    grounded = ground_feet(clip, "smooth")
    height = grounded.qpos[:, 2] - grounded.qpos[0, 2]
    assert height.max() == pytest.approx(hop.max(), abs=0.02)
    assert validate_motion(grounded).penetration < 0.005


def sole_tilt(clip: MotionClip) -> np.ndarray:
    """How far the highest point of each sole is above its lowest ``[T, 2]`` (m)."""
    heights = Soles(G1).points(torch.from_numpy(clip.qpos))[..., 2]
    return (heights.amax(-1) - heights.amin(-1)).numpy()


def test_feet_on_other_ankles_are_refused():
    welded = replace(G1, name="other", feet=("left_knee_link", "right_knee_link"))
    with pytest.raises(MotionError, match="'left_knee_link' is not the body of a roll joint"):
        level_feet(bowing_clip(), welded)


def test_standing_feet_are_levelled_and_nothing_else_moves():
    clip = bowing_clip(100)
    ankles = [
        7 + G1.joint_names.index(f"{side}_ankle_{axis}") for side in ("left", "right") for axis in ("pitch", "roll")
    ]
    tilted = MotionClip(clip.name, clip.qpos.copy(), clip.fps)
    tilted.qpos[:, ankles] += [0.3, 0.1, -0.2, -0.1]
    assert sole_tilt(tilted).min() > 0.03
    levelled = level_feet(tilted)
    assert sole_tilt(levelled).max() < 1e-6
    others = [column for column in range(36) if column not in ankles]
    np.testing.assert_array_equal(levelled.qpos[:, others], tilted.qpos[:, others])
    low, high = G1.joint_range.numpy().T
    assert ((levelled.qpos[:, 7:] >= low) & (levelled.qpos[:, 7:] <= high)).all()


def test_a_foot_in_the_air_keeps_its_ankle():
    clip = bowing_clip(100)
    clip.qpos[:] = clip.qpos[:1]
    knee, ankle = (7 + G1.joint_names.index(f"left_{joint}") for joint in ("knee", "ankle_pitch"))
    clip.qpos[30:70, knee] += 1.2  # the foot is lifted by some 15 cm
    clip.qpos[:, ankle] += 0.3
    levelled = level_feet(clip)
    np.testing.assert_array_equal(levelled.qpos[37:63, ankle], clip.qpos[37:63, ankle])
    assert sole_tilt(levelled)[:20, 0].max() < 1e-6


def test_the_robot_is_compiled_once_for_all_clips(monkeypatch):
    robot, compiled, compile_model = replace(G1), [], type(G1).model
    monkeypatch.setattr(type(G1), "model", lambda *args: compiled.append(args) or compile_model(*args))
    for _ in range(3):
        ground_feet(bowing_clip(), robot=robot)
    assert len(compiled) == 1


def test_joint_limits_are_kept():
    clip = bowing_clip()
    clip.qpos[:, 7:] *= 10
    low, high = G1.joint_range.numpy().T
    clipped = clip_to_limits(clip)
    assert ((clipped.qpos[:, 7:] >= low) & (clipped.qpos[:, 7:] <= high)).all()
    assert (clipped.qpos[:, :7] == clip.qpos[:, :7]).all()
    inside = (clip.qpos[:, 7:] > low) & (clip.qpos[:, 7:] < high)
    assert (clipped.qpos[:, 7:] == clip.qpos[:, 7:])[inside].all()


def test_trim():
    clip = bowing_clip(100)
    np.testing.assert_array_equal(trim_motion(clip, 0.2, 0.5).qpos, clip.qpos[10:75])
    assert len(trim_motion(clip).qpos) == 100
    with pytest.raises(MotionError, match="motion 'bow': 1.98 s cannot lose 1 s at the start and 1 s at the end"):
        trim_motion(clip, 1, 1)
    with pytest.raises(MotionError, match="cannot lose -1"):
        trim_motion(clip, -1)


def test_real_motions_that_float(shared_data):
    clips = load_motions(shared_data / "motions" / "asap_train.npz")
    before = validate_motions(clips)
    after = validate_motions([ground_feet(clip, "smooth") for clip in clips])
    assert max(report.floating for report in before) > 0.14
    assert max(abs(report.floating) for report in after) < 0.01
    assert max(report.penetration for report in after) < 0.005
