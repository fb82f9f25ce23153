"""The pages as an ASGI application, and who may open them."""

from __future__ import annotations

import asyncio
import hmac
import logging
import shlex
import time
import traceback
from collections.abc import AsyncIterator, Collection
from contextlib import asynccontextmanager, suppress
from typing import Any, Literal
from urllib.parse import quote, urlencode

from fastapi import FastAPI, Request, Response, WebSocket, WebSocketDisconnect
from nicegui import Client, ui
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse, RedirectResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from markerseek.bridges.page.connections import Listener
from markerseek.bridges.page.page_searches import PageSearches
from markerseek.bridges.page.page_shell import PAGES
from markerseek.bridges.page.registration_page import build_registration_page
from markerseek.bridges.page.search_page import build_search_page
from markerseek.bridges.page.sessions_page import build_sessions_page

WATCH_S = 0.5
"""Time between two looks whether anybody watches, and who has connected, in seconds."""

STOP_PATH = "/stop"
"""Path of STOP, which is always let in."""

MAX_VIEWERS = 16
"""Most tabs that may show the page at one time."""


class Gate:
    """Lets a request or a WebSocket through if it names this page, its cookie holds the token, and it comes from there.

    ``token``: secret of this page. ``once``: secret that opens the page one time, for the browser that the page itself
    starts. ``origins``: values of the Origin header that are accepted. ``cookie``: name of the cookie that holds the
    token; cookies are shared by all ports of a host, so it names the port. ``secure``: whether the page has TLS.
    ``prefix``: path in front of all paths of the page where it is behind a proxy. ``connections``: is told which of
    them have shown the token.
    """

    def __init__(
        self,
        app: ASGIApp,
        *,
        token: str,
        once: str,
        origins: Collection[str],
        cookie: str,
        secure: bool,
        prefix: str,
        connections: Listener,
    ) -> None:
        self.app = app
        self._token = token
        self._once = once
        self._origins = origins
        self._hosts = {each.partition("://")[2] for each in origins}
        self._cookie = cookie
        self._secure = secure
        self._prefix = prefix
        self._connections = connections

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request, one WebSocket, or the start and end of the server."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        scope = self._below_prefix(scope)
        answer = self._answered(HTTPConnection(scope))
        await (answer or self.app)(scope, receive, send)

    def _below_prefix(self, scope: Scope) -> Scope:
        """Return the request with the prefix in its path: some proxies pass it on, and others take it away."""
        # Nobody but the user of the page says where it is: what is in this header would be written into it.
        headers = [each for each in scope["headers"] if each[0] != b"x-forwarded-prefix"]
        path = scope["path"]
        raw = scope.get("raw_path") or b""
        if not f"{path}/".startswith(f"{self._prefix}/"):
            path = self._prefix + path
            raw = self._prefix.encode() + raw
        return {**scope, "headers": headers, "root_path": self._prefix, "path": path, "raw_path": raw}

    def _answered(self, asked: HTTPConnection) -> Response | None:
        """Return the answer to a link or to a stranger; None for all others."""
        query = asked.query_params
        hosts = asked.headers.getlist("host")
        origins = asked.headers.getlist("origin")
        # One line each: of two, whoever is in front of the page might have judged the other.
        if len(hosts) != 1 or hosts[0].lower() not in self._hosts:
            return _refusal(f"the Host header is not the address of this page; {_TUNNEL}")
        reads = asked.scope.get("method") in {"GET", "HEAD"}
        path = asked.scope["path"].removeprefix(self._prefix) or "/"
        opened = _same(query.get("once", ""), self._once)
        if reads and (opened or _same(query.get("token", ""), self._token)):
            self._once = "" if opened else self._once
            # The token goes from the address into a cookie that scripts cannot read.
            rest = urlencode([each for each in query.multi_items() if each[0] not in {"token", "once"}])
            # The path as one of this host: for a browser "//elsewhere" would be another one.
            to = f"{self._prefix}/{quote(path.lstrip('/'))}?{rest}".rstrip("?")
            moved = RedirectResponse(to, status_code=303)
            moved.set_cookie(
                self._cookie,
                self._token,
                path=self._prefix or "/",
                httponly=True,
                samesite="strict",
                secure=self._secure,
            )
            self._admits(asked)
            return moved
        if not _same(asked.cookies.get(self._cookie, ""), self._token):
            return _refusal("open the link that the page printed in its terminal")
        if not (reads and not origins) and (len(origins) != 1 or origins[0] not in self._origins):
            return _refusal(f"the Origin header is not the address of this page; {_TUNNEL}")
        if not self._admits(asked) and path != STOP_PATH:
            return _refusal("too many connections are open; close some tabs")
        if path in PAGES and _viewers() >= MAX_VIEWERS:
            return _refusal(f"{MAX_VIEWERS} tabs show the page already; close one of them")
        return None

    def _admits(self, asked: HTTPConnection) -> bool:
        """Return whether there is room for a connection that has shown the token."""
        client = asked.client
        return client is not None and self._connections.admit((client.host, client.port))


