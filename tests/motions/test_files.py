import os
import re
from dataclasses import replace

import numpy as np
import pytest

from plat.errors import MotionError, OutputError
from plat.motions import (
    MotionClip,
    load_motions,
    mirror_motion,
    motion_paths,
    read_motion_files,
    save_csv,
    save_motions,
    validate_motions,
)
from plat.motions.clip import ASSUMED_RATE
from plat.motions.files import name_at, read_along
from plat.robots import G1
from tests.motions.formats.writers import WRITERS, bowing_clip, turned, write_csv, write_plat


@pytest.fixture
def clip() -> MotionClip:
    qpos = np.tile(G1.default_qpos, (6, 1)).astype(np.float32)
    qpos[:, 7:] += np.linspace(0, 0.1, 29)
    return MotionClip("a", qpos, 30.0)


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        ({"quat_order": "wzyx"}, "quat_order is 'wzyx', expected one of wxyz, xyzw"),
        ({"fps": "30"}, "fps is '30', expected a number from 1 to 1,000"),
        ({"fps": 0}, "fps is 0, expected a number from 1"),
        ({"up": "q"}, "up is 'q', expected one of x, y, z"),
        ({"units": "km"}, "units is 'km', expected one of m, cm"),
        ({"angles": "grad"}, "angles is 'grad', expected one of degrees, radians"),
    ],
)
def test_what_is_stated_has_to_be_something(clip, tmp_path, stated, message):
    save_motions(tmp_path / "a.npz", [clip])
    with pytest.raises(MotionError, match=f"stated of motions: {message}"):
        load_motions(tmp_path / "a.npz", **stated)


def test_what_says_nothing_about_any_file_is_refused(clip, tmp_path):
    for name, write in (("a.npz", WRITERS["plat.npz"]), ("a.csv", write_csv), ("a.pkl", WRITERS["gmr.pkl"])):
        write(tmp_path / name, bowing_clip())
        with pytest.raises(
            MotionError, match=f"{name}': angles is stated, and says .*: expected no --angles, or files"
        ):
            load_motions(tmp_path / name, angles="radians")


@pytest.mark.parametrize("other", ["headed_50fps.csv", "gmr.pkl"])
def test_a_motion_in_two_files_is_told(tmp_path, caplog, other):
    bow = bowing_clip()
    write_plat(tmp_path / "bow.npz", bow)
    WRITERS[other](tmp_path / other.replace("headed", "bow").replace("gmr", "bow"), bow)
    (tmp_path / "further").mkdir()
    write_plat(tmp_path / "further" / "bow.npz", turned(bow, 0.5))  # another motion of the same name
    told: list[str] = []
    assert len(read_motion_files(tmp_path, told=told)) == 3
    (line,) = told
    assert line.startswith("read twice: the motion 'bow' of ")
    assert line.count(str(tmp_path)) == 2
    assert "further" not in line
    load_motions(tmp_path)
    assert [record.levelname for record in caplog.records if "read twice" in record.message] == ["WARNING"]
    caplog.clear()
    load_motions([tmp_path / "bow.npz", tmp_path / "further"])
    assert "read twice" not in caplog.text


def test_equal_files_are_told_of_once_each(tmp_path):
    for name in ("a.npz", "b.npz", "c.npz"):
        write_plat(tmp_path / name, bowing_clip())
    told: list[str] = []
    assert len(read_motion_files(tmp_path, told=told)) == 3
    assert told == [f"read twice: {tmp_path / name} is the same as {tmp_path / 'a.npz'}" for name in ("b.npz", "c.npz")]


def test_no_clips_are_no_file(tmp_path):
    with pytest.raises(MotionError, match=r"a.npz': no clips, expected at least one"):
        save_motions(tmp_path / "a.npz", [])


def test_round_trip(tmp_path, clip):
    save_motions(tmp_path / "one.npz", [clip])
    (loaded,) = load_motions(tmp_path / "one.npz")
    assert (loaded.name, loaded.fps) == ("a", 30.0)
    np.testing.assert_allclose(loaded.qpos, clip.qpos, atol=1e-6)


