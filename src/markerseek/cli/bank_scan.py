"""``markerseek bank scan``: scans a rig into a bank."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Annotated

import typer
from msgspec import structs
from rich.markup import escape

from markerseek import runs
from markerseek.cli.open_rig import arm_rig, open_rig, person
from markerseek.cli.options import Arm, AsJson, RigFile, Trace
from markerseek.cli.report import Output, Report, with_version
from markerseek.cli.signals import StoppedBySignal, end_stopped, stopped_by_signals
from markerseek.cli.terminal import announce_compilation, progress_bar, scaled, show_view, stderr
from markerseek.core import MarkerseekError, Measured, SearchPlan, SimulationOptions


def command(
    out: Annotated[Path, typer.Argument(help="New file, .hdf5.")],
    rig: RigFile = None,
    step_deg: Annotated[float, typer.Option(help="Largest step in degrees.")] = 0.5,
    seed: Annotated[
        int | None,
        typer.Option(min=0, help="Seed of the simulation: the same seed gives the same scan.", show_default="1"),
    ] = None,
    goes_on: Annotated[
        bool,
        typer.Option("--continue", help="Go on with a scan that was killed: only the missing angles are measured."),
    ] = False,
    arm: Arm = False,
    trace: Trace = None,
    wavelength_nm: Annotated[float | None, typer.Option(help="Wavelength of the laser, stored in the bank.")] = None,
    pulse_energy_mj: Annotated[
        float | None, typer.Option(help="Energy of one laser pulse, stored in the bank.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Scan the whole search range of a rig, with dark frames first, and write each acquisition before the next.

    If stopped early, the file has all acquisitions so far. A scan that was killed goes on with --continue.

    Examples
    --------
    markerseek bank scan scan.hdf5 --seed 1
    markerseek bank scan scan.hdf5 --rig examples/rigs/simulated.toml --step-deg 0.25
    markerseek bank scan --continue scan.hdf5 --seed 1
    """
    from markerseek.records.banks import read_bank, record_of
    from markerseek.records.journal import RunView

    runs.require_new_scan(out, goes_on=goes_on)
    wavelength_m = scaled("--wavelength-nm", wavelength_nm, 1e-9, most=20_000)
    pulse_energy_j = scaled("--pulse-energy-mj", pulse_energy_mj, 1e-3, most=10_000)
    announce_compilation()
    taken = 0
    stopped: StoppedBySignal | None = None
    with open_rig(rig, SimulationOptions(seed=seed), trace=trace) as (assembled, _start_deg):
        angles = runs.scan_angles(assembled, step_deg=step_deg)
        view = RunView(plan=SearchPlan(method="exhaustive"), facts=assembled.facts)
        arm_rig(assembled, file=rig, arm=arm, what="scan", as_json=as_json)
        events = runs.scan_bank(
            assembled,
            out,
            step_deg=step_deg,
            wavelength_m=wavelength_m,
            pulse_energy_j=pulse_energy_j,
            goes_on=goes_on,
            by=person(),
        )
        try:
            with (
                stopped_by_signals(),
                progress_bar(angles, what="scanning") as progress,
                closing(events),
            ):
                for event in events:
                    seen = event
                    if isinstance(event, Measured):
                        # The counts of a frame have half a megabyte.
                        seen = structs.replace(event, sample=structs.replace(event.sample, frame=None))
                        taken = event.index if event.role == "search" else taken
                    view = view.add(seen, clock_s=assembled.scanner.clock.now_s())
                    show_view(progress, view, done=taken)
        except StoppedBySignal as stop:
            stopped = stop
        finally:
            # Also after an error: the user must know what the file contains.
            if 0 < taken < angles:
                _print_what_is_left(out, planned=angles)
        if stopped is not None:
            # One or two angles make no bank, and a second stop may end its making: then their record is kept.
            kept = next((path for path in (out, record_of(out)) if path.exists()), None)
            end_stopped(stopped, as_json=as_json, kept=kept)
    facts = assembled.facts
    # Of a scan that went on, with the acquisitions of before.
    held = read_bank(out)
    taken = len(held.angles_deg)
    dark = held.dark_frames
    values = with_version(
        path=str(out),
        rig=facts.description,
        angles=taken,
        dark_frames=dark,
        refused=view.refused,
        simulated=assembled.simulated,
        emulated=facts.emulated,
        seed=facts.seed,
        configuration=facts.fingerprint,
    )
    shown = [f"{taken} angles and {dark} dark frames of a {facts.rig_name} in {escape(str(out))}"]
    Output(as_json=as_json).show(Report(values=values, shown=shown))


def _print_what_is_left(path: Path, *, planned: int) -> None:
    """Print how many angles the file of an interrupted scan has, by reading it."""
    from markerseek.records.banks import read_bank

    try:
        held = len(read_bank(path).angles_deg)
    except MarkerseekError as problem:
        stderr.print(f"[yellow]{escape(str(problem))}[/]")
    else:
        stderr.print(f"[yellow]{escape(str(path))} holds {held} of {planned} angles; they can be read[/]")
