import asyncio

import pytest

from plat.studio.access import Access, guarded_server

PAGE = {"Host": "127.0.0.1:8080"}


@pytest.mark.parametrize("host", ["127.0.0.1:8080", "localhost:8080", "[::1]:8080"])
def test_the_person_at_this_machine_is_let_in(host: str) -> None:
    access = Access("127.0.0.1", 8080)
    assert access.token is None
    assert access.cookie is None
    assert access.url == "http://localhost:8080/"
    assert access.refusal("/", {"Host": host}) is None
    assert access.refusal("/", {"Host": host, "Origin": f"http://{host}"}) is None


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "[::1]", "localhost:80"])
def test_browsers_leave_out_port_80(host: str) -> None:
    access = Access("127.0.0.1", 80)
    assert access.refusal("/", {"Host": host}) is None
    assert access.refusal("/", {"Host": host, "Origin": f"http://{host}"}) is None
    assert access.refusal("/", {"Host": f"evil.{host}"}) is not None
    assert access.refusal("/", {"Host": "localhost:8080"}) is not None


@pytest.mark.parametrize(
    "headers",
    [
        {},
        {"Host": "evil.example:8080"},
        {"Host": "localhost.evil.example:8080"},
        {"Host": "localhost:9000"},
        {"Host": "localhost"},
        {"Host": "[::1]"},
        {"Host": "[::1]:80"},
    ],
)
def test_a_foreign_host_is_refused(headers: dict[str, str]) -> None:
    reason = Access("127.0.0.1", 8080).refusal("/", headers)
    assert reason is not None
    assert "Host" in reason


@pytest.mark.parametrize("origin", ["https://evil.example", "http://localhost:3000", "null", ""])
def test_another_page_of_the_same_browser_is_refused(origin: str) -> None:
    reason = Access("127.0.0.1", 8080).refusal("/", PAGE | {"Origin": origin})
    assert reason is not None
    assert "Origin" in reason


@pytest.mark.parametrize(
    ("host", "there"),
    [("127.0.0.1", "localhost"), ("0.0.0.0", "localhost"), ("", "localhost"), ("192.168.1.5", "192.168.1.5")],
)
def test_the_address_that_is_printed_leads_to_the_studio(host: str, there: str) -> None:
    assert Access(host, 8080).url.startswith(f"http://{there}:8080/")


def test_beyond_this_machine_a_token_is_asked_for() -> None:
    access = Access("0.0.0.0", 8080)
    assert access.token is not None
    headers = {"Host": "192.168.1.5:8080"}
    for path in ("/", "/?token=", "/?token=wrong", f"/?other={access.token}"):
        assert "token" in str(access.refusal(path, headers))
    assert access.refusal(f"/?token={access.token}", headers) is None
    assert access.cookie is not None
    remembered = headers | {"Cookie": access.cookie.partition(";")[0]}
    assert access.refusal("/assets/index.js", remembered) is None
    assert "Origin" in str(access.refusal("/", remembered | {"Origin": "https://evil.example"}))
    assert Access("0.0.0.0", 8080).token != access.token


def test_a_server_refuses_pages_and_websockets_alike() -> None:
    server_module = pytest.importorskip("websockets.asyncio.server")
    client = pytest.importorskip("websockets.asyncio.client")
    from websockets.exceptions import InvalidStatus

    original = server_module.serve
    access = Access("0.0.0.0", 8080)

    async def echo(connection) -> None:
        async for message in connection:
            await connection.send(message)

    async def visit() -> None:
        with guarded_server(access):
            serving = server_module.serve(echo, "127.0.0.1", 0)
        async with serving as server:
            port = server.sockets[0].getsockname()[1]
            with pytest.raises(InvalidStatus, match="403"):
                async with client.connect(f"ws://127.0.0.1:{port}/"):
                    pass
            async with client.connect(f"ws://127.0.0.1:{port}/?token={access.token}") as connection:
                await connection.send("hello")
                assert await connection.recv() == "hello"

    asyncio.run(visit())
    assert server_module.serve is original