def test_several_rates_do_not_go_into_one_file(tmp_path, clip):
    clips = [clip, MotionClip("b", clip.qpos, 29.8703)]
    with pytest.raises(MotionError, match=r"clips at 29.87, 30 frames a second, expected one rate: .*--resample 50"):
        save_motions(tmp_path / "two.npz", clips)


@pytest.mark.parametrize("name", ["walk", "walk_30fps", "walk_60fps"])
def test_csv_names_state_the_rate_once(tmp_path, clip, name):
    written = save_csv(tmp_path, MotionClip(name, clip.qpos, 30.0))
    assert written.name == "walk_30fps.csv"


def test_joints_are_matched_by_name(tmp_path, clip):
    shuffled = np.random.default_rng(0).permutation(29)
    names = [f"{G1.joint_names[i]}_joint" for i in shuffled]
    qpos = np.concatenate((clip.qpos[:, :7], clip.qpos[:, 7 + shuffled]), 1)
    np.savez(tmp_path / "one.npz", a=qpos, fps=30, joint_names=names)
    np.testing.assert_allclose(load_motions(tmp_path / "one.npz")[0].qpos, clip.qpos, atol=1e-6)


def test_folders_and_globs(tmp_path, clip):
    (tmp_path / "deep").mkdir()
    for name in ("x.npz", "y.npz", "deep/z.npz"):
        save_motions(tmp_path / name, [clip])
    assert len(load_motions(tmp_path)) == 3
    assert len(load_motions(str(tmp_path / "?.npz"))) == 2
    assert len(load_motions([tmp_path / "x.npz", tmp_path / "x.npz"])) == 1


def test_broken_links_and_folders_called_like_files_are_left_out(tmp_path, clip):
    save_motions(tmp_path / "good.npz", [clip])
    (tmp_path / "broken.npz").symlink_to(tmp_path / "nowhere.npz")
    (tmp_path / "sub.csv").mkdir()
    for pattern in (tmp_path, tmp_path / "*"):
        assert [found.name for found in load_motions(pattern)] == [clip.name]


def test_links_to_what_is_not_there_are_told_of(tmp_path, clip):
    save_motions(tmp_path / "a.npz", [clip])
    for name in ("b.npz", "c.npz"):
        (tmp_path / name).symlink_to(tmp_path / "nowhere" / name)
    told: list[str] = []
    assert motion_paths(tmp_path, told=told) == [tmp_path / "a.npz"]
    assert told == [f"ignored: {tmp_path / 'b.npz'} and 1 more, links to what is not there"]
    lost = r"[bc].npz'.*: (a link|links) to what is not there: get it first, as with git"
    for pattern, strict in (("", True), ("c.npz", False), ("[bc].npz", False)):
        with pytest.raises(MotionError, match=lost):
            motion_paths(tmp_path / pattern, strict=strict)


