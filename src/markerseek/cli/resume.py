"""``markerseek resume``: continues a search that was stopped, or whose process died."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from markerseek import drivers, rigs, runs
from markerseek.cli.open_rig import (
    NOT_ARMED,
    confirmed,
    naming_trace,
    person,
    print_permissions,
    require_no_trace,
    with_trace,
)
from markerseek.cli.options import AsJson, Out, Trace
from markerseek.cli.report import Output
from markerseek.cli.signals import Heartbeat, ImageRingFile, require_pipe
from markerseek.cli.terminal import announce_compilation, print_json, print_warning, stdout
from markerseek.core import ConfigError, counted

if TYPE_CHECKING:
    from markerseek.records.journal import RecordedRun


def command(
    journal: Annotated[Path, typer.Argument(help="Journal of the run.")],
    rig: Annotated[
        Path | None, typer.Option(help="Rig file (TOML); needed to resume a journal of a rig of devices.")
    ] = None,
    arm: Annotated[bool, typer.Option("--arm", help="Arm the laser and continue without being asked.")] = False,
    trace: Trace = None,
    reset_fault: Annotated[
        bool,
        typer.Option("--reset-fault", help="Reset the fault that ended the run; inspect the rig first."),
    ] = False,
    plot: Annotated[bool, typer.Option("--plot", help="Write resume.png and resume.html into --out.")] = False,
    out: Out = None,
    heartbeat: Heartbeat = None,
    image_ring: ImageRingFile = None,
    as_json: AsJson = False,
) -> None:
    """Continue a search after an interruption: what was measured is kept, and the search goes on from there.

    Nothing moves and nothing is fired until a person arms the rig: by --arm, or by typing its name on a terminal.
    Otherwise the state of the run is printed, and the exit code is 4. Once armed, the strongest angle so far is
    measured again. If it has changed by more than noise, the search says so and starts again. A simulated rig is made
    from the journal. For devices, --rig is needed: limits, budgets and start_command are taken from the rig file, never
    from the journal, and differences between the two are printed. If the run is over, its result is printed.

    Examples
    --------
    markerseek resume run.journal
    markerseek resume run.journal --arm --json
    markerseek resume run.journal --rig examples/rigs/bench.toml --arm
    """
    from markerseek.cli.searching import conclude
    from markerseek.records.journal import RunView, read_journal

    output = Output.asked(as_json=as_json, plot=plot, out=out)
    require_pipe(heartbeat)
    # Frames are needed for the picture only, and have half a megabyte each.
    recorded = read_journal(journal, frames=plot)
    view = RunView.of(recorded)
    if view.state == "finished":
        imaging = runs.rebuild_image_reader(recorded.configuration) if plot else None
    else:
        runs.require_reset(recorded.path, view, reset_fault=reset_fault)
        bench = _bench_named(recorded, rig, arm=arm, trace=trace)
        announce_compilation()
        if not arm and not _confirmed(recorded, rig, as_json=as_json):
            raise typer.Exit(NOT_ARMED)
        run = _resume(journal, rig, bench, reset_fault=reset_fault, as_json=as_json, image_ring=image_ring)
        view = run.view
        imaging = run.rig.imaging
    conclude(view, output, name="resume", imaging=imaging)


def _bench_named(
    recorded: RecordedRun, rig: Path | None, *, arm: bool, trace: Path | None
) -> drivers.BenchSettings | None:
    """Return the settings of the rig file, compared with the journal and printed.

    None for a rig without devices, or unnamed.
    """
    from markerseek.cli.searching import resume_command

    recorded_settings = runs.recorded_bench(recorded.configuration)
    if recorded_settings is None:
        require_no_trace(trace)
    if recorded_settings is None and rig is not None:
        raise ConfigError(
            f"--rig {rig}: {recorded.path} is of a {recorded.configuration.facts.kind} rig and describes it in full; "
            "leave --rig out"
        )
    if recorded_settings is not None and rig is None and arm:
        raise ConfigError(
            f"{recorded.path}: it is of a rig of devices, which is not taken from a journal; name the rig file: "
            f"{resume_command(recorded.path, Path('RIG.toml'))} --arm"
        )
    if recorded_settings is None or rig is None:
        return None
    named = rigs.read_rig_file(rig)
    if not isinstance(named, drivers.BenchSettings):
        raise ConfigError(
            f"--rig {rig}: it describes a simulated rig, and {recorded.path} is of devices; name their file"
        )
    try:
        differences = runs.require_same_measurement(recorded.configuration, recorded_settings, named)
    except ConfigError as problem:
        raise ConfigError(f"{rig}: {problem}") from problem
    for difference in differences:
        print_warning(f"{rig} differs from the rig of the journal: {difference}")
    print_permissions(named)
    return with_trace(named, trace)


def _resume(
    journal: Path,
    rig_file: Path | None,
    bench: drivers.BenchSettings | None,
    *,
    reset_fault: bool,
    as_json: bool,
    image_ring: Path | None,
) -> runs.Run:
    """Lock the journal, rebuild rig and policy, and continue the run."""
    from markerseek.cli.searching import closed_at_end, run_to_end
    from markerseek.records.journal import Journal

    # Read again under the lock: another program may have continued the run while the user was asked.
    kept, recorded = Journal.reopen(journal)
    with closed_at_end(kept), naming_trace(bench), runs.rebuild_rig(recorded, bench_settings=bench) as rig:
        run = runs.resumed_run(rig, kept, recorded, by=person(), reset_fault=reset_fault)
        run_to_end(run, as_json=as_json, rig_file=rig_file, image_ring=image_ring)
    return run


def _confirmed(recorded: RecordedRun, rig: Path | None, *, as_json: bool) -> bool:
    """Print the state of the run, and ask on a terminal whether to continue; with --json nothing is asked."""
    from markerseek.cli.searching import resume_command
    from markerseek.records.journal import RunView

    view = RunView.of(recorded)
    plan = recorded.configuration.plan
    facts = recorded.configuration.facts
    rig_file_needed = rig is None and facts.kind == "bench"
    if as_json:
        print_json(
            {
                "state": view.state,
                "armed": False,
                "acquisitions": view.acquisitions,
                "journal": str(recorded.path),
                "rig_file_needed": rig_file_needed,
            }
        )
        return False
    kept = counted(view.acquisitions, "acquisition is", "acquisitions are")
    stdout.print(escape(f"{plan.method} on a {facts.rig_name}: {kept} kept, the strongest is measured again"))
    if rig_file_needed:
        cure = f"{resume_command(recorded.path, Path('RIG.toml'))} --arm"
        said = f"not armed: nothing moved and nothing was fired; the rig file is needed; continue with: {cure}"
        stdout.print(escape(said))
        return False
    return confirmed("Arm the laser and continue?", name=facts.rig_name if rig is None else rig.name)