def _same(given: str, secret: str) -> bool:
    return bool(secret) and hmac.compare_digest(given.encode(), secret.encode())


_TUNNEL = (
    "through a tunnel (ssh -L, VS Code) start the page with the address in the browser, as by markerseek "
    + shlex.join(["page", "--public-url", "http://localhost:9000"])
)


def _refusal(reason: str) -> Response:
    # Closed: a stranger is not kept.
    return PlainTextResponse(f"markerseek: {reason}\n", status_code=403, headers={"Connection": "close"})


class UnreadableMessages(logging.Filter):
    """Says once that a browser has sent what no page of ours sends, in place of a traceback for each such message.

    The libraries of the WebSocket ignore the message, or close the connection. A fault in a handler of ours is logged
    by NiceGUI, and is not meant here.
    """

    LOGGERS = ("engineio.server", "asyncio", "uvicorn.error")
    """Where these libraries report it."""

    def __init__(self) -> None:
        super().__init__()
        self._said = False

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether a record is printed; one of such a message is shortened first."""
        problem = record.exc_info[1] if record.exc_info else None
        if problem is None or not _passes_socket(problem):
            return True
        said = self._said
        self._said = True
        record.msg = "a browser sent a message that no page of markerseek sends (%s); such messages are ignored"
        record.args = (type(problem).__name__,)
        record.exc_info = None
        return not said


def _passes_socket(problem: BaseException) -> bool:
    """Return whether an error was raised where the libraries of the WebSocket read a message."""
    modules = (frame.f_globals.get("__name__", "") for frame, _ in traceback.walk_tb(problem.__traceback__))
    return any(name.partition(".")[0] in {"engineio", "socketio"} for name in modules)


def _viewers() -> int:
    return sum(client.has_socket_connection for client in Client.instances.values())


def page_application(searches: PageSearches, *, connections: Listener, **gate: Any) -> FastAPI:
    """Return the application with all pages; ``gate``: arguments of `Gate`."""

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        watching = asyncio.create_task(_look_after(searches, connections))
        yield
        watching.cancel()
        await asyncio.to_thread(searches.close)

    unreadable = UnreadableMessages()
    for name in UnreadableMessages.LOGGERS:
        logging.getLogger(name).addFilter(unreadable)
    application = FastAPI(docs_url=None, redoc_url=None, openapi_url=None, lifespan=lifespan)
    application.add_middleware(Gate, connections=connections, **gate)

    _add_stop(application, searches)

    @application.get("/camera/{side}.jpg")
    def camera(side: Literal["left", "right"]) -> Response:
        """Return the newest image of a camera in the session."""
        live = searches.registration
        path = None if live is None else live.journal / f"{side}.jpg"
        if path is None or not path.is_file():
            return Response(status_code=404)
        return Response(path.read_bytes(), media_type="image/jpeg", headers={"Cache-Control": "no-store"})

    @ui.page("/")
    def register(request: Request) -> Response | None:
        if not searches.rig.registers:
            return RedirectResponse(f"{request.scope['root_path']}/search")
        build_registration_page(searches, request.query_params)
        return None

    @ui.page("/sessions")
    def sessions(request: Request) -> Response | None:
        if not searches.rig.registers:
            return RedirectResponse(f"{request.scope['root_path']}/search")
        build_sessions_page(searches, request.query_params)
        return None

    @ui.page("/search")
    def search(request: Request) -> None:
        build_search_page(searches, request.query_params)

    ui.run_with(
        application,
        title="markerseek",
        dark=None,
        language="en-US",
        tailwind=False,
        # One beat in 0.4 s, and no bindings: nothing else has to be looked after.
        binding_refresh_interval=None,
        message_history_length=200,
        # A busy computer may hold a tab up for seconds; a tab that is closed is noticed at once.
        reconnect_timeout=10.0,
        show_welcome_message=False,
    )
    return application


def _add_stop(application: FastAPI, searches: PageSearches) -> None:
    """Add STOP to an application: as a request, and as a line that is open already."""

    @application.post(STOP_PATH)
    async def stop() -> Response:
        """Stop, by a plain request: it needs no connection of NiceGUI, and does not wait for a thread."""
        searches.stop()
        return Response(status_code=204)

    @application.websocket(STOP_PATH)
    async def stop_line(line: WebSocket) -> None:
        """STOP by a connection that each tab keeps for it: it need not wait until the page takes another one."""
        await line.accept()
        with suppress(WebSocketDisconnect):
            while True:
                await line.receive_text()
                searches.stop()
                await line.send_text("stopped")


async def _look_after(searches: PageSearches, connections: Listener) -> None:
    """Stop what nobody watches, and drop connections that do not show the token."""
    watched_s = time.monotonic()
    while True:
        await asyncio.sleep(WATCH_S)
        connections.drop_late()
        if _viewers() or not searches.busy:
            watched_s = time.monotonic()
        else:
            searches.stop_unwatched(time.monotonic() - watched_s)
