import pytest

from plat.robots import G1

pytest.importorskip("mink", reason="the extra plat-rl[studio] is not installed")

from plat.studio import autosave
from plat.studio.autosave import Autosave
from plat.studio.session import Session


@pytest.fixture
def session(policies) -> Session:
    return Session(G1, policies)


def test_an_edit_is_kept_when_it_has_rested(session, tmp_path, monkeypatch):
    monkeypatch.setattr(autosave, "_AFTER", 0.0)
    keeper = Autosave(session, tmp_path)
    assert keeper.former is None
    assert not keeper.tick(), "nothing was edited"
    session.add()
    assert keeper.tick()
    assert keeper.words.startswith("autosaved")
    assert session.unsaved, "the user has no file of it"
    assert not keeper.tick(), "once is enough"
    again = Session(G1, session.playback.policies)
    former = Autosave(again, tmp_path).former
    again.from_json("autosave", former)
    assert again.timeline.labels == session.timeline.labels


def test_not_while_something_is_dragged(session, tmp_path):
    keeper = Autosave(session, tmp_path)
    session.add()
    assert not keeper.tick()
    assert not keeper.path.exists()


def test_at_the_end_it_waits_for_no_rest(session, tmp_path):
    keeper = Autosave(session, tmp_path)
    session.add()
    assert keeper.tick(at_once=True)
    assert keeper.path.exists()


def test_a_folder_that_cannot_be_written_to_is_named(session, tmp_path, monkeypatch):
    monkeypatch.setattr(autosave, "_AFTER", 0.0)
    (tmp_path / "file").write_text("")
    keeper = Autosave(session, tmp_path / "file")
    session.add()
    assert keeper.tick()
    assert keeper.words.startswith("not autosaved: ")
