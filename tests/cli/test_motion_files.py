"""Reading and writing the files of ``plat motions``, and what is told of those left out."""

import pickle

import numpy as np
import pytest

from plat.cli import main, motion_files
from plat.errors import MotionError, PlatError
from plat.motions import (
    MotionClip,
    load_motions,
    save_motions,
)
from plat.motions.retargeting.bvh import read_bvh
from tests.cli.motion_commands import run
from tests.motions.formats.writers import asap_motions, bowing_clip, write_csv
from tests.motions.retargeting.human import write_human


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
        with pytest.raises(MotionError, match=f"--{option} applies to files, and 'generated:val/bow@2' is generated"):
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


def test_a_rate_that_nothing_states_is_told_where_it_is_written(tmp_path, capsys):
    write_csv(tmp_path / "bow.csv", bowing_clip(60))
    run("mirror", tmp_path / "bow.csv", "--out", tmp_path / "mirrored.npz")
    told = "the frame rate of 1 clip is assumed, as the file notes: state it with --fps"
    assert told in capsys.readouterr().out
    run("mirror", tmp_path / "bow.csv", "--fps", 50, "--out", tmp_path / "mirrored.npz")
    assert "nothing states" not in capsys.readouterr().out


def test_the_last_line_tells_what_was_left_out_as_asked(folder, tmp_path, capsys):
    (folder / "labels.csv").write_text("file,style\ngood,happy\n")
    run("convert", folder, "--drop-bad", "--out", tmp_path / "all.npz")
    last = capsys.readouterr().out.splitlines()[-1]
    assert last == "1 of 3 files could not be used, 1 was dropped, as asked; see above"
    run("convert", folder / "two.npz", "--out", tmp_path / "two.npz")
    assert capsys.readouterr().out.splitlines()[-1].startswith("wrote 2 clips")


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


@pytest.mark.parametrize("names", [("bow_50fps", "bow_100fps", "bow"), ("a/b", "a_b", ".a_b")])
def test_clips_whose_tables_would_be_called_alike_stay_apart(tmp_path, names):
    clips = [MotionClip(name, bowing_clip().qpos, 50.0) for name in names]
    save_motions(tmp_path / "a.npz", clips)
    run("convert", tmp_path / "a.npz", "--out", tmp_path / "csv", "--format", "csv")
    stem = names[-1].lstrip(".")
    files = sorted(path.name for path in (tmp_path / "csv").iterdir())
    assert files == [f"{stem}_2_50fps.csv", f"{stem}_3_50fps.csv", f"{stem}_50fps.csv"]
