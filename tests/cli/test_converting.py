"""``plat motions convert`` and ``mirror``."""

from dataclasses import replace

import numpy as np
import pytest

from plat.errors import MotionError, PlatError
from plat.motions import (
    MotionClip,
    ground_feet,
    level_feet,
    load_motions,
    mirror_motion,
    save_motions,
)
from plat.robots import G1
from tests.cli.motion_commands import run
from tests.motions.formats.writers import bowing_clip, write_asap, write_csv, write_gmr


def jumping_clip() -> MotionClip:
    """Two bows of which the second begins elsewhere."""
    first, second = bowing_clip(60).qpos, bowing_clip(60).qpos.copy()
    second[:, :2] += 0.5
    return MotionClip("jumping", np.concatenate((first, second)), 50.0)


def test_convert_to_one_file_with_repairs(folder, tmp_path, capsys):
    out = tmp_path / "all.npz"
    run("convert", folder, "--out", out, "--ground", "clip", "--trim", 0.2, 0.1, "--drop-bad")
    clips = {clip.name: clip for clip in load_motions(out)}
    assert sorted(clips) == ["floating", "good"]
    assert len(clips["good"].qpos) == 60 - 10 - 5
    np.testing.assert_allclose(clips["floating"].qpos, clips["good"].qpos, atol=1e-5)
    told = f"left out short of {folder / 'two.npz'}: 0.000 s long after --trim, expected at least 0.5 s"
    assert told in capsys.readouterr().out


def test_ends_are_taken_off_clips_and_not_off_pieces_of_them(tmp_path):
    qpos = bowing_clip(120).qpos.copy()
    qpos[60:, 0] += 2
    save_motions(tmp_path / "a.npz", MotionClip("a", qpos, 50.0))
    run("convert", tmp_path / "a.npz", "--trim", 0.4, 0.2, "--cut", "--out", tmp_path / "b.npz")
    assert [(clip.name, len(clip.qpos)) for clip in load_motions(tmp_path / "b.npz")] == [("a_c0", 40), ("a_c1", 50)]


def test_convert_levels_feet_before_it_grounds_them(tmp_path):
    clip = bowing_clip()
    clip.qpos[:, [7 + G1.joint_names.index(f"{side}_ankle_pitch") for side in ("left", "right")]] += 0.4
    save_motions(tmp_path / "tilted.npz", [clip])
    run("convert", tmp_path / "tilted.npz", "--out", tmp_path / "out.npz", "--level-feet", "--ground", "clip")
    (levelled,) = load_motions(tmp_path / "out.npz")
    np.testing.assert_allclose(levelled.qpos, ground_feet(level_feet(clip)).qpos, atol=1e-5)
    assert abs(levelled.qpos[:, 2] - ground_feet(clip).qpos[:, 2]).min() > 0.01


def test_convert_to_folders(folder, tmp_path):
    (folder / "again").mkdir()
    write_gmr(folder / "again" / "two.pkl", bowing_clip())
    run("convert", folder, "--out", tmp_path / "npz")
    assert sorted(path.name for path in (tmp_path / "npz").iterdir()) == ["good_50fps.npz", "two.npz", "two_2.npz"]
    run("convert", folder, "--out", tmp_path / "csv", "--format", "csv")
    files = sorted(path.name for path in (tmp_path / "csv").iterdir())
    assert files == ["floating_50fps.csv", "good_50fps.csv", "short_50fps.csv", "two_50fps.csv"]
    np.testing.assert_allclose(load_motions(tmp_path / "csv" / "two_50fps.csv")[0].qpos, bowing_clip().qpos, atol=1e-5)


