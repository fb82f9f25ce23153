"""``markerseek search``: a search on a rig."""

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
    rig: Annotated[
        Path | None, typer.Option(help="Rig file (TOML); without one, the simulated rig with its defaults.")
    ] = None,
    tissue: Annotated[
        str | None,
        typer.Option(help="Simulated stand-in for a material, instead of the rig's; an unknown name lists all."),
    ] = None,
    arm: Annotated[
        bool, typer.Option("--arm", help="Arm a rig of devices without being asked; a simulated one needs it not.")
    ] = False,
    seed: Annotated[
        int | None,
        typer.Option(min=0, help="Seed of the simulation: the same seed gives the same search.", show_default="1"),
    ] = None,
    pace: Annotated[float, typer.Option(help="Real seconds for a virtual one; 0 does not wait, 1 is real speed.")] = 0,
    stay: Annotated[bool, typer.Option("--stay", help="Do not turn to the marker at the end.")] = False,
    journal: Annotated[
        Path | None,
        typer.Option(help="Journal of the run, a new SQLite file; without it, one in the user's data folder."),
    ] = None,
    no_journal: Annotated[bool, typer.Option("--no-journal", help="Keep no journal: it cannot be resumed.")] = False,
    plot: Annotated[bool, typer.Option("--plot", help="Write search.png and search.html into --out.")] = False,
    out: Annotated[
        Path | None, typer.Option(help="Folder for pictures, with --plot.", show_default="the current one")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object for programs.")] = False,
) -> None:
    """Find the marker on a rig: turn, fire, listen, decide; then turn to it and confirm."""
    from markerseek.cli.hunt import conclude, hunt
    from markerseek.cli.keeping import held_open, new_journal
    from markerseek.cli.on_rig import arm_rig, open_rig, seed_of
    from markerseek.cli.terminal import announce_compilation, picture_folder
    from markerseek.rigs.journalled import configuration_of, search_events
    from markerseek.search import build, method_named

    folder = picture_folder(out, plot=plot)
    most = acquisitions or method_named(method).acquisitions
    with open_rig(rig, seed=seed, tissue=tissue, pace=pace) as (assembled, start_deg):
        policy = build(
            method,
            limits=assembled.limits.search,
            acquisitions=acquisitions,
            as_published=as_published,
            start_deg=start_deg,
        )
        announce_compilation()
        configuration = configuration_of(
            assembled,
            method=method,
            acquisitions=acquisitions,
            as_published=as_published,
            start_deg=start_deg,
            dark_frames=0 if as_published else assembled.dark_frames,
            stay=stay,
            seed=seed_of(assembled),
        )
        arm_rig(assembled, arm=arm, what="search", as_json=as_json)
        with held_open(new_journal(journal, configuration, wanted=not no_journal)) as kept:
            events = search_events(policy, assembled, configuration, kept)
            recorder, result = hunt(events, configuration, most=most, journal=kept, as_json=as_json, rig_file=rig)
    conclude(
        recorder,
        result,
        description=assembled.description,
        imaging=assembled.imaging,
        journal=kept,
        as_json=as_json,
        plot=plot,
        out=folder,
        name="search",
    )
