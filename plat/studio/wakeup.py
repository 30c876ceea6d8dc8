"""Wake-up of viser's senders: an event that the studio's own thread may set."""

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from unittest import mock

__all__ = ["Wakeup", "threaded_buffers"]


class Wakeup(asyncio.Event):
    """Event that is set by any thread, and by the loop right after it.

    Where a waiter comes or goes while another thread sets it, asyncio's own raises, and leaves other waiters asleep.

    >>> event = Wakeup()
    >>> event.set(); event.is_set()
    True
    """

    def set(self) -> None:
        """Set the event, or leave it to the loop."""
        try:
            super().set()
        except RuntimeError:
            self.clear()


@contextmanager
def threaded_buffers() -> Iterator[None]:
    """Give the viser server that is started in this context a wake-up for messages of any thread.

    viser sets its event in the thread that queues a message, and then in its loop: the former is not safe.
    """
    from viser.infra._async_message_buffer import AsyncMessageBuffer

    begin = AsyncMessageBuffer.__init__

    def begun(self: Any, *args: Any, **kwargs: Any) -> None:
        begin(self, *args, **kwargs)
        self.message_event = Wakeup()

    with mock.patch.object(AsyncMessageBuffer, "__init__", begun):
        yield