def test_folders_that_links_lead_to_are_read_once(tmp_path, clip):
    for name in ("set/own/a.npz", "set/own/deep/b.npz", "elsewhere/c.npz", "elsewhere/.cache/d.npz"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        save_motions(tmp_path / name, [clip])
    given = tmp_path / "set"
    links = {"far": tmp_path / "elsewhere", "again": given / "own", "own/deep/up": given, ".hidden": tmp_path}
    for link, to in links.items():
        (given / link).symlink_to(to)
    (tmp_path / "elsewhere" / "back").symlink_to(tmp_path)
    found = [str(path.relative_to(given)) for path in motion_paths(given)]
    assert found == ["far/c.npz", "own/a.npz", "own/deep/b.npz"]
    (tmp_path / "link").symlink_to(given)
    assert len(motion_paths(tmp_path / "link")) == 3


def test_names_with_another_rate():
    assert [name_at(name, 50.0) for name in ("a_60fps", "a", "a_50hz", "a_dt0.01", "60fps", "a_120fps_to_50fps")] == [
        *("a_50fps", "a", "a_50hz", "a_50fps", "motion_50fps", "a_120fps_to_50fps")
    ]


def test_hidden_files_of_a_folder_are_left_out(tmp_path, clip):
    for name in ("x.npz", "._x.npz", ".cache/y.npz"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        save_motions(tmp_path / name, [clip])
    assert [path.name for path in motion_paths(tmp_path)] == ["x.npz"]
    assert len(load_motions(tmp_path / ".cache")) == 1


def test_copies_are_left_out(tmp_path, clip):
    for name in ("x.npz", "x (1).npz", "x - Copy.npz", "x_copy2.npz", "take (2).npz"):
        save_motions(tmp_path / name, [clip])
    other = MotionClip("b", clip.qpos, 30.0)
    save_motions(tmp_path / "x (3).npz", [other])
    assert {path.name for path in motion_paths(tmp_path)} == {"x.npz", "take (2).npz", "x (3).npz"}


def test_one_bad_file_does_not_stop_a_folder(tmp_path, clip, caplog):
    save_motions(tmp_path / "x.npz", [clip])
    (tmp_path / "labels.csv").write_text("file,style\na,happy\n")
    np.savez(tmp_path / "shape.npz", betas=np.zeros(16))
    for pattern in (tmp_path, str(tmp_path / "*")):
        caplog.clear()
        assert len(load_motions(pattern)) == 1
        assert [line.split("'")[1].split("/")[-1] for line in caplog.messages] == ["labels.csv", "shape.npz"]
    skipped: list[MotionError] = []
    assert len(read_motion_files(tmp_path, skipped=skipped)) == 1
    assert len(skipped) == 2
    with pytest.raises(MotionError, match="labels.csv"):
        load_motions(tmp_path, strict=True)
    with pytest.raises(MotionError, match="labels.csv"):
        load_motions([tmp_path / "x.npz", tmp_path / "labels.csv"])
    (tmp_path / "x.npz").unlink()
    with pytest.raises(MotionError, match="none of 2 files can be used; motion file .*labels.csv"):
        load_motions(tmp_path)


def test_clips_of_one_name_are_kept_apart(tmp_path):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        write_csv(tmp_path / folder / "bow.csv", bowing_clip())
        save_motions(tmp_path / f"{folder}.npz", [bowing_clip()])
    assert [found.name for found in load_motions(tmp_path)] == ["a_bow", "a_bow_2", "b_bow", "b_bow_2"]
    save_motions(tmp_path / "c.npz", [replace(bowing_clip(), name=name) for name in ("a_bow", "a_bow_2")])
    names = [found.name for found in load_motions(tmp_path)]
    assert len(names) == len(set(names)) == 6


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n", "a Git LFS pointer .* 'git lfs pull'"),
        (b"<!DOCTYPE html><html>", "a web page and not the file itself"),
        (b"", "it is empty"),
    ],
)
@pytest.mark.parametrize("ending", ["npz", "csv", "pkl", "bvh"])
def test_what_stands_in_for_a_file_is_named(tmp_path, content, message, ending):
    (tmp_path / f"a.{ending}").write_bytes(content)
    with pytest.raises(MotionError, match=rf"a.{ending}': .*{message}"):
        load_motions(tmp_path / f"a.{ending}")


def write(path, **arrays) -> None:
    np.savez(path, **arrays)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"a": np.zeros((5, 36))}, "no array 'fps'"),
        ({"fps": 30}, "no clips"),
        ({"a": np.zeros((5, 35)), "fps": 30}, "motion 'a': qpos has 35 columns"),
        ({"a": np.zeros((5, 36)), "fps": np.array(["thirty"])}, "'fps' is 'thirty', expected one number"),
        ({"a": np.zeros((5, 36)), "fps": 30}, "quaternion of frame 0"),
        ({"a": np.zeros((5, 36)), "fps": 30, "joint_names": ["left_knee"]}, "'joint_names' lacks"),
        ({"a": np.array([{}], dtype=object), "fps": 30}, "with Python objects"),
    ],
)
def test_errors_name_file_and_field(tmp_path, arrays, message):
    write(tmp_path / "bad.npz", **arrays)
    with pytest.raises(MotionError, match=f"bad.npz.*{message}"):
        load_motions(tmp_path / "bad.npz")


