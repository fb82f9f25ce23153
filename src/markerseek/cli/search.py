"""``markerseek search``: searches for the marker on a rig."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer
from rich.markup import escape
from rich.table import Table

from markerseek import runs
from markerseek.cli.event_stream import EventFrames, Events, Heartbeat, StreamOptions
from markerseek.cli.open_rig import SimulationOptions, arm_rig, open_rig
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
    ToleranceDeg,
    ToleranceMm,
    others_of,
    tolerance_of,
)
from markerseek.cli.report import Output, Report, drawn, table
from markerseek.cli.terminal import announce_compilation
from markerseek.core import ConfigError, SearchPlan, Tolerance

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from markerseek.records import SearchResult

EXAMPLES = (
    "Examples:\n\n"
    "  markerseek search --seed 1 --plot\n\n"
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
    from markerseek.cli.session import run_new_session
    from markerseek.cli.show_result import conclude
    from markerseek.search import method_named

    # The folder for pictures is tested now: a search on tissue is not repeated for a picture.
    output = Output.asked(as_json=as_json, plot=plot, out=out)
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
    )
    if compare is not None:
        if journal is not None or method != "posterior":
            raise ConfigError("--compare names the methods and keeps no journals; leave --method and --journal out")
        _compare(
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
            ),
        )
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
        name="search",
        imaging=assembled.imaging,
        policy=session.policy,
        journal=session.journal,
    )


def _compare(
    methods: str,
    rig: Path | None,
    options: SimulationOptions,
    output: Output,
    *,
    acquisitions: int | None,
    as_published: bool,
    stay: bool,
    tolerance: Tolerance,
) -> NoReturn:
    """Search the same simulated world with each method, and print one table; ends with exit code 0 if all found it.

    ``methods``: names of the methods, with commas between them.
    """
    from markerseek.cli.session import run_session
    from markerseek.cli.show_result import FOUND, OTHER_ANSWER
    from markerseek.search import method_named

    names = [name.strip() for name in methods.split(",")]
    for name in names:
        method_named(name)
    if len(names) < 2 or len(set(names)) < len(names):
        raise ConfigError(f"--compare is {methods!r}, two or more different methods are needed: ternary,posterior")
    announce_compilation()
    sessions = []
    for name in names:
        # A new rig of the same seed, so that every method begins in the same world.
        with open_rig(rig, options) as (assembled, start_deg):
            if not assembled.simulated:
                raise ConfigError(f"--compare is for a simulated rig, and {rig} is one of devices; leave it out")
            plan = runs.plan_on(
                assembled,
                SearchPlan(
                    method=name,
                    acquisitions=acquisitions,
                    as_published=as_published,
                    start_deg=start_deg,
                    stay=stay,
                    tolerance=tolerance,
                ),
            )
            session = runs.new_session(assembled, plan)
            run_session(session, as_json=output.as_json)
        sessions.append(session)
    results = [session.result() for session in sessions]
    title = f"{', '.join(names)} on a simulated rig: {sessions[0].configuration.facts.description}"
    report = Report(
        values=results,
        shown=_compared(results, title),
        pictures={"search.png": drawn(_figure, sessions, title)},
        exit_code=FOUND if all(result.found for result in results) else OTHER_ANSWER,
    )
    output.show(report)


def _compared(results: list[SearchResult], title: str) -> Iterator[str | Table]:
    yield escape(title)
    rows = (
        {
            "method": result.method,
            "answer": result.answer,
            "angle": f"{result.angle_deg:.3f}°",
            "±": "–" if result.sigma_deg is None else f"{result.sigma_deg:.3f}°",
            "error": "–" if result.error_deg is None else f"{result.error_deg:.3f}°",
            "acquisitions": str(result.acquisitions),
            "rotation": f"{result.travel_deg:.1f}°",
        }
        for result in results
    )
    yield table(rows, left=("method", "answer"), no_wrap=True)
    if not all(result.found for result in results):
        yield "[dim]only an answer of 'found' claims a marker at its angle[/]"


def _figure(sessions: list[runs.Session], title: str) -> Figure:
    from markerseek.pictures import ComparedSearch, comparison_figure

    facts = sessions[0].configuration.facts
    searches = [
        ComparedSearch(
            name=session.configuration.plan.method,
            samples=session.recorder.samples,
            estimate=session.recorder.finished.estimate,
            start_deg=session.recorder.start_deg,
        )
        for session in sessions
        if session.recorder.finished is not None
    ]
    return comparison_figure(searches, title=title, limits=facts.search, truth_deg=facts.truth_deg)
