import pytest

from plat.robots import G1

pytest.importorskip("mink", reason="the extra plat-rl[studio] is not installed")

from plat.studio import autosave
from plat.studio.autosave import AUTOSAVE, Autosave
from plat.studio.session import Session
from plat.studio.timeline import Timeline


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
    assert list(tmp_path.iterdir()) == []


def test_at_the_end_it_waits_for_no_rest(session, tmp_path):
    keeper = Autosave(session, tmp_path)
    session.add()
    assert keeper.tick(at_once=True)
    assert keeper.path == tmp_path / AUTOSAVE
    assert keeper.path.exists()


def test_a_folder_that_cannot_be_written_to_is_named(session, tmp_path, monkeypatch):
    monkeypatch.setattr(autosave, "_AFTER", 0.0)
    (tmp_path / "file").write_text("")
    keeper = Autosave(session, tmp_path / "file")
    session.add()
    assert keeper.tick()
    assert keeper.words.startswith("not autosaved: ")


def test_editing_without_a_pause_is_kept_as_well(session, tmp_path, monkeypatch):
    seconds = [100.0]
    monkeypatch.setattr(autosave.time, "monotonic", lambda: seconds[0])
    keeper = Autosave(session, tmp_path)
    session.add()
    written = []
    for _ in range(40):
        session.set_joint(0, 0.01 * len(written))
        seconds[0] += 1.0
        written.append(keeper.tick())
    assert written.index(True) == 15
    assert sum(written) == 2


def left_behind(policies, folder, name: str) -> None:
    """What a studio leaves that was killed."""
    former = Session(G1, policies)
    keeper = Autosave(former, folder)
    former.add()
    former.edit(former.timeline.renamed(name))
    assert keeper.tick(at_once=True)


def test_a_copy_that_was_not_restored_is_neither_deleted_nor_replaced(session, policies, tmp_path):
    left_behind(policies, tmp_path, "precious")
    before = (tmp_path / AUTOSAVE).read_bytes()
    keeper = Autosave(session, tmp_path)
    keeper.discard()
    session.add()
    assert keeper.tick(at_once=True)
    assert keeper.path == tmp_path / "keyframes.autosave.1.json"
    assert (tmp_path / AUTOSAVE).read_bytes() == before
    again = Autosave(session, tmp_path)
    assert again.former == keeper.path.read_bytes(), "the newest is proposed"
    keeper.discard()
    assert [path.name for path in tmp_path.iterdir()] == [AUTOSAVE]


def test_a_restored_copy_is_the_studios_own(session, policies, tmp_path):
    left_behind(policies, tmp_path, "precious")
    keeper = Autosave(session, tmp_path)
    session.from_json("autosave", keeper.former)
    keeper.take_over()
    session.add()
    assert keeper.tick(at_once=True)
    assert [path.name for path in tmp_path.iterdir()] == [AUTOSAVE]
    keeper.discard()
    assert list(tmp_path.iterdir()) == []


def test_a_copy_of_what_was_edited_before_a_restored_one_goes(session, policies, tmp_path):
    left_behind(policies, tmp_path, "precious")
    keeper = Autosave(session, tmp_path)
    session.add()
    assert keeper.tick(at_once=True)
    assert len([*tmp_path.iterdir()]) == 2
    session.from_json("autosave", keeper.former)
    keeper.take_over()
    assert [path.name for path in tmp_path.iterdir()] == [AUTOSAVE]
    keeper.discard()
    assert list(tmp_path.iterdir()) == []


def test_a_copy_goes_when_its_edits_are_undone_and_not_when_others_are_loaded(session, tmp_path):
    keeper = Autosave(session, tmp_path)
    session.add()
    session.save(file := tmp_path / "a.json")
    session.stand()
    assert keeper.tick(at_once=True)
    copy = keeper.path
    session.undo()
    assert keeper.tick(at_once=True), "the page is to say so"
    assert (copy.exists(), keeper.words) == (False, "")
    session.edit(Timeline.empty(G1).inserted(G1.default_qpos, 1.0))
    assert keeper.tick(at_once=True)
    session.undo()
    assert keeper.tick(at_once=True)
    assert not copy.exists(), "all keyframes were replaced, and are back"
    session.stand()
    assert keeper.tick(at_once=True)
    session.load(file)
    assert not keeper.tick(at_once=True)
    assert copy.exists(), "no file holds what was edited before"
    session.undo()
    session.new()
    assert not keeper.tick(at_once=True)
    assert copy.exists()


def test_two_studios_in_a_folder_have_copies_of_their_own(policies, tmp_path):
    sessions = [Session(G1, policies) for _ in range(2)]
    keepers = [Autosave(session, tmp_path) for session in sessions]
    for session, keeper in zip(sessions, keepers, strict=True):
        session.add()
        assert keeper.tick(at_once=True)
    copies = [keeper.path.read_bytes() for keeper in keepers]
    assert keepers[0].path != keepers[1].path
    keepers[1].discard()
    assert keepers[0].path.read_bytes() == copies[0]


def test_what_was_saved_to_the_copys_own_file_stays(session, tmp_path):
    keeper = Autosave(session, tmp_path)
    session.add()
    assert keeper.tick(at_once=True)
    session.save(path := keeper.path)
    keeper.discard()
    assert path.exists()
    session.add()
    assert keeper.tick(at_once=True)
    assert keeper.path != path, "that file is the user's now"