def test_every_format_by_folder_and_glob(tmp_path):
    for name, writer in WRITERS.items():
        writer(tmp_path / name, bowing_clip())
    files = read_motion_files(tmp_path)
    assert [file.path.name for file in files] == sorted(WRITERS)
    assert {file.format for file in files} == {"plat npz", "tracker npz", "csv", "GMR pickle", "ASAP pickle"}
    assert len(load_motions(tmp_path / "*.pkl")) == 5


def test_files_of_one_kind_are_told_in_one_line(tmp_path, caplog):
    for index in range(3):
        write_csv(tmp_path / f"{index}.csv", bowing_clip())
    save_motions(tmp_path / "plain.npz", [bowing_clip()])
    with caplog.at_level("INFO", logger="plat.motions"):
        load_motions(tmp_path)
    (line,) = caplog.messages
    assert "0.csv and 2 more: csv, 30 fps, quaternion wxyz detected, fps assumed" in line


def test_other_files_are_refused(tmp_path):
    (tmp_path / "notes.md").write_text("hello")
    os.mkfifo(tmp_path / "pipe.csv")
    for name in ("notes.md", "pipe.csv"):
        with pytest.raises(MotionError, match=f"{name}': not a motion file, expected one of .npz, .csv"):
            load_motions(tmp_path / name)
    with pytest.raises(MotionError, match="no such file, folder with motion files"):
        load_motions(tmp_path / "nothing*")


def test_files_that_cannot_be_written_are_named(tmp_path, clip):
    long = replace(clip, name="x" * 300)
    save_motions(tmp_path / "a.npz", [long])
    for write, reason in (
        (lambda: save_csv(tmp_path, long), "x.*_30fps.csv': cannot be written: File name too long"),
        (lambda: save_motions(tmp_path / ("x" * 300), [clip]), "x.npz': cannot be written: File name too long"),
        (lambda: save_csv(tmp_path / "a.npz", clip), "a.npz': is a file, expected a folder"),
        (lambda: save_motions("", [clip]), "motion file '': is empty, expected a path"),
        (lambda: save_motions(tmp_path / "a\0b", [clip]), "cannot be written: its name holds a null byte"),
        (lambda: save_csv(tmp_path / "a\0b", clip), "cannot be written: its name holds a null byte"),
    ):
        with pytest.raises(OutputError, match=reason):
            write()


def test_csv_round_trip(tmp_path, clip):
    path = save_csv(tmp_path, clip)
    (loaded,) = load_motions(path)
    assert (loaded.name, loaded.fps) == ("a", 30.0)
    np.testing.assert_allclose(loaded.qpos, clip.qpos, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "facts", "frames"),
    [
        ("0807_yanjie_walk_001.pkl", "GMR pickle, 29.876 fps, quaternion xyzw", 416),
        ("asap_cr7_level1.pkl", "ASAP pickle, 30 fps, quaternion xyzw, no wrists in the file: default pose", 119),
        ("kimodo_walk_wxyz_30fps.csv", "csv, 30 fps, quaternion wxyz detected, fps from the file name", 150),
        ("unitree_gangnam_xyzw_60fps.csv", "csv, 60 fps, quaternion xyzw detected, fps from the file name", 1942),
        ("holosoma_largebox_50fps.npz", "tracker npz, 50 fps, quaternion wxyz", 325),
    ],
)
def test_real_files(shared_data, name, facts, frames):
    (file,) = read_motion_files(shared_data / "formats" / name)
    assert file.facts == facts
    assert [len(clip.qpos) for clip in file.clips] == [frames]
    (report,) = validate_motions(file.clips)
    assert report.verdict in ("use", "repair"), report


