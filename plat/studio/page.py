"""Page context that panels share: server, session, and helpers for inputs, buttons and messages."""

from collections.abc import Mapping
from typing import Any

import viser

from plat.studio.desk import Desk, Task
from plat.studio.session import Session

__all__ = ["Page"]


class Page:
    """Viser server with the session that it shows.

    Args:
        server: the server.
        session: the session.
        desk: does what the page is asked for.
    """

    def __init__(self, server: viser.ViserServer, session: Session, desk: Desk):
        self.server = server
        self.gui = server.gui
        self.session = session
        self.desk = desk

    def when_changed(self, handle: viser.GuiInputHandle[Any], task: Task | None = None) -> None:
        """Run a task, and update the page, when a user has changed an input.

        Args:
            handle: the input.
            task: reads the input's new value; None where only the page changes.
        """
        task = task or _nothing

        # asynchronous callbacks come in the order of the events, others do not
        async def called(event: viser.GuiEvent[Any]) -> None:
            if event.client is not None:  # values that the studio itself sets call back as well
                self.desk.ask(task, once=True)

        handle.on_update(called)

    def buttons(self, label: str, tasks: Mapping[str, Task]) -> None:
        """Add a row of buttons, each with its task."""
        row = self.gui.add_button_group(label, tuple(tasks))

        async def called(event: viser.GuiEvent[Any]) -> None:
            self.desk.ask(tasks[event.target.value])

        row.on_click(called)

    def key(self, label: str, key: Any, task: Task, modifier: Any = None) -> None:
        """Bind a key to what a button does; the list of commands shows it as well."""

        async def called(_: viser.CommandEvent) -> None:
            self.desk.ask(task)

        self.gui.add_command(label, hotkey=key, modifier=modifier).on_trigger(called)

    def notify(self, title: str, text: str, color: str = "blue") -> None:
        """Show a message to everybody who has the page open."""
        for client in self.server.get_clients().values():
            client.add_notification(title, text, auto_close_seconds=8.0, color=color)


def _nothing() -> None:
    """Do nothing: a task for changes that only need to be shown."""
