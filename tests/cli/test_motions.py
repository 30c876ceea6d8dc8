import pickle
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import tyro

from plat.cli import main, motion_files, motions
from plat.cli.options import MotionsCommand
from plat.errors import MotionError, PlatError
from plat.figures import motion_sheet
from plat.motions import (
    MotionClip,
    MotionFile,
    ground_feet,
    level_feet,
    load_motions,
    mirror_motion,
    save_motions,
    validate_motion,
)
from plat.motions.retargeting.bvh import read_bvh
from plat.rendering import RenderingError
from plat.robots import G1
from tests.in_process import run_plat
from tests.motions.formats.writers import asap_motions, bowing_clip, write_asap, write_csv, write_gmr
from tests.motions.retargeting.human import write_human


@pytest.fixture
def folder(tmp_path) -> Path:
    """A good csv, and a plat npz with a clip that floats and one to drop."""
    folder = tmp_path / "in"
    folder.mkdir()
    write_csv(folder / "good_50fps.csv", bowing_clip(60))
    floating, short = bowing_clip(60), bowing_clip(10)
    floating.qpos[:, 2] += 0.1
    clips = [MotionClip("floating", floating.qpos, 50.0), MotionClip("short", short.qpos, 50.0)]
    save_motions(folder / "two.npz", clips)
    return folder


def run(*arguments: object):
    return motions.main(tyro.cli(MotionsCommand, args=[str(argument) for argument in arguments]))


def test_inspect_prints_a_row_a_clip(folder, capsys):
    run("inspect", folder)
    lines = capsys.readouterr().out.splitlines()
    assert "good_50fps.csv: 1 clip, csv, 50 fps, quaternion wxyz detected, fps from the file name" in lines[0]
    assert "two.npz: 2 clips, plat npz, 50 fps" in lines[1]
    table = lines[lines.index("") + 1 :]
    rows = {line.split()[0]: line for line in table}
    # nobody walks or jumps in it: that the name is right about the rate nothing shows
    told = "50 fps, quaternion wxyz detected, fps from the file name, nothing in the motion confirms this rate"
    assert rows["good"].endswith(f"  use  [{told}]")
    assert "repair: feet float at 10." in rows["floating"]
    assert "drop: 0.18 s long" in rows["short"]
    assert table[-1] == "3 clips, 3 s: 1 use, 1 repair, 1 drop"
    # the columns stand under their heads
    ends = [table[0].index(head) + len(head) for head in ("length", "limits", "speed", "float", "slip", "jumps")]
    for name in ("good", "floating", "short"):
        assert all(rows[name][end - 1] != " " and rows[name][end] == " " for end in ends)


def test_names_of_clips_stay_in_their_rows(tmp_path, capsys):
    np.savez(tmp_path / "odd.npz", **{"a\nb": bowing_clip().qpos, "\x1b[31mred": bowing_clip().qpos, "fps": 50})
    run("inspect", tmp_path / "odd.npz")
    out = capsys.readouterr().out
    assert "\na\\nb  " in out
    assert "\n\\x1b[31mred  " in out


def test_a_bad_file_of_a_folder_is_named_and_left_out(folder, tmp_path, capsys):
    (folder / "labels.csv").write_text("file,style\ngood,happy\n")
    with pytest.raises(MotionError, match="1 of 3 files could not be used; see above"):
        run("inspect", folder)
    out = capsys.readouterr().out
    assert "skipped: motion file" in out
    assert "labels.csv': row 2, column 1" in out
    assert "3 clips, 3 s: 1 use, 1 repair, 1 drop" in out
    run("convert", folder, "--drop-bad", "--out", tmp_path / "all.npz")
    assert {clip.name for clip in load_motions(tmp_path / "all.npz")} == {"good", "floating"}
    with pytest.raises(MotionError, match="labels.csv"):
        run("inspect", folder, "--strict")