def test_missing_file():
    with pytest.raises(MotionError, match="'nowhere/x.npz': no such"):
        load_motions("nowhere/x.npz")


@pytest.mark.parametrize("content", [b"", b"not a zip", b"PK\x03\x04broken"])
def test_broken_file(tmp_path, content):
    (tmp_path / "bad.npz").write_bytes(content)
    with pytest.raises(MotionError, match="not a readable"):
        load_motions(tmp_path / "bad.npz")


def test_truncated_file(tmp_path, clip):
    save_motions(tmp_path / "bad.npz", [clip])
    content = (tmp_path / "bad.npz").read_bytes()
    for length in range(10, len(content), len(content) // 20):
        (tmp_path / "bad.npz").write_bytes(content[:length])
        with pytest.raises(MotionError, match="not a readable"):
            load_motions(tmp_path / "bad.npz")


def test_names_that_are_no_text_are_made_so(tmp_path, clip, caplog):
    caplog.set_level("INFO", logger="plat.motions")
    names = [os.fsdecode(b"K\xf6ln"), "Köln"]
    for folder in names:
        try:
            (tmp_path / folder).mkdir()
        except OSError:
            pytest.skip("this file system has no such names")
        save_csv(tmp_path / folder, replace(clip, name=names[0]))
    found = load_motions(tmp_path)
    caplog.text.encode()  # raises for what is no text
    assert "K\\udcf6ln" in caplog.text
    caplog.clear()
    assert {clip.name for clip in found} == {f"K\\udcf6ln_30fps_K\\udcf6ln{end}" for end in ("", "_2")}
    save_motions(tmp_path / "all.npz", found)
    assert {clip.name for clip in load_motions(tmp_path / "all.npz")} == {clip.name for clip in found}


NAMES = (
    *("qpos", "qpos_1", "joint_pos", "joint_positions", "joint_angles", "dof", "dof_pos", "poses", "betas", "trans"),
    *("dt", "hz", "frequency", "timestep", "time", "t", "metadata", "split_points", "root_pos", "base pos", "joints"),
    *("file", "allow_pickle", "arr_0", "a/b", "x.npy", "ünï code", "fps_", "q_pelvis_tx", "global_rot_mats", ""),
)


@pytest.mark.parametrize("name", NAMES)
def test_clips_come_back_whatever_they_are_called(tmp_path, clip, name):
    clips = [replace(clip, name=name), replace(clip, name="other")]
    save_motions(tmp_path / "x.npz", clips)
    found = load_motions(tmp_path / "x.npz")
    assert [(one.name, one.fps) for one in found] == [(name, 30.0), ("other", 30.0)]
    for one in found:
        np.testing.assert_allclose(one.qpos, clip.qpos, atol=1e-6)


def test_all_names_in_one_file_come_back(tmp_path, clip):
    save_motions(tmp_path / "x.npz", [replace(clip, name=name) for name in NAMES])
    (file,) = read_motion_files(tmp_path / "x.npz")
    assert sorted(one.name for one in file.clips) == sorted(NAMES)
    assert file.facts == "plat npz, 30 fps"
    assert {one.fps for one in load_motions(tmp_path / "x.npz", fps=50)} == {50.0}


def test_a_file_without_the_mark_is_read_as_before(tmp_path, clip):
    arrays = {"fps": 30.0, "joint_names": G1.joint_names, "walk": clip.qpos, "run": clip.qpos}
    np.savez_compressed(tmp_path / "x.npz", **arrays)
    assert [one.name for one in load_motions(tmp_path / "x.npz")] == ["walk", "run"]
    np.savez_compressed(tmp_path / "x.npz", fps=30.0, joint_names=G1.joint_names, qpos=clip.qpos)
    assert [one.name for one in load_motions(tmp_path / "x.npz")] == ["x"]


@pytest.mark.parametrize(
    "name", ["..walk", "60fps", "walk_dt0.02", "walk_timestep_0.005s_x", "a/b", "a\0b", "a_120fps_to_60fps"]
)
def test_a_table_is_read_back_whatever_its_clip_is_called(tmp_path, clip, name):
    save_csv(tmp_path, replace(clip, name=name))
    (found,) = load_motions(tmp_path)
    assert found.fps == 30.0
    np.testing.assert_allclose(found.qpos, clip.qpos, atol=1e-6)


@pytest.mark.parametrize("save", ["npz", "csv"])
def test_a_rate_that_was_assumed_stays_so_in_what_plat_writes(tmp_path, save):
    clip = bowing_clip(60)
    unsure = replace(clip, notes=(ASSUMED_RATE, "another note"), fps=60.0)
    if save == "npz":
        path = tmp_path / "x.npz"
        save_motions(path, [unsure, replace(clip, name="sure", fps=60.0)])
    else:
        path = save_csv(tmp_path, mirror_motion(mirror_motion(unsure)))
        save_csv(tmp_path, replace(clip, name="sure", fps=60.0))
    loaded = {clip.name: clip for clip in load_motions(tmp_path)}
    assert {name: (clip.fps, ASSUMED_RATE in clip.notes) for name, clip in loaded.items()} == {
        unsure.name: (60, True),
        "sure": (60, False),
    }
    (report,) = validate_motions([loaded[unsure.name]])
    assert (report.rate_assumed, report.verdict) == (True, "repair")
    stated = load_motions(path, fps=50)  # by who knows it
    assert {(clip.fps, ASSUMED_RATE in clip.notes) for clip in stated} == {(50, False)}


def test_what_is_read_along_with_a_table(tmp_path, clip):
    for ending in (".csv", ".tsv", ".txt", ".npy"):
        assert read_along(tmp_path / f"a{ending}") == []
    save_motions(tmp_path / "a.npz", [clip])
    for ending in (".csv", ".tsv", ".txt", ".npy"):
        assert read_along(tmp_path / f"a{ending}") == [tmp_path / "a.npz"]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("fps", "'fps', expected a name other than 'fps', 'joint_names', 'fps_assumed', 'plat_motions'"),
        ("joint_names", "a clip is called 'joint_names', expected"),
        ("plat_motions", "a clip is called 'plat_motions', expected"),
        ("a\0b", "expected text without null characters of at most 65000 bytes"),
        ("\ud800", "expected text without null characters of at most 65000 bytes"),
        ("x" * 70_000, "expected text without null characters of at most 65000 bytes"),
    ],
)
def test_names_that_cannot_stand_in_a_file_are_refused(tmp_path, clip, name, message):
    with pytest.raises(MotionError, match=f"x.npz': .*{message}"):
        save_motions(tmp_path / "x.npz", [replace(clip, name=name)])
    assert not list(tmp_path.iterdir())


