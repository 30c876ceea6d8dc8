import asyncio
import json

import pytest

from plat.studio.dock import Dock


def test_its_files_are_added_to_the_page():
    page = b"<html><head><link rel=icon href='data:,'/><title>Viser</title></head><body></body></html>"
    changed = Dock(print).page(page).decode()
    assert "<title>plat keyframe studio</title>" in changed
    assert changed.count("icon") == 2, "viser's own is gone"
    assert '/dock/dock.js"' in changed
    assert "/dock/dock.css" in Dock(print).page(b"<html><head></head></html>").decode()


@pytest.mark.parametrize("name", ["dock.js", "dock.css", "icon.svg"])
def test_its_files_are_served(name: str):
    kind, content = Dock(print).file(f"/dock/{name}?v=1")
    assert content
    assert kind.startswith(("text/", "image/"))


@pytest.mark.parametrize("path", ["/", "/dock", "/dock/", "/dock/../dock.py", "/dock/nothing.js", "/dock/%2e%2e/a.py"])
def test_other_files_are_not(path: str):
    assert Dock(print).file(path) is None


class Connection:
    """A browser that says something and leaves."""

    def __init__(self, *said: str):
        self.said, self.told = said, []

    async def send(self, text: str) -> None:
        self.told.append(json.loads(text))

    async def __aiter__(self):
        for text in self.said:
            await asyncio.sleep(0.01)
            yield text
        await asyncio.sleep(0.05)


def test_a_browser_is_told_all_and_then_what_changes():
    received = []
    dock = Dock(received.append)
    dock.show("time", 1)
    connection = Connection('{"do": "add"}', "nonsense", "[1]", '{"do": 3}', '{"do": "seek", "time": 2}')

    async def visit() -> None:
        serving = asyncio.create_task(dock.serve(connection))
        await asyncio.sleep(0.02)
        dock.show("time", 2)
        dock.show("time", 2)
        await serving

    asyncio.run(visit())
    assert received == [{"do": "add"}, {"do": "seek", "time": 2}]
    # nothing waits and nothing is asked: a page that comes back may still show what the studio before did
    assert connection.told == [{"notes": [], "busy": [], "question": None, "time": 1}, {"time": 2}]
    dock.show("time", 3)  # to nobody


def test_messages_are_kept_for_a_while():
    dock = Dock(print)
    for number in range(9):
        dock.note("hello", str(number), "good")
    assert [note["id"] for note in dock.state["notes"]] == [4, 5, 6, 7, 8, 9]


def test_a_message_that_is_nested_too_deeply_is_answered_and_the_next_one_heard():
    received = []
    dock = Dock(received.append)
    asyncio.run(dock.serve(Connection("[" * 90_000, '{"do": "add"}')))
    assert received == [{"do": "add"}]
    (note,) = dock.state["notes"]
    assert (note["kind"], note["text"]) == (
        "error",
        "a message is nested too deeply, expected an object of values",
    )
