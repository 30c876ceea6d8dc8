from types import SimpleNamespace

import pytest

pytest.importorskip("viser", reason="the extra plat-rl[studio] is not installed")
pytest.importorskip("mink", reason="the extra plat-rl[studio] is not installed")

from plat.studio.dock import Dock
from plat.studio.page import Page


@pytest.fixture
def page() -> Page:
    return Page(SimpleNamespace(gui=None), None, None, Dock(print))


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