def test_inspect_draws(folder, tmp_path, capsys, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(motions, "motion_sheet", partial(motion_sheet, columns=2))
    run("inspect", folder, "--out", tmp_path / "out", "--pictures", 2)
    written = {path.name for path in (tmp_path / "out").iterdir()}
    # the clips to drop and to repair come first
    assert {"short.png", "floating.png"} <= written <= {"short.png", "floating.png", "contact_sheet.png"}
    assert ("contact_sheet.png" in written) != ("no contact sheet" in capsys.readouterr().out)


def test_each_clip_has_a_picture_of_its_own(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(motions, "draw_sheet", lambda path, *_: path.write_bytes(b"sheet"))
    clips = [replace(bowing_clip(), name=name) for name in ("a b", "a/b", "a_b", "contact_sheet")]
    save_motions(tmp_path / "four.npz", clips)
    run("inspect", tmp_path / "four.npz", "--out", tmp_path / "out")
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert written == {"contact_sheet.png", "a b.png", "a_b.png", "a_b_2.png", "contact_sheet_2.png"}
    assert (tmp_path / "out" / "contact_sheet.png").read_bytes() == b"sheet"


def test_no_opengl_costs_only_the_sheet(folder, tmp_path, capsys, monkeypatch):
    pytest.importorskip("matplotlib")

    def fail(*_, **__):
        raise RenderingError("no OpenGL (none); apt install it")

    monkeypatch.setattr(motions, "Stage", fail)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "contact_sheet.png").touch()  # of an earlier start
    run("inspect", folder / "good_50fps.csv", "--out", tmp_path / "out")
    assert "no contact sheet: no OpenGL (none); apt install it" in capsys.readouterr().out
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["good.png"]


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


@pytest.mark.parametrize("names", [("bow_50fps", "bow_100fps", "bow"), ("a/b", "a_b", ".a_b")])
def test_clips_whose_tables_would_be_called_alike_stay_apart(tmp_path, names):
    clips = [MotionClip(name, bowing_clip().qpos, 50.0) for name in names]
    save_motions(tmp_path / "a.npz", clips)
    run("convert", tmp_path / "a.npz", "--out", tmp_path / "csv", "--format", "csv")
    stem = names[-1].lstrip(".")
    files = sorted(path.name for path in (tmp_path / "csv").iterdir())
    assert files == [f"{stem}_2_50fps.csv", f"{stem}_3_50fps.csv", f"{stem}_50fps.csv"]


def test_what_is_written_has_no_other_rate_in_its_name(tmp_path):
    save_motions(tmp_path / "bow_60fps.npz", [MotionClip("bow_60fps", bowing_clip().qpos, 60.0)])
    run("convert", tmp_path / "bow_60fps.npz", "--resample", 50, "--out", tmp_path / "npz")
    (path,) = (tmp_path / "npz").iterdir()
    (clip,) = load_motions(path)
    assert (path.name, clip.name, clip.fps) == ("bow_50fps.npz", "bow_50fps", 50)
    write_human(tmp_path / "turn_60fps.bvh", frames=5)
    run("retarget", tmp_path / "turn_60fps.bvh", "--fps", 25, "--out", tmp_path / "turn")
    assert [path.name for path in (tmp_path / "turn").iterdir()] == ["turn_25fps.npz"]


def test_a_file_of_several_rates_becomes_a_file_for_each_in_a_folder(tmp_path):
    motions = asap_motions(bowing_clip(), names=("a", "b"))
    (tmp_path / "both.pkl").write_bytes(pickle.dumps({**motions, "b": {**motions["b"], "fps": 25}}))
    run("convert", tmp_path / "both.pkl", "--out", tmp_path / "npz")
    found = {path.name: [clip.name for clip in load_motions(path)] for path in sorted((tmp_path / "npz").iterdir())}
    assert found == {"both_25fps.npz": ["b"], "both_50fps.npz": ["a"]}
    with pytest.raises(MotionError, match="clips at 25, 50 frames a second, expected one rate"):
        run("convert", tmp_path / "both.pkl", "--out", tmp_path / "one.npz")


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


def test_generated_motions_are_read(monkeypatch, capsys):
    made = {"generated:val": [bowing_clip(60)]}
    monkeypatch.setattr(motion_files, "generate_named", lambda name, robot: made[name])
    (report,) = run("inspect", "generated:val")
    assert report.verdict == "use"
    assert "generated_val: 1 clip, generated, 50 fps" in capsys.readouterr().out


def test_names_are_made_distinct():
    names = ["a", "a", "a_2", "b", "a"]
    clips = motion_files.distinct([MotionClip(name, np.empty(0), 30.0) for name in names])
    assert [clip.name for clip in clips] == ["a", "a_2", "a_2_2", "b", "a_3"]


def test_what_is_stated_of_files_is_refused_where_there_are_none(tmp_path):
    for option, value in (("fps", 60), ("up", "y"), ("units", "cm"), ("quat-order", "xyzw"), ("angles", "degrees")):
        with pytest.raises(MotionError, match=f"--{option} is stated of files, and 'generated:val/bow@2' is none"):
            run("inspect", "generated:val/bow@2", f"--{option}", value)
    write_csv(tmp_path / "bow.csv", bowing_clip(60))
    _, other = run("inspect", "generated:val/bow@2", tmp_path / "bow.csv", "--fps", 50)
    assert other.seconds == pytest.approx(59 / 50)


def test_what_cannot_be_written_is_said(folder, tmp_path):
    for command, ending in (("convert", "csv"), ("convert", "npy"), ("convert", "json"), ("mirror", "pkl")):
        with pytest.raises(PlatError, match="ends like a file, expected a file .npz, or a folder"):
            run(command, folder, "--out", tmp_path / f"x.{ending}")
    for ending in ("npz", "tsv", "txt"):
        with pytest.raises(PlatError, match="ends like a file, expected a folder for --format csv"):
            run("convert", folder, "--format", "csv", "--out", tmp_path / f"x.{ending}")
    for command in ("retarget", "map"):
        with pytest.raises(PlatError, match="ends like a file, expected a folder"):
            run(command, folder, "--out", tmp_path / "x.npz")
    assert not [path for path in tmp_path.iterdir() if path.stem == "x"]
    with pytest.raises(SystemExit, match="error: --resample is 0.0, expected a number from 1 to 1,000"):
        main(["motions", "convert", str(folder), "--out", str(tmp_path / "x.npz"), "--resample", "0"])
    with pytest.raises(PlatError, match="no clips are left"):
        run("convert", folder / "two.npz", "--trim", 1, 0, "--out", tmp_path / "x.npz", "--drop-bad")


def test_what_is_read_is_not_replaced(tmp_path):
    """A capture beside its retargeted motion was gone, and the motion of walk.npz was that of walk.csv."""
    write_csv(tmp_path / "walk.csv", bowing_clip(40))
    save_motions(tmp_path / "walk.npz", bowing_clip(60))
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    for arguments in (
        ("convert", tmp_path, "--fps", 50, "--out", tmp_path),
        ("convert", tmp_path / "walk.npz", "--repair", "--out", tmp_path / "walk.npz"),
        ("convert", f"{tmp_path}/*", "--fps", 50, "--out", tmp_path / "walk.npz"),
        ("mirror", tmp_path / "walk.npz", "--out", tmp_path),
    ):
        with pytest.raises(PlatError, match=r"--out: would replace '.*walk.npz', which is read"):
            run(*arguments)
    mocap = read_bvh(write_human(tmp_path / "run.bvh"))
    np.savez(tmp_path / "run.npz", joints=0.01 * mocap.positions, joint_names=mocap.names, fps=30)
    with pytest.raises(PlatError, match=r"--out: would replace '.*run.npz', which is read"):
        run("retarget", tmp_path / "run.npz", "--out", tmp_path)
    assert {name: (tmp_path / name).read_bytes() for name in before} == before


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


def test_the_last_line_tells_what_was_left_out_as_asked(folder, tmp_path, capsys):
    (folder / "labels.csv").write_text("file,style\ngood,happy\n")
    run("convert", folder, "--drop-bad", "--out", tmp_path / "all.npz")
    last = capsys.readouterr().out.splitlines()[-1]
    assert last == "1 of 3 files could not be used, 1 was dropped, as asked; see above"
    run("convert", folder / "two.npz", "--out", tmp_path / "two.npz")
    assert capsys.readouterr().out.splitlines()[-1].startswith("wrote 2 clips")


def test_errors_are_one_line():
    out = run_plat("motions", "inspect", "nowhere.csv")
    assert out.returncode == 1
    assert "error: motion file 'nowhere.csv': no such file" in out.stderr
    assert "Traceback" not in out.stderr


@pytest.mark.parametrize(
    "arguments", [["inspect"], ["convert", "--out", "x"], ["mirror", "--out", "x"], ["retarget", "--out", "x"]]
)
def test_no_files_are_one_line(arguments):
    with pytest.raises(MotionError, match=f"no files: give .* as in plat motions {arguments[0]} clips.npz"):
        run(*arguments)


def test_missing_matplotlib_is_said_before_the_work(folder, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setattr(motions, "read", lambda *_: pytest.fail("read first"))
    with pytest.raises(RenderingError, match=r"pip install 'plat-rl\[figures\]'"):
        run("inspect", folder, "--out", tmp_path / "pictures")


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


def jumping_clip() -> MotionClip:
    """Two bows of which the second begins elsewhere."""
    first, second = bowing_clip(60).qpos, bowing_clip(60).qpos.copy()
    second[:, :2] += 0.5
    return MotionClip("jumping", np.concatenate((first, second)), 50.0)


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
    assert "all brought to 50 fps, which most have" in capsys.readouterr().out


def test_cut_makes_clips_of_what_stands_between_jumps(tmp_path, capsys):
    save_motions(tmp_path / "a.npz", [jumping_clip(), bowing_clip(60)])
    run("convert", tmp_path / "a.npz", "--out", tmp_path / "b.npz", "--cut", "--drop-bad")
    clips = {clip.name: clip for clip in load_motions(tmp_path / "b.npz")}
    assert sorted(clips) == ["bow", "jumping_c0", "jumping_c1"]
    np.testing.assert_allclose(clips["jumping_c0"].qpos, bowing_clip(60).qpos, atol=1e-5)
    assert "cut jumping, 2.4 s, into 2 clips of 1.2, 1.2 s" in capsys.readouterr().out


def test_of_several_files_that_are_named_bad_ones_are_left_out(folder, tmp_path, capsys):
    bad = folder / "labels.csv"
    bad.write_text("file,style\ngood,happy\n")
    files = [folder / "good_50fps.csv", bad, folder / "two.npz"]
    with pytest.raises(MotionError, match="1 of 3 files could not be used; see above"):
        run("convert", *files, "--out", tmp_path / "all.npz")
    assert "skipped: motion file" in capsys.readouterr().out
    assert len(load_motions(tmp_path / "all.npz")) == 3
    with pytest.raises(MotionError, match="labels.csv': row 2"):
        run("convert", *files, "--strict", "--out", tmp_path / "none.npz")
    with pytest.raises(MotionError, match="labels.csv': row 2"):
        run("inspect", bad)


def test_a_bad_file_of_a_folder_is_no_error_beside_a_good_file_that_is_named(folder, tmp_path, capsys):
    (folder / "labels.csv").write_text("file,style\ngood,happy\n")
    write_csv(tmp_path / "more_50fps.csv", bowing_clip())
    run("convert", tmp_path / "more_50fps.csv", folder, "--out", tmp_path / "all.npz")
    assert "1 of 4 files could not be used; see above" in capsys.readouterr().out
    with pytest.raises(MotionError, match="1 of 3 files could not be used"):
        run("convert", folder / "labels.csv", folder, "--out", tmp_path / "again.npz")


def test_a_clip_without_a_name_has_pictures(tmp_path, monkeypatch):
    monkeypatch.setattr(motions, "draw_sheet", lambda *_: None)
    save_motions(tmp_path / "a.npz", [replace(bowing_clip(), name=name) for name in ("", "..", ".bow")])
    run("inspect", tmp_path / "a.npz", "--out", tmp_path / "out")
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["bow.png", "motion.png", "motion_2.png"]


def test_no_pictures_are_refused(folder, tmp_path):
    result = run_plat("motions", "inspect", folder, "--out", tmp_path / "out", "--pictures", "0")
    assert "--pictures is 0, expected a whole number of at least 1" in result.stderr


def test_a_rate_that_nothing_states_is_no_verdict_use(tmp_path, capsys):
    write_csv(tmp_path / "bow.csv", bowing_clip(60))
    run("inspect", tmp_path / "bow.csv")
    text = capsys.readouterr().out
    assert "repair: nothing states or shows its frame rate: state it (--fps)  [30 fps, quaternion wxyz det" in text
    assert "fps assumed (another can stand in the file name: x_60fps.csv)]" in text
    run("inspect", tmp_path / "bow.csv", "--fps", 50)
    assert "  use  [50 fps" in capsys.readouterr().out
    # neither does converting it make it known
    run("convert", tmp_path / "bow.csv", "--repair", "--out", tmp_path / "b.npz")
    assert "-> repair (nothing states or shows its frame rate" in capsys.readouterr().out
    run("mirror", tmp_path / "b.npz", "--out", tmp_path / "m.npz")
    run("convert", tmp_path / "m.npz", "--resample", 60, "--out", tmp_path / "tables", "--format", "csv")
    capsys.readouterr()
    run("inspect", tmp_path / "b.npz", tmp_path / "m.npz", tmp_path / "tables")
    text = capsys.readouterr().out
    assert text.count("repair: nothing states or shows its frame rate: state it (--fps)  [") == 3
    assert "60 fps" in text


def test_a_rate_that_nothing_states_is_told_where_it_is_written(tmp_path, capsys):
    write_csv(tmp_path / "bow.csv", bowing_clip(60))
    run("mirror", tmp_path / "bow.csv", "--out", tmp_path / "mirrored.npz")
    told = "of 1 clip nothing states the frames a second, as the file says: state --fps"
    assert told in capsys.readouterr().out
    run("mirror", tmp_path / "bow.csv", "--fps", 50, "--out", tmp_path / "mirrored.npz")
    assert "nothing states" not in capsys.readouterr().out


def test_the_rate_of_generated_motions_is_not_doubted():
    clip = bowing_clip(60)
    told = [
        motions.with_doubt(MotionFile(Path("bow"), kind, [clip]), clip, validate_motion(clip))
        for kind in (motion_files.GENERATED, "csv")
    ]
    assert told == ["50 fps", "50 fps, nothing in the motion confirms this rate"]


def test_options_without_effect_are_refused(tmp_path):
    save_motions(tmp_path / "walk.npz", bowing_clip())
    with pytest.raises(PlatError, match="--pictures: without effect but with --out, expected that beside it"):
        run("inspect", tmp_path / "walk.npz", "--pictures", 5)
    arguments = ("convert", tmp_path / "walk.npz", "--out", tmp_path / "out.npz", "--limits.slip", 0.5)
    with pytest.raises(PlatError, match="--limits: without effect but with --repair, --cut, --drop-bad or --smooth-st"):
        run(*arguments)
    assert not (tmp_path / "out.npz").exists()
    run(*arguments, "--drop-bad", "--limits.min-seconds", 0.1)
