"""The pages as an ASGI application, without its security layer."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from fastapi import FastAPI, Request, Response
from nicegui import Client, ui

from markerseek.bridges.page.controls import USUAL
from markerseek.bridges.page.page_searches import PageSearches
from markerseek.bridges.page.race_page import build_race_page
from markerseek.bridges.page.replay_page import ReplayPage
from markerseek.bridges.page.search_page import build_search_page
from markerseek.bridges.page.security import App
from markerseek.bridges.page.turn_page import build_turn_page

WATCH_S = 0.5
"""Time between two looks whether anybody watches, and whether the page hears STOP, in seconds."""

UNWATCHED_S = 5.0
"""Time without any viewer after which a search is stopped, in seconds: nobody would see it, or press STOP."""

HUNG_S = 4.0
"""Time in which the event loop has not turned after which a search is stopped, in seconds (decision 44)."""


def page_application(searches: PageSearches) -> App:
    """The application with all pages."""

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        over = threading.Event()
        watched = (searches, asyncio.get_running_loop(), over)
        threading.Thread(target=_stop_when_hung, args=watched, name="stop when hung", daemon=True).start()
        watching = asyncio.create_task(_stop_unwatched(searches))
        yield
        watching.cancel()
        over.set()
        # Before the server hands its signal on, which may end the process at once.
        await asyncio.to_thread(searches.close)

    application = FastAPI(docs_url=None, redoc_url=None, openapi_url=None, lifespan=lifespan)

    @application.post("/stop")
    def stop() -> Response:
        """STOP, by a plain request: it needs no connection of NiceGUI."""
        searches.stop()
        return Response(status_code=204)

    @ui.page("/")
    def search(request: Request) -> None:
        build_search_page(searches, USUAL.with_query(request.query_params))

    @ui.page("/race")
    def race(request: Request) -> None:
        build_race_page(searches, USUAL.with_query(request.query_params))

    @ui.page("/turn")
    def turn() -> None:
        build_turn_page(searches)

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
        if any(client.has_socket_connection for client in Client.instances.values()) or not searches.busy:
            watched_s = time.monotonic()
        elif time.monotonic() - watched_s > UNWATCHED_S:
            searches.stop()


def _stop_when_hung(searches: PageSearches, loop: asyncio.AbstractEventLoop, over: threading.Event) -> None:
    """Stop searches while the event loop, which hears STOP, hangs; where all hangs, their heartbeat ends."""
    while not over.wait(WATCH_S):
        turned = threading.Event()
        loop.call_soon_threadsafe(turned.set)
        if not turned.wait(HUNG_S):
            searches.stop()
