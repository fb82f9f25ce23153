"""``markerseek igtl``: serves searches over OpenIGTLink."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from markerseek import bridges, rigs
from markerseek.bridges import igtl
from markerseek.cli.options import RigFile
from markerseek.cli.signals import Stopped, heeded
from markerseek.cli.terminal import printable
from markerseek.core import ConfigError

EXAMPLES = """
    markerseek igtl
    markerseek igtl --rig examples/rigs/bench.toml
    markerseek igtl --play run.journal --pace 0.1
    markerseek igtl --registration registration.json
    markerseek igtl --registration SESSION
    markerseek igtl --host 192.0.2.10 --allow 192.0.2.7
"""


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
    play: Annotated[
        Path | None, typer.Option(help="Play a journal or a bank instead of searching; the last state stays.")
    ] = None,
    registration: Annotated[
        Path | None,
        typer.Option(
            help="Also send the transform of the da Vinci camera: of the file that `markerseek register` wrote, or of "
            "a session's folder, after each marker."
        ),
    ] = None,
    pace: Annotated[
        float | None,
        typer.Option(
            min=0, help="Real seconds per second of a simulated rig (usually 0) or of a recording (usually 1)."
        ),
    ] = None,
    header_version: Annotated[
        int, typer.Option(min=1, max=2, help="Header version; 1 for clients before OpenIGTLink 3, without metadata.")
    ] = 2,
) -> None:
    """Show searches to 3D Slicer and other OpenIGTLink clients, and start and stop them by their commands.

    A search is the ordinary command in a process of its own. A rig of devices asks on this terminal whether it may be
    armed, each time; no message arms, resets or homes it.
    """
    # Not above: to import it takes 25 ms.
    import asyncio

    if rig is not None and play is not None:
        raise ConfigError("--play shows a recording, and a recording has no rig file; leave out --rig or --play")
    if rig is not None:
        # A file that cannot be used is refused now, not when somebody asks for a search.
        rigs.read_rig_file(rig)
    recording = None if play is None else bridges.open_recording(play)
    source = None if registration is None else bridges.open_registration(registration)
    service = igtl.SearchService(
        bridges.SearchOptions(rig=rig, pace=pace or 0.0) if recording is None else None,
        # The name of a file may be no text, and is sent as text.
        recording=None if recording is None else printable(recording.name),
        registration=source,
        version=1 if header_version == 1 else 2,
        allowed=[_address(text) for text in allow or []],
        on_note=_note,
    )
    try:
        code = asyncio.run(_serve(service, host, port, recording, pace=1.0 if pace is None else pace))
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


async def _serve(
    service: igtl.SearchService, host: str, port: int, recording: bridges.Recording | None, *, pace: float
) -> int:
    """Serve until a signal comes, and play a recording if one is given; returns the exit code."""
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
        if recording is not None:
            played = asyncio.create_task(service.play(recording, pace=pace))
            ends: set[asyncio.Future[Any]] = {played, stopped}
            await asyncio.wait(ends, return_when=asyncio.FIRST_COMPLETED)
            if played.done():
                # A recording that cannot be read ends the command.
                played.result()
                _note(f"{recording.name} is over; Ctrl-C ends the bridge")
            played.cancel()
        return 128 + await stopped
    finally:
        await service.close()
