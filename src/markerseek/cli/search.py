"""``markerseek search``: searches for the marker on a rig."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from markerseek import runs
from markerseek.cli.event_stream import EventFrames, Events, Heartbeat, StreamOptions
from markerseek.cli.open_rig import SimulationOptions, announce_sweep, arm_rig, open_rig
from markerseek.cli.options import (
    Acquisitions,
    Arm,
    AsJson,
    AsPublished,
    MethodName,
    Others,
    Out,
    RigFile,
    Single,
    Stay,
    SweepOption,
    ToleranceDeg,
    ToleranceMm,
    others_of,
    tolerance_of,
)
from markerseek.cli.terminal import announce_compilation, picture_folder
from markerseek.core import ConfigError, SearchPlan

EXAMPLES = (
    "Examples:\n\n"
    "  markerseek search --seed 1 --plot\n\n"
    "  markerseek search --sweep --readout-s 0.05\n\n"
    "  markerseek search --method ternary --acquisitions 16 --as-published\n\n"
    "  markerseek search --marker-deg 10 --second-marker-deg -12 --snr-db 30\n\n"
    "  markerseek search --compare posterior,golden-section,ternary --plot\n\n"
    "  markerseek search --rig examples/rigs/simulated.toml --json\n\n"
    "  markerseek search --rig examples/rigs/bench.toml --arm"
)


def command(
    method: MethodName = "posterior",
    acquisitions: Acquisitions = None,
    as_published: AsPublished = False,
    others: Others = None,
    single: Single = False,
    tolerance_mm: ToleranceMm = None,
    tolerance_deg: ToleranceDeg = None,
    prior: Annotated[
        Path | None,
        typer.Option(
            help="Result (JSON) or journal of a former search on this rig: fewer acquisitions for a like marker."
        ),
    ] = None,
    compare: Annotated[
        str | None,
        typer.Option(
            metavar="METHOD,METHOD",
            help="Search the same simulated world with each of these methods; one table, and no journals.",
        ),
    ] = None,
    rig: RigFile = None,
    tissue: Annotated[
        str | None,
        typer.Option(help="Simulated material, instead of the rig's; an unknown name lists them all."),
    ] = None,
    no_marker: Annotated[bool, typer.Option("--no-marker", help="Simulate noise and clutter alone.")] = False,
    marker_deg: Annotated[
        float | None, typer.Option(help="Angle of the simulated marker, in degrees.", show_default="drawn at random")
    ] = None,
    second_marker_deg: Annotated[
        float | None, typer.Option(help="Angle of a second simulated marker, as strong, elsewhere along the array.")
    ] = None,
    snr_db: Annotated[
        float | None,
        typer.Option(help="Peak SNR of the simulated image with the probe on the marker, in dB.", show_default="40"),
    ] = None,
    readout_s: Annotated[
        float | None,
        typer.Option(
            help="Seconds to read one acquisition of a simulated rig, instead of the rig's.", show_default="10"
        ),
    ] = None,
    arm: Arm = False,
    seed: Annotated[
        int | None,
        typer.Option(min=0, help="Seed of the simulation: the same seed gives the same search.", show_default="1"),
    ] = None,
    pace: Annotated[float, typer.Option(help="Real seconds per virtual second: 0 does not wait, 1 is real time.")] = 0,
    stay: Stay = False,
    sweep: SweepOption = False,
    journal: Annotated[
        Path | None,
        typer.Option(help="Journal of the run, a new SQLite file; without it, one in the user's data folder."),
    ] = None,
    no_journal: Annotated[
        bool, typer.Option("--no-journal", help="Keep no journal; the search cannot be resumed.")
    ] = False,
    plot: Annotated[bool, typer.Option("--plot", help="Write search.png and search.html into --out.")] = False,
    out: Out = None,
    events: Events = None,
    event_frames: EventFrames = False,
    heartbeat: Heartbeat = None,
    asked_by: Annotated[str | None, typer.Option(hidden=True, help="Who asked a bridge for this search.")] = None,
    as_json: AsJson = False,
) -> None:
    """Find the marker on a rig: rotate, fire, measure, decide; then rotate to it and confirm."""
    from markerseek.cli.compare import compare as compare_methods
    from markerseek.cli.session import run_new_session
    from markerseek.cli.show_result import Output, conclude
    from markerseek.search import method_named, require_sweeping

    # The folder for pictures is tested now: a search on tissue is not repeated for a picture.
    output = Output(name="search", as_json=as_json, plot=plot, folder=picture_folder(out, plot=plot))
    stream = StreamOptions(path=events, frames=event_frames, heartbeat=heartbeat)
    # An unknown method, and a tolerance that cannot be, are errors before devices are opened.
    method_named(method)
    tolerance = tolerance_of(tolerance_mm, tolerance_deg)
    options = SimulationOptions(
        seed=seed,
        tissue=tissue,
        pace=pace,
        no_marker=no_marker,
        marker_deg=marker_deg,
        second_marker_deg=second_marker_deg,
        snr_db=snr_db,
        readout_s=readout_s,
        single_pulses=sweep,
    )
    if sweep:
        require_sweeping(method, as_published=as_published)
    if compare is not None:
        if sweep:
            raise ConfigError("--compare names methods that stop for each acquisition; leave --sweep out")
        if journal is not None or method != "posterior":
            raise ConfigError("--compare names the methods and keeps no journals; leave --method and --journal out")
        compare_methods(
            compare,
            rig,
            options,
            output,
            acquisitions=acquisitions,
            as_published=as_published,
            stay=stay,
            tolerance=tolerance,
        )
    curve = None if prior is None else runs.former_curve(prior)
    with open_rig(rig, options) as (assembled, start_deg):
        plan = runs.plan_on(
            assembled,
            SearchPlan(
                method=method,
                acquisitions=acquisitions,
                as_published=as_published,
                start_deg=start_deg,
                stay=stay,
                others=others_of(others, single=single),
                prior=curve,
                tolerance=tolerance,
                sweep_speed_deg_s=assembled.scanner.sweeping.stage.fastest_sweep_deg_s if sweep else None,
            ),
        )
        if sweep:
            announce_sweep(assembled, start_deg=start_deg)
        session = runs.new_session(assembled, plan)
        announce_compilation()
        arm_rig(assembled, file=rig, arm=arm, what="search", as_json=as_json, asked_by=asked_by)
        session = run_new_session(
            session, as_json=as_json, journal=journal, keep=not no_journal, rig_file=rig, stream=stream
        )
    conclude(
        session.recorder,
        session.configuration,
        output,
        imaging=assembled.imaging,
        policy=session.policy,
        journal=session.journal,
    )
