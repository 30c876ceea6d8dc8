"""Access control of the studio: checks of Host, Origin and token on every request."""

import hmac
import http
import secrets
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from http.cookies import CookieError, SimpleCookie
from typing import Any
from unittest import mock
from urllib.parse import parse_qs, urlsplit

from plat.studio.dock import Dock, unzipped

__all__ = ["Access", "guarded_server"]

_LOCAL = ("127.0.0.1", "localhost", "::1")
_ANY = ("", "0.0.0.0")
_COOKIE = "plat_studio_token"


class Access:
    """Access rule for requests to the studio.

    The page can write files, so it is restricted to this machine's user. Other web pages in the same browser can reach
    local ports. Their requests carry a foreign ``Origin`` or, by DNS rebinding, a foreign ``Host``; both are refused.
    A studio that listens beyond this machine also asks for a token.

    Args:
        host: address that the studio listens on.
        port: port that the studio listens on.

    >>> Access("127.0.0.1", 8080).refusal("/", {"Host": "localhost:8080"}) is None
    True
    >>> Access("127.0.0.1", 8080).refusal("/", {"Host": "evil.example:8080"})
    "Host is 'evil.example:8080', expected localhost:8080"
    """

    def __init__(self, host: str, port: int):
        self._port = port
        self._host = "localhost" if host in (*_LOCAL, *_ANY) else host
        self._local = host in _LOCAL
        self.token: str | None = None if self._local else secrets.token_urlsafe(16)
        """What visitors must know; None where only this machine can reach the studio."""

    @property
    def url(self) -> str:
        """Return the address to open in a browser of this machine."""
        return f"http://{self._host}:{self._port}/" + (f"?token={self.token}" if self.token else "")

    def refusal(self, path: str, headers: Mapping[str, str]) -> str | None:
        """Return why a request is not let in, or None for one that is.

        Args:
            path: of the request, with its query.
            headers: of the request.
        """
        host = headers.get("Host", "")
        name, colon, port = host.rpartition(":")
        if not colon or port.endswith("]"):
            name, port = host, "80"  # browsers leave out the usual one
        if self._local and (name.strip("[]") not in _LOCAL or port != str(self._port)):
            return f"Host is {host!r}, expected localhost:{self._port}"
        origin = headers.get("Origin")
        if origin is not None and urlsplit(origin).netloc != host:
            return f"Origin is {origin!r}, expected the studio's own page"
        if self.token is not None and not any(
            hmac.compare_digest(known.encode(), self.token.encode())
            for known in (_query_token(path), _cookie_token(headers))
        ):
            return "no valid token: open the address that the studio printed when it started"
        return None

    @property
    def cookie(self) -> str | None:
        """Return the value of the ``Set-Cookie`` header that stores the token; None where there is none."""
        return None if self.token is None else f"{_COOKIE}={self.token}; HttpOnly; SameSite=Strict; Path=/"


def _query_token(path: str) -> str:
    return parse_qs(urlsplit(path).query).get("token", [""])[0]


def _cookie_token(headers: Mapping[str, str]) -> str:
    try:
        morsel = SimpleCookie(headers.get("Cookie", "")).get(_COOKIE)
    except CookieError:
        return ""
    return "" if morsel is None else morsel.value


@contextmanager
def guarded_server(access: Access, dock: Dock | None = None) -> Iterator[None]:
    """Make the viser server started in this context check every request with ``access``, pages and websockets alike.

    viser has no hook for this. It passes its own handlers to ``websockets``; here they are wrapped.

    Args:
        access: the check.
        dock: is added to the page, and has files and a websocket of its own.
    """
    import websockets.asyncio.server as websockets_server
    from websockets.datastructures import Headers
    from websockets.http11 import Response

    serve = websockets_server.serve

    def guarded(handler: Any, *args: Any, process_request: Any = None, **kwargs: Any) -> Any:
        async def routed(connection: Any) -> None:
            if dock is not None and dock.is_channel(connection.request.path):
                await dock.serve(connection)
            else:
                await handler(connection)

        def page(kind: str, body: bytes) -> Any:
            headers = Headers({"Content-Type": kind, "Content-Length": str(len(body)), "Cache-Control": "no-cache"})
            return Response(http.HTTPStatus.OK.value, "OK", headers, body)

        def checked(connection: Any, request: Any) -> Any:
            reason = access.refusal(request.path, request.headers)
            if reason is not None:
                body = f"The studio refuses this request: {reason}\n".encode()
                headers = Headers({"Content-Type": "text/plain; charset=utf-8", "Content-Length": str(len(body))})
                return Response(http.HTTPStatus.FORBIDDEN.value, "Forbidden", headers, body)
            file = None if dock is None else dock.file(request.path)
            if file is not None:
                return page(*file)
            response = None if process_request is None else process_request(connection, request)
            if dock is not None and response is not None and "html" in response.headers.get("Content-Type", ""):
                body = dock.page(unzipped(response.body, response.headers.get("Content-Encoding")))
                response = page("text/html; charset=utf-8", body)
            if response is not None and access.cookie is not None:
                response.headers["Set-Cookie"] = access.cookie
            return response

        return serve(routed, *args, process_request=checked, **kwargs)

    with mock.patch.object(websockets_server, "serve", guarded):
        yield
