"""Dock: the studio's own part of the page, with timeline and keyboard, beside the scene that viser draws."""

import asyncio
import gzip
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

__all__ = ["Dock", "Message"]

Message = dict[str, Any]
"""What a user did: ``do`` names it, other entries belong to it."""

_WEB = Path(__file__).parent / "web"
_TYPES = {".js": "text/javascript; charset=utf-8", ".css": "text/css; charset=utf-8", ".svg": "image/svg+xml"}
_CHANNEL = "/dock"
_MOST_NOTES = 6
_MOST_BYTES = 100_000


class Dock:
    """Own part of the page: files that are added to viser's page, and a websocket that keeps them up to date.

    The state is a dictionary of JSON values. A browser gets all of it when it connects, and after that what has
    changed. Values that change faster than a browser takes them are left out.

    Args:
        receive: given what a user did, on the server's thread.

    >>> dock = Dock(print)
    >>> dock.show("time", 0.5)
    >>> dock.state["time"]
    0.5
    """

    def __init__(self, receive: Callable[[Message], None]):
        self._receive = receive
        # what a page that comes back from a studio before would go on showing
        self.state: dict[str, Any] = {"notes": [], "busy": [], "question": None}
        """All that a browser is told."""
        self._waiting: dict[Any, tuple[asyncio.AbstractEventLoop, asyncio.Event, set[str]]] = {}
        self._notes = 0

    def show(self, key: str, value: Any) -> None:
        """Set an entry of the state."""
        if self.state.get(key) == value:
            return
        self.state[key] = value
        for loop, event, changed in list(self._waiting.values()):
            changed.add(key)
            try:
                loop.call_soon_threadsafe(event.set)
            except RuntimeError:  # the server has stopped
                return

    def note(self, title: str, text: str, kind: str = "info") -> None:
        """Show a message for some seconds.

        Args:
            title: a few words.
            text: one sentence.
            kind: ``"info"``, ``"good"`` or ``"error"``.
        """
        self._notes += 1
        note = {"id": self._notes, "title": title, "text": text, "kind": kind}
        self.show("notes", [*self.state["notes"], note][-_MOST_NOTES:])

    def page(self, html: bytes) -> bytes:
        """Return viser's page with the dock in it."""
        head = (
            '<link rel="icon" href="/dock/icon.svg"/><link rel="stylesheet" href="/dock/dock.css"/>'
            '<script src="/dock/early.js"></script><script defer src="/dock/handles.js"></script>'
            '<script defer src="/dock/dock.js"></script>'
        )
        text = html.decode()
        # the compressed rest is not looked into
        begin, mark, rest = text.partition("<title>Viser</title>")
        if not mark:
            begin, mark, rest = text.partition("</head>")
            return f"{begin}{head}{mark}{rest}".encode()
        icon, end = begin.find("<link"), begin.find("/>", begin.find("<link"))
        if icon >= 0:
            begin = begin[:icon] + begin[end + 2 :]
        return f"{begin}<title>plat keyframe studio</title>{head}{rest}".encode()

    def file(self, path: str) -> tuple[str, bytes] | None:
        """Return content type and content of a file of the dock; None for other paths."""
        name = urlsplit(path).path
        if not name.startswith(_CHANNEL + "/"):
            return None
        name = name.removeprefix(_CHANNEL + "/")
        known = {file.name: file for file in _WEB.iterdir()}
        if name not in known or known[name].suffix not in _TYPES:
            return None
        return _TYPES[known[name].suffix], known[name].read_bytes()

    def is_channel(self, path: str) -> bool:
        """Return whether a path is that of the websocket."""
        return urlsplit(path).path == _CHANNEL

    async def serve(self, connection: Any) -> None:
        """Serve one browser until it leaves."""
        from websockets.exceptions import ConnectionClosed

        event, changed = asyncio.Event(), set(self.state)
        event.set()
        self._waiting[connection] = asyncio.get_running_loop(), event, changed
        sender = asyncio.create_task(self._send(connection, event, changed))
        try:
            async for text in connection:
                self._read(text)
        except ConnectionClosed:
            pass
        finally:
            del self._waiting[connection]
            sender.cancel()

    async def _send(self, connection: Any, event: asyncio.Event, changed: set[str]) -> None:
        while True:
            await event.wait()
            event.clear()
            keys = list(changed)
            changed.difference_update(keys)
            await connection.send(json.dumps({key: self.state[key] for key in keys}))

    def _read(self, text: Any) -> None:
        if not isinstance(text, str) or len(text) > _MOST_BYTES:
            return
        try:
            message = json.loads(text)
        except ValueError:
            return
        except RecursionError:
            self.note("That did not work", "a message is nested too deeply, expected an object of values", "error")
            return
        if isinstance(message, dict) and isinstance(message.get("do"), str):
            self._receive(message)


def unzipped(body: bytes, encoding: str | None) -> bytes:
    """Return the content of a response."""
    return gzip.decompress(body) if encoding == "gzip" else body
