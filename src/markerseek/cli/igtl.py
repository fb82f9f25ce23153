"""``markerseek igtl``: serves searches over OpenIGTLink."""

from __future__ import annotations

import asyncio
import signal
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from collections.abc import Callable

    from markerseek.bridges.igtl import SearchService

NAME = "igtl"
EXAMPLES = (
    "Examples:\n\n"
    "  markerseek igtl\n\n"
    "  markerseek igtl --rig examples/rigs/bench.toml\n\n"
    "  markerseek igtl --pace 1 --port 18946"
)

LOOPBACK = "127.0.0.1"


def command(
    rig: Annotated[
        Path | None, typer.Option(help="Rig file (TOML); without one, the simulated rig with its defaults.")
    ] = None,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port; 0 takes any that is free. PLUS has 18944.")
    ] = 18945,
    host: Annotated[str, typer.Option(help="Address of this computer.")] = LOOPBACK,
    pace: Annotated[float, typer.Option(min=0, help="Real seconds per virtual second of a simulated rig.")] = 0,
    header_version: Annotated[
        int, typer.Option(min=1, max=2, help="Header version; 1 for clients before OpenIGTLink 3, without metadata.")
    ] = 2,
) -> None:
    """Show searches to 3D Slicer and other OpenIGTLink clients, and start and stop them by their commands.

    A search is the ordinary command in a process of its own. A rig of devices asks on this terminal whether it may be
    armed, each time; no message arms, resets or homes it.
    """
    from markerseek.bridges import Searches, SearchOptions
    from markerseek.bridges.igtl import SearchService
    from markerseek.cli.terminal import stderr
    from markerseek.rigs import read_rig_file

    if rig is not None:
        # A file that cannot be used is refused now, not when somebody asks for a search.
        read_rig_file(rig)

    def note(sentence: str) -> None:
        stderr.print(sentence, markup=False)

    if host != LOOPBACK:
        note(f"warning: OpenIGTLink has no passwords: whoever reaches {host} can start and stop searches")
    searches = Searches(SearchOptions(rig=rig, pace=pace, frames=True))
    service = SearchService(searches, version=1 if header_version == 1 else 2, on_note=note)
    raise typer.Exit(asyncio.run(_serve(service, host, port, note)))


async def _serve(service: SearchService, host: str, port: int, note: Callable[[str], None]) -> int:
    """Serve until a signal comes, and return the exit code."""
    stopped: asyncio.Future[int] = asyncio.get_running_loop().create_future()

    def stop(number: int) -> None:
        if not stopped.done():
            stopped.set_result(number)

    for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        asyncio.get_running_loop().add_signal_handler(each, stop, each)
    taken = await service.open(host, port)
    try:
        note(f"OpenIGTLink clients connect to {host}, port {taken}; Ctrl-C ends the bridge, and a search that runs")
        return 128 + await stopped
    finally:
        await service.close()