def test_convert_with_what_the_user_states(tmp_path):
    standing = MotionClip("standing", np.tile(G1.default_qpos, (60, 1)), 30.0)
    write_csv(tmp_path / "standing.csv", standing, "xyzw")
    arguments = ["convert", tmp_path / "standing.csv", "--out", tmp_path / "x.npz"]
    with pytest.raises(MotionError, match="--quat-order"):
        run(*arguments)
    run(*arguments, "--quat-order", "xyzw", "--fps", 60, "--resample", 20)
    (clip,) = load_motions(tmp_path / "x.npz")
    assert (clip.fps, len(clip.qpos)) == (20.0, 20)
    np.testing.assert_allclose(clip.qpos, standing.qpos[:20], atol=1e-5)


def test_what_is_to_be_dropped_is_dropped(tmp_path, capsys):
    slipping = bowing_clip(60)
    slipping.qpos[:, 0] += np.arange(60) / 50 * 2
    clips = [bowing_clip(60), MotionClip("slipping", slipping.qpos, 50.0)]
    save_motions(tmp_path / "a.npz", clips)
    run("convert", tmp_path / "a.npz", "--out", tmp_path / "b.npz", "--drop-bad")
    assert [clip.name for clip in load_motions(tmp_path / "b.npz")] == ["bow"]
    text = capsys.readouterr().out
    assert "dropped slipping: feet slip at 2.0 m/s" in text
    assert "wrote 1 clip, 1 s, to" in text


def test_clip_limits(tmp_path):
    clip = bowing_clip()
    clip.qpos[:, 10] = -0.3
    save_motions(tmp_path / "a.npz", [clip])
    run("convert", tmp_path / "a.npz", "--out", tmp_path / "b.npz", "--clip-limits")
    assert load_motions(tmp_path / "b.npz")[0].qpos[0, 10] == pytest.approx(float(G1.joint_range[3, 0]))


def test_mirror(tmp_path):
    write_asap(tmp_path / "a.pkl", bowing_clip())
    run("mirror", tmp_path / "a.pkl", "--out", tmp_path / "b.npz")
    mirrored = load_motions(tmp_path / "b.npz")
    assert [clip.name for clip in mirrored] == ["first_mirrored", "second_mirrored"]
    np.testing.assert_array_equal(mirrored[0].qpos, mirror_motion(load_motions(tmp_path / "a.pkl")[0]).qpos)


def test_a_clip_that_is_shorter_than_a_frame_does_not_lose_the_others(tmp_path, capsys):
    save_motions(tmp_path / "good.npz", MotionClip("good", bowing_clip(60).qpos, 30.0))
    save_motions(tmp_path / "short.npz", MotionClip("little", bowing_clip(6).qpos, 50.0))
    with pytest.raises(MotionError, match="^1 clip was too short; see above$"):
        run("convert", tmp_path, "--resample", 5, "--out", tmp_path / "all" / "all.npz")
    assert [clip.name for clip in load_motions(tmp_path / "all" / "all.npz")] == ["good"]
    told = f"left out little of {tmp_path / 'short.npz'}: 0.100 s long, expected at least 0.2 s"
    assert told in capsys.readouterr().out


@pytest.mark.parametrize(
    ("command", "told"),
    [
        (["convert"], "0.008 s long, expected at least 0.02 s"),
        (["mirror"], "0.008 s long, expected at least 0.02 s"),
        (["convert", "--trim", "0.3", "0.3"], "0.000 s long after --trim, expected at least 0.02 s"),
    ],
)
def test_a_clip_that_is_shorter_than_any_command_does_not_lose_the_others(command, told, tmp_path, capsys):
    good, short = tmp_path / "good.npz", tmp_path / "short.npz"
    save_motions(good, MotionClip("good", bowing_clip(60).qpos, 50.0))
    save_motions(short, MotionClip("little", bowing_clip(2).qpos, 120.0))
    with pytest.raises(MotionError, match="^1 clip was too short; see above$"):
        run(*command, short, good, "--out", tmp_path / "all.npz")
    assert [clip.name[:4] for clip in load_motions(tmp_path / "all.npz")] == ["good"]
    assert f"left out little of {short}: {told}" in capsys.readouterr().out
    with pytest.raises(PlatError, match="no clips are left"):
        run(*command, short, "--out", tmp_path / "none.npz")
    assert f"left out little of {short}: {told}" in capsys.readouterr().out
    assert not (tmp_path / "none.npz").exists()


