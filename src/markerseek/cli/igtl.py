"""``markerseek igtl``: serves searches over OpenIGTLink."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from markerseek import bridges, rigs
from markerseek.bridges import igtl
from markerseek.cli.options import RigFile
from markerseek.cli.signals import Stopped, heeded
from markerseek.cli.terminal import printable
from markerseek.core import ConfigError


def command(
    rig: RigFile = None,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port; 0 takes any that is free. PLUS has 18944.")
    ] = 18945,
    host: Annotated[
        str, typer.Option(help="Address of this computer; any that other computers reach needs --allow.")
    ] = "127.0.0.1",
    allow: Annotated[
        list[str] | None,
        typer.Option(metavar="ADDRESS", help="Another computer that may connect, repeatable; it needs no password."),
    ] = None,
    registration: Annotated[
        Path | None,
        typer.Option(
            help="Also send the transform of the da Vinci camera: of the file that `markerseek register` wrote, or of "
            "a session's folder, after each marker."
        ),
    ] = None,
    pace: Annotated[float, typer.Option(min=0, help="Real seconds per second of a simulated rig.")] = 0.0,
    header_version: Annotated[
        int, typer.Option(min=1, max=2, help="Header version; 1 for clients before OpenIGTLink 3, without metadata.")
    ] = 2,
) -> None:
    """Show searches to 3D Slicer and other OpenIGTLink clients, and start and stop them by their commands.

    A search is the ordinary command in a process of its own. A rig of devices asks on this terminal whether it may be
    armed, each time; no message arms, resets or homes it.

    Examples
    --------
    markerseek igtl
    markerseek igtl --rig examples/rigs/bench.toml
    markerseek igtl --registration registration.json
    markerseek igtl --registration SESSION
    markerseek igtl --host 192.0.2.10 --allow 192.0.2.7
    """
    # Not above: to import it takes 25 ms.
    import asyncio

    if rig is not None:
        # A file that cannot be used is refused now, not when somebody asks for a search.
        rigs.read_rig_file(rig)
    source = None if registration is None else bridges.open_registration(registration)
    service = igtl.SearchService(
        bridges.SearchOptions(rig=rig, pace=pace),
        registration=source,
        version=1 if header_version == 1 else 2,
        allowed=[_address(text) for text in allow or []],
        on_note=_note,
    )
    try:
        code = asyncio.run(_serve(service, host, port))
    finally:
        if source is not None:
            source.close()
    raise Stopped(code)


def _address(text: str) -> igtl.IPAddress:
    try:
        return igtl.plain_address(text)
    except ValueError:
        raise ConfigError(f"--allow {text!r} is no address of a computer; name one such as 192.0.2.7") from None


def _note(sentence: str) -> None:
    import select

    # A terminal that is held (Ctrl-S), or a pipe that nobody reads, must not hold up a stop.
    if select.select([], [2], [], 0)[1]:
        # Rich takes a millisecond for a line, and a flood of clients brings thousands of them.
        sys.stderr.write(f"{printable(sentence)}\n")


async def _serve(service: igtl.SearchService, host: str, port: int) -> int:
    """Serve until a signal comes; returns the exit code."""
    import asyncio

    loop = asyncio.get_running_loop()
    stopped: asyncio.Future[int] = loop.create_future()

    def stop(number: int) -> None:
        if not stopped.done():
            stopped.set_result(number)

    for each in heeded():
        loop.add_signal_handler(each, stop, each)
    taken = await service.open(host, port)
    try:
        _note(f"OpenIGTLink clients connect to {host}, port {taken}; Ctrl-C ends the bridge, and a search that runs")
        return 128 + await stopped
    finally:
        await service.close()
