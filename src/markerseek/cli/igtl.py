"""``markerseek igtl``: serves searches over OpenIGTLink."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

NAME = "igtl"
EXAMPLES = (
    "Examples:\n\n"
    "  markerseek igtl\n\n"
    "  markerseek igtl --rig examples/rigs/bench.toml\n\n"
    "  markerseek igtl --play run.journal --pace 0.1\n\n"
    "  markerseek igtl --registration registration.json"
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
    play: Annotated[
        Path | None, typer.Option(help="Play a journal or a bank instead of searching; the last state stays.")
    ] = None,
    registration: Annotated[
        Path | None,
        typer.Option(help="Also send the transform of the da Vinci camera: JSON of `markerseek register --json`."),
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
    from markerseek.bridges import Searches, SearchOptions, open_recording
    from markerseek.bridges.igtl import SearchService
    from markerseek.cli.igtl_serving import Playing, serve
    from markerseek.cli.terminal import stderr
    from markerseek.core import ConfigError
    from markerseek.rigs import read_rig_file
    from markerseek.runs import read_registration

    if rig is not None and play is not None:
        raise ConfigError("--play shows a recording, and a recording has no rig file; leave out --rig or --play")
    if rig is not None:
        # A file that cannot be used is refused now, not when somebody asks for a search.
        read_rig_file(rig)
    recording = None if play is None else open_recording(play)

    def note(sentence: str) -> None:
        stderr.print(sentence, markup=False)

    if host != LOOPBACK:
        note(f"warning: OpenIGTLink has no passwords: whoever reaches {host} can start and stop searches")
    searches = Searches(SearchOptions(rig=rig, pace=pace or 0.0, frames=True))
    service = SearchService(
        searches if recording is None else None,
        recording=None if recording is None else recording.name,
        registration=None if registration is None else read_registration(registration),
        version=1 if header_version == 1 else 2,
        on_note=note,
    )
    playing = None if recording is None else Playing(recording=recording, pace=1.0 if pace is None else pace)
    raise typer.Exit(serve(service, host, port, playing, note))