def test_repeated_names_and_rates_are_refused(tmp_path, clip):
    with pytest.raises(MotionError, match="2 clips are called 'a', expected names that differ from each other"):
        save_motions(tmp_path / "x.npz", [clip, clip])
    with pytest.raises(MotionError, match="one rate"):
        save_motions(tmp_path / "x.npz", [clip, MotionClip("b", clip.qpos, 50.0)])


def test_long_names_in_a_file_do_not_make_long_messages(tmp_path):
    names = np.array([f"{'x' * 5000}{joint}" for joint in range(29)])
    qpos = np.tile(G1.default_qpos, (4, 1))
    np.savez(tmp_path / "a.npz", joint_names=names, fps=30.0, clip=qpos)
    with pytest.raises(MotionError, match="'joint_names' lacks") as error:
        load_motions(tmp_path / "a.npz")
    assert len(str(error.value)) < 1200


SIDE, HALF = (np.sqrt(0.5), -np.sqrt(0.5), 0, 0), np.sqrt(0.5)


@pytest.mark.parametrize(
    ("place", "quat", "broken"),
    [
        ((0, 0, 0.76), (1, 0, 0, 0), True),
        ((0, 0, 2.0), (1, 0, 0, 0), False),
        ((0, 0, 4.5), (1, 0, 0, 0), False),
        ((1500, 0, 0.76), (1, 0, 0, 0), False),
        ((0, 0, 0.11), SIDE, False),
        ((0, 0.75, 0.11), SIDE, False),
        ((0, 0.9, 0.5), SIDE, False),
        ((0.8, 0, 0.5), (HALF, 0, HALF, 0), False),
        ((0, 0, 0.7), (0, 1, 0, 0), False),
    ],
)
def test_what_plat_wrote_comes_back_as_it_was(tmp_path, place, quat, broken):
    """It is in meters and radians, z up: a broken frame made degrees of it, a height feet, and who lay stood up."""
    qpos = np.tile(G1.default_qpos, (60, 1))
    qpos[:, :3], qpos[:, 3:7] = place, quat
    if broken:
        qpos[30, 22:27] += 3.5
    clip = MotionClip("a", qpos, 30.0).checked(G1)
    save_motions(tmp_path / "a.npz", [clip])
    (file,) = read_motion_files(tmp_path / "a.npz")
    np.testing.assert_allclose(file.clips[0].qpos, clip.qpos, rtol=0, atol=1e-6 * max(1, *place))
    assert file.facts == "plat npz, 30 fps"


