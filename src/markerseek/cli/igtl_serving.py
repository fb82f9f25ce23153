"""Serves searches over OpenIGTLink until a signal comes; not in `igtl`: to import asyncio takes 25 ms."""

from __future__ import annotations

import asyncio
import signal
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    from markerseek.bridges import Recording
    from markerseek.bridges.igtl import SearchService


@dataclass(frozen=True, slots=True, kw_only=True)
class Playing:
    """A recording, and real seconds per second of it."""

    recording: Recording
    pace: float


def serve(service: SearchService, host: str, port: int, playing: Playing | None, note: Callable[[str], None]) -> int:
    """Serve until a signal comes, and return the exit code."""
    return asyncio.run(_serve(service, host, port, playing, note))


async def _serve(
    service: SearchService, host: str, port: int, playing: Playing | None, note: Callable[[str], None]
) -> int:
    stopped: asyncio.Future[int] = asyncio.get_running_loop().create_future()

    def stop(number: int) -> None:
        if not stopped.done():
            stopped.set_result(number)

    for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        asyncio.get_running_loop().add_signal_handler(each, stop, each)
    taken = await service.open(host, port)
    try:
        note(f"OpenIGTLink clients connect to {host}, port {taken}; Ctrl-C ends the bridge, and a search that runs")
        if playing is not None:
            played = asyncio.create_task(service.play(playing.recording, pace=playing.pace))
            ends: set[asyncio.Future[Any]] = {played, stopped}
            await asyncio.wait(ends, return_when=asyncio.FIRST_COMPLETED)
            if played.done():
                # A recording that cannot be read ends the command.
                played.result()
                note(f"{playing.recording.name} is over; Ctrl-C ends the bridge")
            played.cancel()
        return 128 + await stopped
    finally:
        await service.close()
