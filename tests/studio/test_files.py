"""The panel of files, without a browser: which files it replaces and deletes."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager
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


@contextmanager
def opened(session: Session, folder: Path) -> Iterator[Studio]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    studio = Studio(session, host="127.0.0.1", port=port, motions="", path="a.json", folder=folder)
    try:
        yield studio
    finally:
        studio.server.stop()


@pytest.fixture
def studio(policies, tmp_path) -> Iterator[Studio]:
    with opened(Session(G1, policies), tmp_path) as studio:
        yield studio


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


def test_a_file_that_something_else_wrote_is_asked_about(studio, tmp_path):
    named(studio, "mine")
    assert not asked(studio)
    named_by_others = (tmp_path / "a.json").read_text().replace('"mine"', '"theirs"')
    (tmp_path / "a.json").write_text(named_by_others)
    studio._files.save()
    question = studio._page.dock.state["question"]
    assert question["text"].endswith("a.json was changed by something else since.")
    studio._page.answer({"id": question["id"], "yes": False})
    assert names(tmp_path / "a.json") == ["theirs"]
    (tmp_path / "a.json").unlink()
    assert not asked(studio), "there is nothing to lose"


def test_the_line_says_saved_only_of_a_file_that_holds_the_keyframes(studio, tmp_path):
    def line() -> tuple[str, bool]:
        studio._files.show()
        return tuple(studio._page.dock.state["file"][name] for name in ("name", "unsaved"))

    named(studio, "mine")
    assert line() == ("a.json", True)
    studio._files.save()
    assert line() == ("a.json", False)
    studio._files._path.value = "b.json"
    assert line() == ("b.json", True)
    studio._files._path.value = "a.json"
    studio._files._upload("walk.json", (tmp_path / "a.json").read_bytes())
    assert line() == ("a.json", True)
    studio.session.new()
    assert line() == ("a.json", False)


def test_a_file_to_begin_with_is_saved_to_and_opening_it_is_no_step(policies, tmp_path):
    session = Session(G1, policies)
    session.add()
    session.save(tmp_path / "a.json")
    session = Session(G1, policies)
    session.open(tmp_path / "a.json")
    assert not session.history.can_undo
    session.edit(session.timeline.renamed("new"))
    with opened(session, tmp_path) as studio:
        assert not asked(studio)
    assert names(tmp_path / "a.json") == ["new"]


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
