"""``plat motions inspect``, and what its commands have in common."""

import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from plat.cli import motion_files, motions
from plat.errors import MotionError, PlatError
from plat.figures import motion_sheet
from plat.motions import (
    MotionFile,
    save_motions,
    validate_motion,
)
from plat.rendering import RenderingError
from tests.cli.motion_commands import run
from tests.in_process import run_plat
from tests.motions.formats.writers import bowing_clip, write_csv


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


def test_the_rate_of_generated_motions_is_not_doubted():
    clip = bowing_clip(60)
    told = [
        motions.with_doubt(MotionFile(Path("bow"), kind, [clip]), clip, validate_motion(clip))
        for kind in (motion_files.GENERATED, "csv")
    ]
    assert told == ["50 fps", "50 fps, nothing in the motion confirms this rate"]


def test_options_without_effect_are_refused(tmp_path):
    save_motions(tmp_path / "walk.npz", bowing_clip())
    with pytest.raises(PlatError, match="--pictures: takes effect only with --out"):
        run("inspect", tmp_path / "walk.npz", "--pictures", 5)
    arguments = ("convert", tmp_path / "walk.npz", "--out", tmp_path / "out.npz", "--limits.slip", 0.5)
    with pytest.raises(PlatError, match="--limits: takes effect only with --repair, --cut, --drop-bad or --smooth-st"):
        run(*arguments)
    assert not (tmp_path / "out.npz").exists()
    run(*arguments, "--drop-bad", "--limits.min-seconds", 0.1)
