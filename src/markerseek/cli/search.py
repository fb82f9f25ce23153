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
    "  markerseek search --rig examples/rigs/simulated.toml --json"
)


def command(
    method: Annotated[str, typer.Option(help="How to search; an unknown name lists them all.")] = "weighted-average",
    acquisitions: Annotated[
        int | None, typer.Option(max=500, help="Most acquisitions; each method has its own default.")
    ] = None,
    as_published: Annotated[
        bool, typer.Option("--as-published", help="The paper's form of the method, which always answers.")
    ] = False,
    rig: Annotated[
        Path | None, typer.Option(help="Rig file (TOML); without one, the simulated rig with its defaults.")
    ] = None,
    tissue: Annotated[
        str | None, typer.Option(help="Simulated stand-in for a material; an unknown name lists them all.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulation: the same seed gives the same search.")] = 1,
    pace: Annotated[float, typer.Option(help="Real seconds for a virtual one; 0 does not wait, 1 is real speed.")] = 0,
    stay: Annotated[bool, typer.Option("--stay", help="Do not turn to the marker at the end.")] = False,
    plot: Annotated[bool, typer.Option("--plot", help="Write search.png and search.html into --out.")] = False,
    out: Annotated[Path, typer.Option(help="Folder for pictures.")] = Path(),
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object for programs.")] = False,
) -> None:
    """Find the marker on a rig: turn, fire, listen, decide; then turn to it and confirm."""
    from dataclasses import replace

    from markerseek import rigs
    from markerseek.cli.hunt import hunt, show
    from markerseek.cli.terminal import announce_compilation
    from markerseek.rig_file import read_rig_file
    from markerseek.search import build, method_named
    from markerseek.sim import SimulatedSettings

    settings = SimulatedSettings() if rig is None else read_rig_file(rig)
    if tissue is not None:
        settings = replace(settings, tissue=tissue)
    policy = build(
        method,
        limits=settings.limits.search,
        acquisitions=acquisitions,
        as_published=as_published,
        start_deg=settings.start_deg,
    )
    announce_compilation()
    assembled = rigs.simulated(seed=seed, settings=settings, pace=pace)
    most = acquisitions or method_named(method).acquisitions
    recorder, result = hunt(
        policy, assembled, method=method, as_published=as_published, most=most, stay=stay, seed=seed
    )
    raise typer.Exit(show(recorder, result, assembled, as_json=as_json, plot=plot, out=out, name="search"))
