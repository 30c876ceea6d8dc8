import asyncio
from types import SimpleNamespace

import pytest

pytest.importorskip("viser", reason="the extra plat-rl[studio] is not installed")
pytest.importorskip("mink", reason="the extra plat-rl[studio] is not installed")

from plat.studio.desk import Desk
from plat.studio.dock import Dock
from plat.studio.page import Page
from plat.studio.panels import PlayPanel
from plat.studio.policy_playback import nobody


@pytest.fixture
def page() -> Page:
    return Page(SimpleNamespace(gui=None), None, None, Dock(print))


class Slider:
    """An input of viser's: it shows a value, and calls back when a browser has changed it."""

    def __init__(self) -> None:
        self.value = 0.0

    def on_update(self, called) -> None:
        self.called = called

    def slide(self, value: float) -> None:
        self.value = value
        asyncio.run(self.called(SimpleNamespace(client="a browser", target=self)))


def test_values_are_read_as_they_were_given_however_late(page):
    slider, read = Slider(), []
    page.desk = desk = Desk(lambda _: None, lambda: desk.stop(), pytest.fail, 10.0)
    page.when_changed(slider, read.append)
    for value in (0.1, 0.2):
        slider.slide(value)
    desk.ask(lambda: read.append("another keyframe"))
    desk.ask(lambda: page.fill(slider, 0.2))  # what the keyframe has, while the user slides on
    slider.slide(0.5)
    assert slider.value == 0.5
    desk.run()
    assert read == [0.2, "another keyframe", 0.5]
    assert slider.value == 0.5
    page.fill(slider, 0.3)
    assert slider.value == 0.3, "all was read"


def test_a_task_waits_for_the_users_agreement(page):
    done = []
    page.ask("Replace?", "It is there.", "Replace", lambda: done.append("replaced"))
    question = page.dock.state["question"]
    assert (question["title"], question["text"], question["yes"]) == ("Replace?", "It is there.", "Replace")
    page.answer({"do": "answer", "id": question["id"], "yes": True})
    assert done == ["replaced"]
    assert page.dock.state["question"] is None
    page.answer({"do": "answer", "id": question["id"], "yes": True})
    assert done == ["replaced"], "once"


def test_a_run_that_is_called_nobody_can_play_beside():
    chosen: list[str | None] = []
    panel = SimpleNamespace(_alone=nobody(["nobody"]), _playback=SimpleNamespace(set_beside=chosen.append))
    for name in ("nobody", "nobody else"):
        PlayPanel._set_beside(panel, name)
    assert chosen == ["nobody", None]


@pytest.mark.parametrize("yes", [False, None, "yes", 1])
def test_anything_but_agreement_is_none(page, yes: object):
    page.ask("Replace?", "", "Replace", lambda: pytest.fail("nobody agreed"))
    page.answer({"do": "answer", "id": page.dock.state["question"]["id"], "yes": yes})
    assert page.dock.state["question"] is None


def test_an_answer_to_an_earlier_question_is_ignored(page):
    done = []
    page.ask("First?", "", "Yes", lambda: done.append("first"))
    first = page.dock.state["question"]["id"]
    page.ask("Second?", "", "Yes", lambda: done.append("second"))
    page.answer({"do": "answer", "id": first, "yes": True})
    assert done == []
    page.answer({"do": "answer", "id": page.dock.state["question"]["id"], "yes": True})
    assert done == ["second"]