def test_single_frame_steps_are_smoothed(tmp_path, capsys):
    clip = bowing_clip(60)
    clip.qpos[30:, 7 + G1.joint_names.index("left_ankle_roll")] += 0.25
    save_motions(tmp_path / "a.npz", [clip])
    (report,) = run("inspect", tmp_path / "a.npz")
    assert report.verdict == "repair"
    run("convert", tmp_path / "a.npz", "--out", tmp_path / "b.npz", "--smooth-steps")
    assert "smoothed 1 single-frame step of bow: joints changed by 0.1" in capsys.readouterr().out
    (report,) = run("inspect", tmp_path / "b.npz")
    assert report.verdict == "use"


def test_repair_does_what_is_needed_and_tells_both_verdicts(folder, tmp_path, capsys):
    run("convert", folder, "--out", tmp_path / "all.npz", "--repair")
    text = capsys.readouterr().out
    assert "floating: repair (feet float at 10.0 cm) -> use: feet put on the floor" in text
    assert "short: drop (0.18 s long) -> drop (0.18 s long): nothing that could be repaired" in text
    assert "before: 1 use, 1 repair, 1 drop" in text
    assert "after: 2 use, 0 repair, 1 drop" in text
    clips = {clip.name: clip for clip in load_motions(tmp_path / "all.npz")}
    np.testing.assert_array_equal(clips["good"].qpos, load_motions(folder / "good_50fps.csv")[0].qpos)
    np.testing.assert_allclose(clips["floating"].qpos, clips["good"].qpos, atol=1e-3)


def test_repair_brings_mixed_rates_to_that_of_most(tmp_path, capsys):
    write_csv(tmp_path / "a_50fps.csv", bowing_clip(60))
    write_csv(tmp_path / "b_25fps.csv", bowing_clip(31))
    write_csv(tmp_path / "c_50fps.csv", bowing_clip(61))
    run("convert", tmp_path, "--out", tmp_path / "all.npz", "--repair")
    assert {clip.fps for clip in load_motions(tmp_path / "all.npz")} == {50.0}
    assert "all resampled to 50 fps, the most common rate" in capsys.readouterr().out


def test_cut_makes_clips_of_what_stands_between_jumps(tmp_path, capsys):
    save_motions(tmp_path / "a.npz", [jumping_clip(), bowing_clip(60)])
    run("convert", tmp_path / "a.npz", "--out", tmp_path / "b.npz", "--cut", "--drop-bad")
    clips = {clip.name: clip for clip in load_motions(tmp_path / "b.npz")}
    assert sorted(clips) == ["bow", "jumping_c0", "jumping_c1"]
    np.testing.assert_allclose(clips["jumping_c0"].qpos, bowing_clip(60).qpos, atol=1e-5)
    assert "cut jumping, 2.4 s, into 2 clips of 1.2, 1.2 s" in capsys.readouterr().out


@pytest.mark.parametrize("command", ["inspect", "convert", "mirror"])
def test_a_broken_motion_does_not_lose_the_others_of_its_file(command, tmp_path, capsys):
    path, out = tmp_path / "a.npz", tmp_path / "out.npz"
    save_motions(path, [replace(bowing_clip(), name=name) for name in "ab"])
    arrays = dict(np.load(path))
    arrays["a"][0, 7] = np.nan
    np.savez(path, **arrays)
    with pytest.raises(MotionError, match="^1 motion of 1 file could not be used; see above"):
        run(command, path, *([] if command == "inspect" else ["--out", out]))
    assert "1 of 2 motions left out: motion 'a': qpos[0, 7] is nan" in capsys.readouterr().out
    if command != "inspect":
        assert len(load_motions(out)) == 1