def test_what_is_stated_of_what_plat_wrote_is_done(tmp_path, clip):
    save_motions(tmp_path / "a.npz", [clip])
    (read,) = load_motions(tmp_path / "a.npz", units="cm")
    np.testing.assert_allclose(read.qpos[:, :3], 0.01 * clip.qpos[:, :3], atol=1e-6)


def test_no_table_of_a_clip_replaces_that_of_another(tmp_path, clip):
    waves = [replace(clip, name=f"arm_{hertz}hz") for hertz in (1, 2, 3)]
    assert [save_csv(tmp_path, wave).name for wave in waves] == [f"arm_{hertz}hz_30fps.csv" for hertz in (1, 2, 3)]
    assert sorted(found.name for found in load_motions(tmp_path)) == ["arm_1hz", "arm_2hz", "arm_3hz"]
    for first, *others in (("b_60fps", "b_120fps", "b"), ("c", "c_60fps", "..c"), ("d/e", "d_e")):
        path = save_csv(tmp_path, replace(clip, name=first))
        assert load_motions(path)[0].fps == 30
        for other in others:
            told = f"{path.name}': has the clip '{first}', and would be replaced by '{other}'; expected another"
            with pytest.raises(OutputError, match=re.escape(told)):
                save_csv(tmp_path, replace(clip, name=other))
        assert save_csv(tmp_path, replace(clip, name=first, qpos=clip.qpos[1:])) == path  # the same clip anew
        assert len(load_motions(path)[0].qpos) == len(clip.qpos) - 1


def test_broken_motions_of_a_file_are_one_line(tmp_path, clip, caplog):
    save_motions(tmp_path / "a.npz", [replace(clip, name=f"c{number}") for number in range(6)])
    arrays = dict(np.load(tmp_path / "a.npz"))
    for number in range(1, 6):
        arrays[f"c{number}"][0, 7] = np.nan
    np.savez(tmp_path / "a.npz", **arrays)
    assert [read.name for read in load_motions(tmp_path / "a.npz")] == ["c0"]
    (line,) = [record.getMessage() for record in caplog.records if record.levelname == "WARNING"]
    reasons = "; ".join(f"motion 'c{number}': qpos[0, 7] is nan, expected a finite number" for number in (1, 2, 3))
    told = f"motion file '{tmp_path / 'a.npz'}': 5 of 6 motions left out: {reasons}; and 2 more"
    assert line == f"skipped: {told}"
    with pytest.raises(MotionError, match=re.escape(told)):
        load_motions(tmp_path / "a.npz", strict=True)
