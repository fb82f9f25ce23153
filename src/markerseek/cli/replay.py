"""``markerseek replay``: searches a recorded scan."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

NAME = "replay"
EXAMPLES = (
    "Examples:\n\n"
    "  markerseek replay examples/simulated_scan.csv --method posterior --reference-deg -8.25 --plot\n\n"
    "  markerseek replay /data/scan-2024-05-03 --probe BPL9-5/55 --reference-deg -12.5"
)


def command(
    bank: Annotated[
        Path,
        typer.Argument(
            help="Bank: IPASC HDF5, CSV of angle_deg,intensity, or a folder with one SonixDAQ sub-folder per angle."
        ),
    ],
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
    probe: Annotated[
        str | None,
        typer.Option(
            help="Preset of the imaging chain, for channel data.", show_default="that of the bank, else BPL9-5/55"
        ),
    ] = None,
    reference_deg: Annotated[
        float | None, typer.Option(help="Reference angle of the marker in degrees, for comparison.")
    ] = None,
    stay: Annotated[bool, typer.Option("--stay", help="Do not turn to the marker at the end.")] = False,
    journal: Annotated[
        Path | None, typer.Option(help="Journal of the run, a new SQLite file; without it, none is kept.")
    ] = None,
    plot: Annotated[bool, typer.Option("--plot", help="Write replay.png and replay.html into --out.")] = False,
    out: Annotated[
        Path | None, typer.Option(help="Folder for pictures, with --plot.", show_default="the current one")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object for programs.")] = False,
) -> None:
    """Search a recorded scan as if it were a rig: the methods ask, the recording answers.

    A search gets the data of the nearest recorded angle. With --as-published, intensities are interpolated between
    recorded angles, as in the paper's offline analysis.
    """
    from markerseek import rigs
    from markerseek.cli.session import run_new_session
    from markerseek.cli.show_result import Output, conclude
    from markerseek.cli.terminal import announce_compilation, picture_folder
    from markerseek.core import ConfigError
    from markerseek.runs import new_session, plan_on
    from markerseek.search import method_named

    output = Output(name="replay", as_json=as_json, plot=plot, folder=picture_folder(out, plot=plot))
    announce_compilation()
    # Only the paper's form gets invented data: its section 2.5 interpolates between recorded angles.
    between: Literal["interpolated", "nearest"] = "interpolated" if as_published else "nearest"
    assembled = rigs.replayed(bank, probe=probe, reference_deg=reference_deg, between=between)
    if probe is not None and assembled.imaging is None:
        raise ConfigError(f"--probe is {probe}, and {bank} holds intensities, not channel data; leave it out")
    recorded = assembled.distinct_angles
    if acquisitions is None:
        usual = method_named(method).acquisitions
        # More acquisitions than recorded angles would only repeat some of them.
        acquisitions = usual if recorded is None else min(usual, recorded)
    elif recorded is not None and acquisitions > recorded:
        raise ConfigError(
            f"--acquisitions is {acquisitions}, and {bank} holds {recorded} angles; ask for at most these"
        )
    plan = plan_on(
        assembled,
        method=method,
        acquisitions=acquisitions,
        as_published=as_published,
        start_deg=assembled.stage.angle_deg,
        stay=stay,
        single=single,
    )
    session = new_session(assembled, plan)
    session = run_new_session(session, as_json=as_json, journal=journal, keep=journal is not None)
    conclude(session.recorder, session.configuration, output, imaging=assembled.imaging, journal=session.journal)
