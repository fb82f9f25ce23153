"""The security layer of the page: plain ASGI, in front of everything, for HTTP and WebSocket alike.

It checks the Host and Origin headers and the token, limits the size of a body and the rate of messages, and adds the
headers that forbid a browser to load anything from elsewhere. It knows nothing of NiceGUI.
"""

from __future__ import annotations

import asyncio
import hmac
import time
from collections.abc import Awaitable, Callable, MutableMapping
from dataclasses import dataclass
from typing import Any, TypeAlias
from urllib.parse import parse_qsl, quote, urlencode

from markerseek.core import ConfigError

Scope: TypeAlias = MutableMapping[str, Any]
Message: TypeAlias = MutableMapping[str, Any]
Receive: TypeAlias = Callable[[], Awaitable[Message]]
Send: TypeAlias = Callable[[Message], Awaitable[None]]
App: TypeAlias = Callable[[Scope, Receive, Send], Awaitable[None]]

BODY_BYTES = 64 * 1024
"""Largest body of a request, and largest message of a WebSocket, in bytes."""

MESSAGES, PER_S = 400, 10.0
"""Most messages that one WebSocket may send within that many seconds."""

REFUSAL_S = 0.25
"""Time until a refusal is sent, in seconds: a flood of requests from few connections then costs little."""

TOKEN_PARAMETER = "token"  # noqa: S105  the name of the parameter, not a token
"""Name of the query parameter of the first link that holds the token."""

_TUNNEL = (
    "through a tunnel (ssh -L, VS Code) start markerseek page with --public-url and the address in the browser, as in "
    "--public-url http://localhost:9000"
)

_SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})

