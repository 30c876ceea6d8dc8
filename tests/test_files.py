import ast
import errno
import os
from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest

from plat.deploy import PolicyRunner
from plat.errors import KeyframeError, MotionError, OutputError, PlatError
from plat.export import export_bundle
from plat.files import (
    FILES,
    TABLES,
    check_file,
    check_folder,
    clear_parts,
    expand_home,
    is_full,
    refuse_null,
    replace_file,
)
from plat.keyframes import KeyframeSequence, standing
from plat.motions import MotionClip, MotionLibrary, load_motions, save_csv, save_motions
from plat.motions.files import motion_paths
from plat.motions.readers import READERS
from plat.robots import G1
from plat.runs import SavedRun


def test_a_failed_write_leaves_the_file_before_it_and_nothing_else(tmp_path):
    path = tmp_path / "a.txt"
    replace_file(path, lambda part: part.write_text("first"))

    def half(part):
        part.write_text("sec")
        raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        replace_file(path, half)
    assert path.read_text() == "first"
    assert [file.name for file in tmp_path.iterdir()] == ["a.txt"]


@pytest.mark.skipif(os.name != "posix", reason="processes are asked whether they live")
def test_what_a_killed_process_was_writing_is_removed(tmp_path):
    seen = []

    def write(part):
        dead = part.with_name(part.name.replace(f"-{os.getpid()}-", f"-{2**22 + 1}-"))
        dead.write_text("half")
        part.with_name(".keep-me-1.txt").write_text("a hidden file of someone else")
        clear_parts(tmp_path)
        seen.extend(sorted(path.name for path in tmp_path.iterdir()))
        part.write_text("whole")

    replace_file(tmp_path / "a-b.txt", write)
    assert len(seen) == 2
    assert seen[1] == ".keep-me-1.txt" or seen[0].startswith(f".a-b.txt-{os.getpid()}-")
    assert (tmp_path / "a-b.txt").read_text() == "whole"


def test_a_full_disk_is_named_by_the_file(tmp_path):
    path = tmp_path / "a.txt"

    def full(part):
        part.write_text("half")
        raise OSError(errno.ENOSPC, "No space left on device")

    def beside(part):
        part.with_name("other").read_text()

    with pytest.raises(OSError, match=r"No space left on device: '.*/a\.txt'"):
        replace_file(path, full)
    with pytest.raises(FileNotFoundError, match=r"'.*/other'"):  # no fault of this file
        replace_file(path, beside)
    with pytest.raises(OSError, match=r"'/proc/none/a\.txt'"):
        replace_file(Path("/proc/none/a.txt"), full)
    assert list(tmp_path.iterdir()) == []


def test_a_disk_with_no_room_is_full(tmp_path, monkeypatch):
    assert not is_full(tmp_path / "missing")
    monkeypatch.setattr("plat.files.shutil.disk_usage", lambda _: Namespace(free=4096))
    assert is_full(tmp_path)


def test_a_home_that_nobody_has_is_a_name_like_any_other(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    assert expand_home(Path("~/a.txt")) == tmp_path / "a.txt"
    assert expand_home(Path("~nobody-of-this-name/a.txt")) == Path("~nobody-of-this-name/a.txt")


@pytest.fixture
def mask():
    """The mask of new files, put back behind the test."""
    before = os.umask(0o022)
    yield os.umask
    os.umask(before)


@pytest.mark.skipif(os.name != "posix", reason="permissions are others")
def test_the_permissions_are_those_of_any_file(tmp_path, mask, monkeypatch):
    path = tmp_path / "a.txt"

    def written() -> int:
        replace_file(path, lambda part: part.write_text("x"))
        return path.stat().st_mode & 0o777

    assert written() == 0o644
    path.chmod(0o664)  # shared with a group
    assert written() == 0o664
    for masked, mode in ((0o077, 0o600), (0o002, 0o664)):
        path.unlink()
        mask(masked)
        assert written() == mode

    def refused(self, mode):
        raise PermissionError(errno.EPERM, "Operation not permitted", str(self))

    monkeypatch.setattr(Path, "chmod", refused)  # as a stick with another file system does
    assert written() == 0o664


@pytest.mark.parametrize("name", ["a" * 251 + ".csv", "ä" * 125 + ".csv", "a." + "b" * 250])
def test_a_long_name_is_refused_before_the_work_or_can_be_written(tmp_path, name):
    path = tmp_path / name
    check_file(path)
    replace_file(path, lambda part: part.write_text("x"))
    assert [file.name for file in tmp_path.iterdir()] == [name]
    with pytest.raises(OutputError, match="too long"):
        check_file(tmp_path / (name + "aaaaaa"))


@pytest.mark.skipif(os.name != "posix", reason="processes are asked whether they live")
def test_what_another_machine_is_writing_is_left_alone_for_a_day(tmp_path, monkeypatch):
    seen: list[bool] = []

    def write(part):
        clear_parts(tmp_path)
        seen.append(part.exists())
        with monkeypatch.context() as patch:  # the same folder as another machine sees it: no such process there
            patch.setattr("plat.files._machine", lambda: "0123abcd")
            patch.setattr("plat.files._is_alive", lambda process: False)
            clear_parts(tmp_path)
            seen.append(part.exists())
        part.write_text("whole")

    replace_file(tmp_path / "run-5-abc.part.csv", write)  # a name like that of a part
    assert seen == [True, True]
    old = tmp_path / f".b.csv-{os.getpid()}-12345678.0123abcd.part.csv"
    old.write_text("half")
    check_folder(tmp_path)
    assert old.exists()
    os.utime(old, (0, 0))
    check_folder(tmp_path)
    assert not old.exists()


def test_a_command_removes_what_a_killed_one_left_in_its_folder(tmp_path):
    for name in ("old-name", "a.csv"):
        (tmp_path / f".{name}-{2**22 + 1}-12345678.part.csv").write_text("half")
    check_file(tmp_path / "a.csv")
    assert list(tmp_path.iterdir()) == []


def test_places_that_can_be_written_to_are_left_as_they_were(tmp_path):
    check_folder(tmp_path / "a" / "b")
    check_file(tmp_path / "a" / "b.npz")
    (tmp_path / "old.csv").write_text("old")
    check_file(tmp_path / "old.csv", suffixes=(".csv",))
    check_folder(tmp_path)
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"old.csv": "old"}


