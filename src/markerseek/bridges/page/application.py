"""The pages as an ASGI application, and who may open them."""

from __future__ import annotations

import asyncio
import hmac
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlencode

from fastapi import FastAPI, Request, Response
from nicegui import Client, ui
from starlette.datastructures import QueryParams
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse, RedirectResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from markerseek.bridges.page.controls import USUAL
from markerseek.bridges.page.page_searches import PageSearches
from markerseek.bridges.page.page_shell import PAGES
from markerseek.bridges.page.race_page import build_race_page
from markerseek.bridges.page.replay_page import ReplayPage
from markerseek.bridges.page.search_page import build_search_page

WATCH_S = 0.5
"""Time between two looks whether anybody watches, in seconds."""

UNWATCHED_S = 5.0
"""Time without any viewer after which a search is stopped, in seconds: nobody would see it, or press STOP."""

MAX_VIEWERS = 16
"""Most tabs that may show the page at one time."""


@dataclass(slots=True, kw_only=True)
class Access:
    """Who may open the page.

    Attributes
    ----------
    token
        Secret of this page.
    hosts
        Names in the Host header that are accepted, without the port.
    origins
        Values of the Origin header that are accepted.
    cookie
        Name of the cookie that holds the token; cookies are shared by all ports of a host, so it names the port.
    secure
        Whether the page is served with TLS.
    once
        Secret that opens the page one time, for the browser that the page itself starts; empty for none.
    """

    token: str
    hosts: frozenset[str]
    origins: frozenset[str]
    cookie: str
    secure: bool = False
    once: str = ""

    def is_token(self, given: str) -> bool:
        """Whether a text is the token."""
        return hmac.compare_digest(given.encode(), self.token.encode())

    def opens(self, query: QueryParams) -> bool:
        """Whether a link opens the page; a secret for one time is used up."""
        if self.once and hmac.compare_digest(query.get("once", "").encode(), self.once.encode()):
            self.once = ""
            return True
        return self.is_token(query.get("token", ""))


class Gate:
    """Lets a request or a WebSocket through if its cookie holds the token and it comes from the page itself."""

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self.app, self._access = app, access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request, one WebSocket, or the start and end of the server."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        asked, access = HTTPConnection(scope), self._access
        reads = scope["type"] == "http" and scope["method"] in {"GET", "HEAD"}
        answer: Response | None = None
        if reads and access.opens(asked.query_params):
            # The token goes from the address into a cookie that scripts cannot read.
            rest = urlencode([each for each in asked.query_params.multi_items() if each[0] not in {"token", "once"}])
            # The path as one of this host: for a browser "//elsewhere" would be another one.
            answer = RedirectResponse(f"/{asked.url.path.lstrip('/')}?{rest}".rstrip("?"), status_code=303)
            answer.set_cookie(access.cookie, access.token, httponly=True, samesite="strict", secure=access.secure)
        elif not access.is_token(asked.cookies.get(access.cookie, "")):
            answer = _refusal("open the link that markerseek page printed in the terminal")
        elif (origin := asked.headers.get("origin")) not in access.origins and not (reads and origin is None):
            answer = _refusal(f"the Origin header is not the address of this page; {_TUNNEL}")
        elif scope["path"] in PAGES and _viewers() >= MAX_VIEWERS:
            answer = _refusal(f"{MAX_VIEWERS} tabs show the page already; close one of them")
        await (answer or self.app)(scope, receive, send)


_TUNNEL = (
    "through a tunnel (ssh -L, VS Code) start markerseek page with --public-url and the address in the browser, as in "
    "--public-url http://localhost:9000"
)


def _refusal(reason: str) -> Response:
    return PlainTextResponse(f"markerseek: {reason}\n", status_code=403)


def _viewers() -> int:
    return sum(client.has_socket_connection for client in Client.instances.values())


def page_application(searches: PageSearches, access: Access) -> FastAPI:
    """The application with all pages."""

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        watching = asyncio.create_task(_stop_unwatched(searches))
        yield
        watching.cancel()
        await asyncio.to_thread(searches.close)

    application = FastAPI(docs_url=None, redoc_url=None, openapi_url=None, lifespan=lifespan)
    added: Any = application.add_middleware
    added(Gate, access=access)
    added(TrustedHostMiddleware, allowed_hosts=sorted(access.hosts), www_redirect=False)

    @application.post("/stop")
    async def stop() -> Response:
        """STOP, by a plain request: it needs no connection of NiceGUI, and waits for no thread."""
        searches.stop()
        return Response(status_code=204)

    @ui.page("/")
    def search(request: Request) -> None:
        build_search_page(searches, USUAL.with_query(request.query_params))

    @ui.page("/race")
    def race(request: Request) -> None:
        build_race_page(searches, USUAL.with_query(request.query_params))

    @ui.page("/replay")
    def replay(recording: str = "") -> None:
        ReplayPage(searches, recording)

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
        elif time.monotonic() - watched_s > UNWATCHED_S:
            searches.stop()