_HEADERS = (
    # NiceGUI compiles its templates in the browser, hence the two "unsafe" words; nothing comes from elsewhere.
    (
        b"content-security-policy",
        (
            b"default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
            b"img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self'; frame-ancestors 'none'; "
            b"form-action 'none'; base-uri 'none'; object-src 'none'"
        ),
    ),
    (b"referrer-policy", b"no-referrer"),
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Access:
    """Who may open the page."""

    token: str
    """Secret of this page, at least 16 characters."""
    hosts: frozenset[str]
    """Values of the Host header that are accepted, with the port: ``127.0.0.1:8765``."""
    scheme: str
    """``http``, or ``https`` where the page has a certificate."""
    cookie: str
    """Name of the cookie that holds the token; cookies are shared by all ports of a host, so it names the port."""
    public: str | None = None
    """Origin under which a browser behind a tunnel sees the page: ``http://localhost:9000``."""

    def __post_init__(self) -> None:
        if len(self.token) < 16:
            raise ConfigError(f"token: it has {len(self.token)} characters, at least 16 are needed")
        if self.scheme not in {"http", "https"}:
            raise ConfigError(f"scheme is {self.scheme!r}, it must be http or https")

    @property
    def origins(self) -> frozenset[str]:
        """Values of the Origin header that are accepted."""
        return frozenset(f"{self.scheme}://{host}" for host in self.hosts) | ({self.public} if self.public else set())

    def is_host(self, host: str) -> bool:
        """Whether a value of the Host header is accepted."""
        return host in self.hosts or (self.public is not None and host == self.public.partition("://")[2])


class SecurityLayer:
    """An ASGI application that lets a request through to another one, or refuses it.

    ``access``: who may open the page. ``now_s``: monotonic clock, for the rate of messages. ``refusal_s``: time until a
    refusal is sent. ``on_token``: called with address and port of a client that has shown the token. ``admits``:
    whether the client of that address and port may open the page without the token, which it then gets.
    """

    def __init__(
        self,
        app: App,
        access: Access,
        *,
        now_s: Callable[[], float] = time.monotonic,
        refusal_s: float = REFUSAL_S,
        on_token: Callable[[tuple[str, int]], None] = lambda _: None,
        admits: Callable[[tuple[str, int]], bool] = lambda _: False,
    ) -> None:
        self._on_token, self._admits = on_token, admits
        self._refusal_s = refusal_s
        # Public: NiceGUI finds its server by following this attribute.
        self.app = app
        self._access = access
        self._now_s = now_s

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request, one WebSocket, or the start and end of the server."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        headers = _headers(scope)
        client = scope.get("client") or ("", 0)
        refusal = self._foreign(scope, headers)
        holds_token = self._holds_token(headers)
        if refusal is None and scope["type"] == "http" and scope["method"] == "GET":
            given = dict(parse_qsl(scope["query_string"].decode("latin-1"))).get(TOKEN_PARAMETER, "")
            # Also where the cookie is there already: the token must not stay in the address.
            if self._is_token(given) or (not holds_token and self._admits(client)):
                self._on_token(client)
                await self._set_cookie(scope, send)
                return
        if refusal is None and not holds_token:
            refusal = "open the link that markerseek page printed in the terminal"
        if refusal is None:
            self._on_token(client)
        if refusal is not None:
            await asyncio.sleep(self._refusal_s)
            await _refuse(scope, send, 403, refusal)
        elif scope["type"] == "websocket":
            await self.app(scope, _limited(receive, send, self._now_s), send)
        elif _too_large(headers):
            await _refuse(scope, send, 413, f"the body has more than {BODY_BYTES} bytes")
        else:
            await self.app(scope, _capped(receive), _with_headers(send))

    def _foreign(self, scope: Scope, headers: dict[bytes, list[bytes]]) -> str | None:
        """Why a request does not come from a page of ours; None if it does."""
        hosts, origins = headers.get(b"host", []), headers.get(b"origin", [])
        if len(hosts) != 1 or not self._access.is_host(hosts[0].decode("latin-1")):
            return f"the Host header is not the address of this page; {_TUNNEL}"
        if any(origin.decode("latin-1") not in self._access.origins for origin in origins):
            return f"the Origin header is not the address of this page; {_TUNNEL}"
        needs_origin = scope["type"] == "websocket" or scope["method"] not in _SAFE_METHODS
        return "the Origin header is missing" if needs_origin and not origins else None

    def _holds_token(self, headers: dict[bytes, list[bytes]]) -> bool:
        pairs = (
            pair.strip().partition("=")
            for line in headers.get(b"cookie", [])
            for pair in line.decode("latin-1").split(";")
        )
        return any(name == self._access.cookie and self._is_token(value) for name, _, value in pairs)

    def _is_token(self, given: str) -> bool:
        return hmac.compare_digest(given.encode(), self._access.token.encode())

    async def _set_cookie(self, scope: Scope, send: Send) -> None:
        """Answer the first link: the token goes from the address into a cookie that scripts cannot read."""
        rest = [pair for pair in parse_qsl(scope["query_string"].decode("latin-1")) if pair[0] != TOKEN_PARAMETER]
        # The path as one of this host: for a browser "//elsewhere" would be another one, and so "/\\elsewhere".
        location = "/" + quote(scope["path"].lstrip("/")) + (f"?{urlencode(rest)}" if rest else "")
        secure = "; Secure" if self._access.scheme == "https" else ""
        cookie = f"{self._access.cookie}={self._access.token}; HttpOnly; SameSite=Strict; Path=/{secure}"
        sent = [(b"location", location.encode()), (b"set-cookie", cookie.encode())]
        await _answer(send, 303, "", [*sent, (b"cache-control", b"no-store")])


def _limited(receive: Receive, send: Send, now_s: Callable[[], float]) -> Receive:
    """The messages that a WebSocket receives, closed where they come too fast."""
    since_s, count = now_s(), 0

    async def limited() -> Message:
        nonlocal since_s, count
        message = await receive()
        if message["type"] != "websocket.receive":
            return message
        if now_s() - since_s > PER_S:
            since_s, count = now_s(), 0
        count += 1
        if count > MESSAGES:
            await send({"type": "websocket.close", "code": 1008, "reason": "too many messages"})
            return {"type": "websocket.disconnect", "code": 1008}
        return message

    return limited


def _headers(scope: Scope) -> dict[bytes, list[bytes]]:
    found: dict[bytes, list[bytes]] = {}
    for name, value in scope["headers"]:
        found.setdefault(name.lower(), []).append(value)
    return found


def _too_large(headers: dict[bytes, list[bytes]]) -> bool:
    lengths = headers.get(b"content-length", [])
    return any(not length.isdigit() or int(length) > BODY_BYTES for length in lengths)


def _capped(receive: Receive) -> Receive:
    """The body of a request, cut off where it is longer than it said or is allowed."""
    received = 0

    async def capped() -> Message:
        nonlocal received
        message = await receive()
        received += len(message.get("body", b""))
        return {"type": "http.disconnect"} if received > BODY_BYTES else message

    return capped


def _with_headers(send: Send) -> Send:
    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", []), *_HEADERS]}
        await send(message)

    return sending


async def _refuse(scope: Scope, send: Send, status: int, reason: str) -> None:
    if scope["type"] == "websocket":
        # Before the handshake is accepted, the server answers with status 403.
        await send({"type": "websocket.close", "code": 1008, "reason": reason})
    else:
        await _answer(send, status, f"markerseek: {reason}\n", [])


async def _answer(send: Send, status: int, text: str, headers: list[tuple[bytes, bytes]]) -> None:
    body = text.encode()
    sent = [*headers, (b"content-type", b"text/plain; charset=utf-8"), (b"content-length", str(len(body)).encode())]
    await send({"type": "http.response.start", "status": status, "headers": [*sent, *_HEADERS]})
    await send({"type": "http.response.body", "body": body})
