"""Page context that panels share: server, session, and helpers for inputs, buttons and messages."""

from collections.abc import Callable, Mapping
from threading import Lock
from typing import Any

import viser

from plat.studio.desk import Desk, Task
from plat.studio.dock import Dock, Message
from plat.studio.session import Session

__all__ = ["Page"]


class Page:
    """Viser server with the session that it shows.

    Args:
        server: the server.
        session: the session.
        desk: does what the page is asked for.
        dock: the studio's own part of the page.
    """

    def __init__(self, server: viser.ViserServer, session: Session, desk: Desk, dock: Dock):
        self.server = server
        self.gui = server.gui
        self.session = session
        self.desk = desk
        self.dock = dock
        self._lock = Lock()
        self._questions = 0
        self._agreed: Task | None = None
        self._unread: dict[int, object] = {}

    def when_changed(self, handle: viser.GuiInputHandle[Any], task: Callable[[Any], None] | None = None) -> None:
        """Run a task, and update the page, when a user has changed an input.

        Args:
            handle: the input.
            task: given the input's new value; None where only the page changes.
        """

        # asynchronous callbacks come in the order of the events, others do not
        async def called(event: viser.GuiEvent[Any]) -> None:
            if event.client is None:  # values that the studio itself sets call back as well
                return
            value = event.target.value  # when its turn comes, the input may show something else
            self._unread[id(handle)] = mark = object()

            def read() -> None:
                if self._unread.get(id(handle)) is mark:
                    del self._unread[id(handle)]
                if task is not None:
                    task(value)

            self.desk.ask(read, id(handle))

        handle.on_update(called)

    def fill(self, handle: viser.GuiInputHandle[Any], value: Any) -> None:
        """Show a value in an input, unless a user has changed it since: that is yet to be read."""
        if id(handle) not in self._unread and handle.value != value:
            handle.value = value

    def buttons(self, label: str, tasks: Mapping[str, Task]) -> None:
        """Add a row of buttons, each with its task."""
        row = self.gui.add_button_group(label, tuple(tasks))

        async def called(event: viser.GuiEvent[Any]) -> None:
            self.desk.ask(tasks[event.target.value])

        row.on_click(called)

    def button(self, label: str, task: Task, **look: Any) -> viser.GuiButtonHandle:
        """Add a button with its task."""
        button = self.gui.add_button(label, **look)

        async def called(_: object) -> None:
            self.desk.ask(task)

        button.on_click(called)
        return button

    def slow_button(self, label: str, work: Callable[[], Task], waits: str, **look: Any) -> viser.GuiButtonHandle:
        """Add a button with slow work, see :meth:`Desk.ask_elsewhere`.

        Until the work is done the page says that it waits, and the button cannot be clicked again.

        Args:
            label: of the button.
            work: is run on another thread; the task that it returns is run on the desk's.
            waits: what the page says meanwhile.
            look: of the button.
        """
        button = self.gui.add_button(label, **look)

        async def called(_: object) -> None:
            self.start(work, waits, button)

        button.on_click(called)
        return button

    def start(self, work: Callable[[], Task], waits: str, button: viser.GuiButtonHandle) -> None:
        """Start the slow work of a button, unless it is on."""
        if button.disabled:
            return
        button.disabled = True
        self.wait(waits)

        def guarded() -> Task:
            try:
                return work()
            finally:
                button.disabled = False
                self.wait_no_more(waits)

        self.desk.ask_elsewhere(guarded)

    def wait(self, text: str) -> None:
        """Say that the page waits for something."""
        with self._lock:
            self.dock.show("busy", [*self.dock.state.get("busy", []), text])

    def wait_no_more(self, text: str) -> None:
        """Take back what :meth:`wait` said."""
        with self._lock:
            busy = list(self.dock.state.get("busy", []))
            busy.remove(text)
            self.dock.show("busy", busy)

    def ask(self, title: str, text: str, yes: str, task: Task) -> None:
        """Ask the user, and run a task when they agree; a later question takes an earlier one's place.

        Args:
            title: the question in a few words.
            text: what is at stake, in a sentence.
            yes: label of the button that agrees.
            task: what is done then.
        """
        self._questions += 1
        self._agreed = task
        self.dock.show("question", {"id": self._questions, "title": title, "text": text, "yes": yes})

    def answer(self, message: Message) -> None:
        """Take a user's answer, unless it is that to an earlier question."""
        if self._agreed is None or message.get("id") != self._questions:
            return
        task, self._agreed = self._agreed, None
        self.dock.show("question", None)
        if message.get("yes") is True:
            task()

    def notify(self, title: str, text: str, kind: str = "info") -> None:
        """Show a message; ``kind`` is ``"info"``, ``"good"`` or ``"error"``."""
        self.dock.note(title, text, kind)