def test_places_that_cannot_be_written_to(tmp_path):
    (tmp_path / "file").write_text("")
    os.mkfifo(tmp_path / "fifo")
    for check, path, message in (
        (check_folder, tmp_path / "file", "--out .*file': is a file, expected a folder"),
        (check_folder, tmp_path / "file" / "below", "--out .*below': cannot be written to: "),
        (check_folder, Path("/proc/none/below"), "cannot be written to"),
        (check_file, tmp_path, "is a folder, expected a file"),
        (check_file, tmp_path / "fifo", "is a device, expected a file"),
        (check_file, tmp_path / "file" / "below" / "deep", "below': cannot be written to"),
        (check_file, tmp_path / "a\0b", "its name holds a null byte"),
        (check_folder, tmp_path / "a\0b", "its name holds a null byte"),
    ):
        with pytest.raises(OutputError, match=message):
            check(path)
    with pytest.raises(OutputError, match="--csv .*x.txt': expected a file that ends in .csv or .tsv"):
        check_file(tmp_path / "x.txt", "--csv", (".csv", ".tsv"))


def test_a_new_folder_that_ends_like_a_file_is_a_slip(tmp_path):
    assert set(READERS) <= FILES
    assert set(TABLES) <= FILES
    (tmp_path / "there.npy").mkdir()
    for name in ("there.npy", "v1.2", "npy", ".npy"):
        check_folder(tmp_path / name)
    for name in ("x.npy", "x.TSV", "x.onnx"):
        with pytest.raises(OutputError, match=f"--out .*{name}': ends like a file, expected a folder$"):
            check_folder(tmp_path / name)
    assert [path.name for path in tmp_path.iterdir()] == ["there.npy"]


def test_devices_and_folders_are_not_replaced(tmp_path):
    os.mkfifo(tmp_path / "fifo")
    for path in (tmp_path / "fifo", tmp_path):
        with pytest.raises(OutputError, match="expected a file"):
            replace_file(path, lambda part: part.write_text("new"))
    assert (tmp_path / "fifo").is_fifo()
    assert [path.name for path in tmp_path.iterdir()] == ["fifo"]


def test_a_null_byte_in_a_name_is_told_as_a_disk_would(tmp_path):
    for write in (replace_file, lambda path, write: refuse_null(path)):
        with pytest.raises(OSError, match="its name holds a null byte"):
            write(tmp_path / "a\0b", lambda part: part.write_text("new"))
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_path_is_told():
    pose = standing(G1)
    sequence = KeyframeSequence(G1, pose, (pose.at(0.5),))
    clip = MotionClip("still", np.tile(G1.default_qpos, (5, 1)), 30.0)
    for door, what in (
        (lambda path: KeyframeSequence.load(path, G1), "keyframe file"),
        (sequence.save, "keyframe file"),
        (load_motions, "motion file"),
        (MotionLibrary.load, "motion file"),
        (lambda path: save_motions(path, [clip]), "motion file"),
        (lambda path: save_csv(path, clip), "folder"),
        (SavedRun, "run"),
        (PolicyRunner, "bundle"),
        (lambda path: export_bundle("plat-g1", path), "bundle"),
    ):
        with pytest.raises(PlatError, match=f"{what} 5: expected a path"):
            door(5)


def writes(source: str) -> list[str]:
    """Calls that write a file, but for the part that :func:`replace_file` hands out."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            mode = next((arg.value for arg in node.args[:1] if isinstance(arg, ast.Constant)), "r")
            if node.func.attr in ("write_text", "write_bytes") or (node.func.attr == "open" and mode in ("w", "wb")):
                names = {name.id for name in ast.walk(node.func.value) if isinstance(name, ast.Name)}
                found += [] if "part" in names else [ast.unparse(node)]
    return found


def test_files_are_written_whole_everywhere():
    assert len(writes("path.write_text('x')\npath.open('w')\n(folder / 'a').write_bytes(b'x')")) == 3
    assert writes("part.write_text('x')\n(part / 'a').open('w')\npath.open()") == []
    root = Path(__file__).parents[1]
    sources = [*root.glob("plat/**/*.py"), *root.glob("recipes/**/*.py")]
    found = {path.relative_to(root).as_posix() for path in sources if writes(path.read_text(encoding="utf-8"))}
    assert found == {
        "plat/runs/checkpoints.py",  # in a folder that is published whole
        "plat/studio/static.py",  # likewise
        "plat/export/bundle.py",  # likewise
        "plat/studio/session.py",  # in a temporary folder
        "plat/collectors/worker.py",  # likewise
        "plat/pools.py",  # likewise
    }


def test_an_empty_name_is_not_the_working_directory(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(MotionError, match="motion file '': is empty, expected a path"):
        motion_paths(["", "a.npz"])
    with pytest.raises(KeyframeError, match="keyframe file '': is empty, expected a path"):
        KeyframeSequence.load("", G1)
