"""The pages as an ASGI application, and who may open them."""

from __future__ import annotations

import asyncio
import hmac
import time
from collections.abc import AsyncIterator, Collection
from contextlib import asynccontextmanager
from typing import Any, Literal
from urllib.parse import urlencode

from fastapi import FastAPI, Request, Response
from nicegui import Client, ui
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse, RedirectResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from markerseek.bridges.page.page_searches import PageSearches
from markerseek.bridges.page.page_shell import PAGES
from markerseek.bridges.page.registration_page import build_registration_page
from markerseek.bridges.page.search_page import build_search_page

WATCH_S = 0.5
"""Time between two looks whether anybody watches, in seconds."""

MAX_VIEWERS = 16
"""Most tabs that may show the page at one time."""


class Gate:
    """Lets a request or a WebSocket through if it names this page, its cookie holds the token, and it comes from there.

    ``token``: secret of this page. ``once``: secret that opens the page one time, for the browser that the page itself
    starts. ``origins``: values of the Origin header that are accepted. ``cookie``: name of the cookie that holds the
    token; cookies are shared by all ports of a host, so it names the port. ``secure``: whether the page has TLS.
    """

    def __init__(
        self, app: ASGIApp, *, token: str, once: str, origins: Collection[str], cookie: str, secure: bool
    ) -> None:
        self.app = app
        self._token, self._once, self._origins, self._cookie, self._secure = token, once, origins, cookie, secure
        self._hosts = {each.partition("://")[2] for each in origins}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request, one WebSocket, or the start and end of the server."""
        answer = None if scope["type"] == "lifespan" else self._answered(HTTPConnection(scope))
        await (answer or self.app)(scope, receive, send)

    def _answered(self, asked: HTTPConnection) -> Response | None:
        """The answer to a link or to a stranger; None for all others."""
        query, origin = asked.query_params, asked.headers.get("origin")
        if asked.headers.get("host", "").lower() not in self._hosts:
            return _refusal(f"the Host header is not the address of this page; {_TUNNEL}")
        reads = asked.scope.get("method") in {"GET", "HEAD"}
        opened = _same(query.get("once", ""), self._once)
        if reads and (opened or _same(query.get("token", ""), self._token)):
            self._once = "" if opened else self._once
            # The token goes from the address into a cookie that scripts cannot read.
            rest = urlencode([each for each in query.multi_items() if each[0] not in {"token", "once"}])
            # The path as one of this host: for a browser "//elsewhere" would be another one.
            moved = RedirectResponse(f"/{asked.url.path.lstrip('/')}?{rest}".rstrip("?"), status_code=303)
            moved.set_cookie(self._cookie, self._token, httponly=True, samesite="strict", secure=self._secure)
            return moved
        if not _same(asked.cookies.get(self._cookie, ""), self._token):
            return _refusal("open the link that markerseek page printed in the terminal")
        if origin not in self._origins and not (reads and origin is None):
            return _refusal(f"the Origin header is not the address of this page; {_TUNNEL}")
        if asked.url.path in PAGES and _viewers() >= MAX_VIEWERS:
            return _refusal(f"{MAX_VIEWERS} tabs show the page already; close one of them")
        return None


def _same(given: str, secret: str) -> bool:
    return bool(secret) and hmac.compare_digest(given.encode(), secret.encode())


_TUNNEL = (
    "through a tunnel (ssh -L, VS Code) start markerseek page with --public-url and the address in the browser, as in "
    "--public-url http://localhost:9000"
)


def _refusal(reason: str) -> Response:
    return PlainTextResponse(f"markerseek: {reason}\n", status_code=403)


def _viewers() -> int:
    return sum(client.has_socket_connection for client in Client.instances.values())


def page_application(searches: PageSearches, **gate: Any) -> FastAPI:
    """The application with all pages; ``gate``: arguments of `Gate`."""

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        watching = asyncio.create_task(_stop_unwatched(searches))
        yield
        watching.cancel()
        await asyncio.to_thread(searches.close)

    application = FastAPI(docs_url=None, redoc_url=None, openapi_url=None, lifespan=lifespan)
    application.add_middleware(Gate, **gate)

    @application.post("/stop")
    async def stop() -> Response:
        """STOP, by a plain request: it needs no connection of NiceGUI, and does not wait for a thread."""
        searches.stop()
        return Response(status_code=204)

    @application.get("/camera/{side}.jpg")
    def camera(side: Literal["left", "right"]) -> Response:
        """The newest image of a camera in the session."""
        live = searches.registration
        path = None if live is None else live.journal / f"{side}.jpg"
        if path is None or not path.is_file():
            return Response(status_code=404)
        return Response(path.read_bytes(), media_type="image/jpeg", headers={"Cache-Control": "no-store"})

    @ui.page("/")
    def register(request: Request) -> Response | None:
        if not searches.rig.registers:
            return RedirectResponse("/search")
        build_registration_page(searches, request.query_params)
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


async def _stop_unwatched(searches: PageSearches) -> None:
    """Stop searches that nobody watches."""
    watched_s = time.monotonic()
    while True:
        await asyncio.sleep(WATCH_S)
        if _viewers() or not searches.busy:
            watched_s = time.monotonic()
        else:
            searches.stop_unwatched(time.monotonic() - watched_s)
