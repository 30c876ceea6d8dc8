import os
from pathlib import Path

import pytest

from plat.errors import StudioError
from plat.keyframes import KeyframeSequence
from plat.studio.folder import Folder


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    (tmp_path / "work").mkdir()
    return Folder(tmp_path / "work")


@pytest.mark.parametrize("name", ["a.json", "sub/a.json", "./a.json", "A.JSON"])
def test_names_are_inside_the_folder(folder: Folder, name: str) -> None:
    assert folder.file(name, ".json").is_relative_to(folder.root)
    assert folder.file(str(folder.root / name), ".json").is_relative_to(folder.root)


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("", "no file name"),
        ("a\0.json", "no file name"),
        ("a.txt", "expected '.json'"),
        ("../a.json", "outside"),
        ("sub/../../a.json", "outside"),
        ("/etc/a.json", "outside"),
        ("~/a.json", "outside"),
    ],
)
def test_other_names_are_refused(folder: Folder, name: str, reason: str) -> None:
    with pytest.raises(StudioError, match=reason):
        folder.file(name, ".json")


def test_links_devices_and_folders_are_refused(folder: Folder, tmp_path: Path) -> None:
    (tmp_path / "outside.json").write_text("{}")
    (folder.root / "link.json").symlink_to(tmp_path / "outside.json")
    (folder.root / "inner.json").write_text("{}")
    (folder.root / "inner_link.json").symlink_to(folder.root / "inner.json")
    (folder.root / "dir.json").mkdir()
    os.mkfifo(folder.root / "pipe.json")
    (folder.root / "way").symlink_to(tmp_path, target_is_directory=True)
    for name in ("link.json", "inner_link.json", "dir.json", "pipe.json", "way/outside.json"):
        with pytest.raises(StudioError, match="outside|expected a regular file"):
            folder.file(name, ".json")


def test_only_keyframe_files_are_replaced(folder: Folder, sequence: KeyframeSequence) -> None:
    path = folder.file("a.json", ".json")
    assert not folder.taken(path)
    sequence.save(path)
    assert folder.taken(path)
    for content in ('{"name": "package.json"}', "[1]", "not json", "[" * 100_000):
        path.write_text(content)
        with pytest.raises(StudioError, match="holds no keyframes"):
            folder.taken(path)
    video = folder.file("a.mp4", ".mp4")
    video.write_bytes(b"")
    assert folder.taken(video)


def test_what_cannot_be_written_is_found_out_before_the_work(folder: Folder) -> None:
    folder.check_writable(folder.file("new/a.mp4", ".mp4"))
    assert list((folder.root / "new").iterdir()) == []
    (folder.root / "file").write_text("")
    with pytest.raises(StudioError, match="cannot be written"):
        folder.check_writable(folder.root / "file" / "a.mp4")


def test_a_folder_that_is_none_is_named(tmp_path: Path) -> None:
    with pytest.raises(StudioError, match="nowhere"):
        Folder(tmp_path / "nowhere")
