"""The panel of files, without a browser: which files it replaces and deletes."""

import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from plat.robots import G1

pytest.importorskip("viser", reason="the extra plat-rl[studio] is not installed")
pytest.importorskip("mjviser", reason="the extra plat-rl[studio] is not installed")
pytest.importorskip("mink", reason="the extra plat-rl[studio] is not installed")

from plat.keyframes.files import read_keyframes
from plat.motions import generate_motions
from plat.studio.app import Studio
from plat.studio.autosave import AUTOSAVE
from plat.studio.session import Session


@pytest.fixture
def studio(policies, tmp_path) -> Iterator[Studio]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    session = Session(G1, policies)
    studio = Studio(session, host="127.0.0.1", port=port, motions="", path="a.json", folder=tmp_path)
    yield studio
    studio.server.stop()


def named(studio: Studio, name: str) -> None:
    """Begin anew, with a keyframe of this name."""
    studio.session.new()
    studio.session.add()
    studio.session.edit(studio.session.timeline.renamed(name))


def asked(studio: Studio) -> bool:
    """Save, and return whether the page asked first; the answer is no."""
    studio._files.save()
    question = studio._page.dock.state.get("question")
    if question:
        studio._page.answer({"id": question["id"], "yes": False})
    return bool(question)


def names(path: Path) -> list[str | None]:
    return [frame.name for frame in read_keyframes(path, G1)[1]]


def test_undo_across_a_load_is_asked_about(studio, tmp_path):
    session = studio.session
    named(studio, "mine")
    session.save(tmp_path / "a.json")
    named(studio, "other")
    studio._files._load()
    assert names(tmp_path / "a.json") == ["mine"]
    session.undo()
    assert session.timeline.pose.name == "other"
    assert asked(studio), "the file is not of these keyframes"
    assert names(tmp_path / "a.json") == ["mine"]
    session.redo()
    session.edit(session.timeline.renamed("edited"))
    assert not asked(studio), "it is of these"
    assert names(tmp_path / "a.json") == ["edited"]


@pytest.mark.parametrize("begin", ["new", "upload", "restore", "clip"])
def test_other_keyframes_are_asked_about_until_they_are_undone(studio, tmp_path, begin):
    named(studio, "mine")
    assert not asked(studio), "there is no file yet"
    content = (tmp_path / "a.json").read_bytes()
    if begin == "new":
        named(studio, "other")
    elif begin == "upload":
        studio._files._upload("b.json", content)
    elif begin == "clip":
        studio.session.take_stretch(generate_motions("val", seconds=4)[0], 0.0, 2.0, 0.5)
    else:
        studio._autosave.former = content
        studio._files._restore()
    assert asked(studio)
    for _ in range(3 if begin == "new" else 1):
        studio.session.undo()
    assert not asked(studio)
    studio.session.undo()
    assert not asked(studio), "an earlier state of the same keyframes"


def test_the_restored_file_is_saved_to_and_stays(studio, tmp_path):
    named(studio, "mine")
    assert studio._autosave.tick(at_once=True)
    studio._files._path.value = AUTOSAVE
    studio._files._load()
    assert not asked(studio)
    assert names(tmp_path / AUTOSAVE) == ["mine"]


def test_a_former_copy_outlives_a_save(studio, tmp_path):
    named(studio, "precious")
    studio.session.save(tmp_path / AUTOSAVE)
    named(studio, "mine")
    studio._files.save()
    assert names(tmp_path / AUTOSAVE) == ["precious"]
