"""``markerseek replay``: finds the marker in a recorded scan."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from markerseek import rigs, runs
from markerseek.cli.options import AsJson, Out, ProbeName, Single, single_source, with_values
from markerseek.cli.recordings import TypedTable
from markerseek.cli.report import Output
from markerseek.cli.signals import WatchOptions
from markerseek.cli.terminal import announce_compilation, stderr
from markerseek.core import ConfigError, SearchPlan
from markerseek.records.banks import TableFormat


@with_values
def command(
    *,
    bank: Annotated[
        Path,
        typer.Argument(
            help="HDF5, NumPy or MATLAB arrays, CSV of angle_deg,intensity, sequence of PLUS, or a folder with one "
            "SonixDAQ sub-folder per angle."
        ),
    ],
    plan: SearchPlan,
    table: TableFormat,
    typed: TypedTable,
    single: Single = False,
    probe: ProbeName = None,
    reference_deg: Annotated[
        float | None, typer.Option(help="Reference angle of the marker in degrees, for comparison.")
    ] = None,
    journal: Annotated[
        Path | None, typer.Option(help="New file for the journal of the run; without it no journal is kept.")
    ] = None,
    plot: Annotated[bool, typer.Option("--plot", help="Write replay.png and replay.html into --out.")] = False,
    out: Out = None,
    watch: WatchOptions,
    as_json: AsJson = False,
) -> None:
    """Find the marker in a recorded scan: the answer is from all its angles.

    Below it, for comparison, stands what a search by --method would have taken and said: it gets the data of the
    nearest recorded angle, as if the scan were a rig. With --as-published, the answer is that of the method itself, on
    intensities interpolated between recorded angles, as in the paper's offline analysis.

    Examples
    --------
    markerseek replay examples/simulated_scan.csv --method posterior --reference-deg -8.25 --plot
    markerseek replay mine.csv --columns Winkel,Amplitude --unit mrad
    markerseek replay /data/scan-2024-05-03 --probe BPL9-5/55 --reference-deg -12.5
    """
    from markerseek.cli.searching import conclude, run_anew

    output = Output.asked(as_json=as_json, plot=plot, out=out)
    table = typed.added_to(table)
    announce_compilation()
    # Only the paper's form gets data that nobody recorded: its section 2.5 interpolates between angles.
    between: Literal["interpolated", "nearest"] = "interpolated" if plan.as_published else "nearest"
    assembled = rigs.replayed(bank, probe=probe, reference_deg=reference_deg, between=between, table=table)
    if probe is not None and assembled.imaging is None:
        raise ConfigError(f"--probe is {probe}, and {bank} holds intensities, not channel data; leave it out")
    if assembled.imaging is not None and not as_json:
        used = assembled.imaging.preset
        stderr.print(
            f"imaged as frames of {used.name}: {used.array.elements} elements of {1e3 * used.array.pitch_m:.4g} mm, "
            f"{1e-6 * used.sampling_hz:g} MHz, {used.sound_speed_m_s:g} m/s; another probe: --probe"
        )
    recorded = None if assembled.angles_deg is None else len(assembled.angles_deg)
    if recorded is not None and plan.acquisitions is not None and plan.acquisitions > recorded:
        raise ConfigError(
            f"--acquisitions is {plan.acquisitions}, and {bank} holds {recorded} angles; ask for at most these"
        )
    plan = runs.plan_on(assembled, single_source(plan, single=single))
    run = runs.new_run(assembled, plan)
    recorded_curve = None
    if plot and not plan.whole:
        recorded_curve = runs.bank_curve(rigs.read_recording(bank, table, probe=probe), probe=probe)
    run = run_anew(run, as_json=as_json, journal=journal, keep=journal is not None, watch=watch)
    conclude(
        run.view,
        output,
        name="replay",
        imaging=assembled.imaging,
        recorded=recorded_curve,
    )
