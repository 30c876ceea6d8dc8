import asyncio

import pytest

pytest.importorskip("viser", reason="the extra plat-rl[studio] is not installed")

import viser

from plat.studio.wakeup import Wakeup, threaded_buffers


def test_a_waiter_that_leaves_while_it_is_set_leaves_nobody_asleep():
    class Leaving:
        """A waiter that the loop's thread takes out just now."""

        def done(self) -> bool:
            event._waiters.remove(self)
            return True

    async def woken() -> int:
        waiters = [asyncio.create_task(event.wait()) for _ in range(2)]
        await asyncio.sleep(0)
        event._waiters.appendleft(Leaving())
        event.set()
        event.set()  # as viser's loop does after it
        done, _ = await asyncio.wait(waiters, timeout=5)
        return len(done)

    event = Wakeup()
    assert asyncio.run(woken()) == 2


def test_a_server_has_it():
    with threaded_buffers():
        server = viser.ViserServer(host="127.0.0.1", port=8990, verbose=False)  # or the next one that is free
    try:
        assert isinstance(server._websock_server._broadcast_buffer.message_event, Wakeup)
    finally:
        server.stop()
