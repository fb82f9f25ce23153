"""``markerseek search``: searches for the marker on a rig."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

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
    single: Annotated[
        bool, typer.Option("--single", help="State that there is one source only: fewer acquisitions, none for others.")
    ] = False,
    prior: Annotated[
        Path | None,
        typer.Option(
            help="Result (JSON) or journal of a former search on this rig: fewer acquisitions for a like marker."
        ),
    ] = None,
    rig: Annotated[
        Path | None, typer.Option(help="Rig file (TOML); without one, the simulated rig with its defaults.")
    ] = None,
    tissue: Annotated[
        str | None,
        typer.Option(help="Simulated material, instead of the rig's; an unknown name lists them all."),
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
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object for programs.")] = False,
) -> None:
    """Find the marker on a rig: rotate, fire, measure, decide; then rotate to it and confirm."""
    from markerseek.cli.open_rig import arm_rig, open_rig
    from markerseek.cli.session import run_new_session
    from markerseek.cli.show_result import Output, conclude
    from markerseek.cli.terminal import announce_compilation, picture_folder
    from markerseek.runs import former_curve, new_session, plan_on
    from markerseek.search import method_named

    # The folder for pictures is tested now: a search on tissue is not repeated for a picture.
    output = Output(name="search", as_json=as_json, plot=plot, folder=picture_folder(out, plot=plot))
    # An unknown method is an error before devices are opened.
    method_named(method)
    curve = None if prior is None else former_curve(prior)
    with open_rig(rig, seed=seed, tissue=tissue, pace=pace) as (assembled, start_deg):
        plan = plan_on(
            assembled,
            method=method,
            acquisitions=acquisitions,
            as_published=as_published,
            start_deg=start_deg,
            stay=stay,
            single=single,
            prior=curve,
        )
        session = new_session(assembled, plan)
        announce_compilation()
        arm_rig(assembled, arm=arm, what="search", as_json=as_json)
        session = run_new_session(session, as_json=as_json, journal=journal, keep=not no_journal, rig_file=rig)
    conclude(session.recorder, session.configuration, output, imaging=assembled.imaging, journal=session.journal)
