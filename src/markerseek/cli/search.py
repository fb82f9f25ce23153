"""``markerseek search``: searches for the marker on a rig."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from markerseek.cli.event_stream import EventFrames, Events, StopWithReader, StreamOptions

NAME = "search"
EXAMPLES = (
    "Examples:\n\n"
    "  markerseek search --seed 1 --plot\n\n"
    "  markerseek search --method ternary --acquisitions 16 --as-published\n\n"
    "  markerseek search --rig examples/rigs/simulated.toml --json\n\n"
    "  markerseek search --rig examples/rigs/bench.toml --arm"
)


def command(
    method: Annotated[str, typer.Option(help="How to search; an unknown name lists them all.")] = "posterior",
    acquisitions: Annotated[
        int | None, typer.Option(min=2, help="Most acquisitions; each method has its own default.")
    ] = None,
    as_published: Annotated[
        bool, typer.Option("--as-published", help="The paper's form of the method, which always answers.")
    ] = False,
    rig: Annotated[
        Path | None, typer.Option(help="Rig file (TOML); without one, the simulated rig with its defaults.")
    ] = None,
    tissue: Annotated[
        str | None,
        typer.Option(help="Simulated material, instead of the rig's; an unknown name lists them all."),
    ] = None,
    snr_db: Annotated[
        float | None, typer.Option(help="Peak SNR in dB of a simulated rig, instead of the rig's.", show_default="40")
    ] = None,
    readout_s: Annotated[
        float | None,
        typer.Option(
            help="Seconds to read one acquisition of a simulated rig, instead of the rig's.", show_default="10"
        ),
    ] = None,
    arm: Annotated[
        bool, typer.Option("--arm", help="Arm a rig of devices without being asked; not needed for a simulated rig.")
    ] = False,
    seed: Annotated[
        int | None,
        typer.Option(min=0, help="Seed of the simulation: the same seed gives the same search.", show_default="1"),
    ] = None,
    pace: Annotated[float, typer.Option(help="Real seconds per virtual second: 0 does not wait, 1 is real time.")] = 0,
    stay: Annotated[bool, typer.Option("--stay", help="Do not turn to the marker at the end.")] = False,
    journal: Annotated[
        Path | None,
        typer.Option(help="Journal of the run, a new SQLite file; without it, one in the user's data folder."),
    ] = None,
    no_journal: Annotated[
        bool, typer.Option("--no-journal", help="Keep no journal; the search cannot be resumed.")
    ] = False,
    plot: Annotated[bool, typer.Option("--plot", help="Write search.png and search.html into --out.")] = False,
    out: Annotated[
        Path | None, typer.Option(help="Folder for pictures, with --plot.", show_default="the current one")
    ] = None,
    events: Events = None,
    event_frames: EventFrames = False,
    stop_with_reader: StopWithReader = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object for programs.")] = False,
) -> None:
    """Find the marker on a rig: rotate, fire, measure, decide; then rotate to it and confirm."""
    from markerseek.cli.open_rig import arm_rig, open_rig
    from markerseek.cli.session import run_new_session
    from markerseek.cli.show_result import Output, conclude
    from markerseek.cli.terminal import announce_compilation, picture_folder
    from markerseek.runs import new_session, plan_on
    from markerseek.search import method_named

    # The folder for pictures is tested now: a search on tissue is not repeated for a picture.
    output = Output(name="search", as_json=as_json, plot=plot, folder=picture_folder(out, plot=plot))
    stream = StreamOptions(path=events, frames=event_frames, stop_with_reader=stop_with_reader)
    # An unknown method is an error before devices are opened.
    method_named(method)
    opened = open_rig(rig, seed=seed, tissue=tissue, pace=pace, snr_db=snr_db, readout_s=readout_s)
    with opened as (assembled, start_deg):
        plan = plan_on(
            assembled,
            method=method,
            acquisitions=acquisitions,
            as_published=as_published,
            start_deg=start_deg,
            stay=stay,
        )
        session = new_session(assembled, plan)
        announce_compilation()
        arm_rig(assembled, arm=arm, what="search", as_json=as_json)
        session = run_new_session(
            session, as_json=as_json, journal=journal, keep=not no_journal, rig_file=rig, stream=stream
        )
    conclude(session.recorder, session.configuration, output, imaging=assembled.imaging, journal=session.journal)
