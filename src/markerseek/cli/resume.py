"""``markerseek resume``: continues a search that was stopped, or whose process died."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from markerseek import drivers, rigs, runs
from markerseek.cli.event_stream import EventFrames, Events, StopWithReader, StreamOptions
from markerseek.cli.open_rig import NOT_ARMED, person, print_permissions
from markerseek.cli.options import AsJson, Out
from markerseek.cli.terminal import announce_compilation, picture_folder, print_json, print_warning, stdout
from markerseek.core import ConfigError

if TYPE_CHECKING:
    from markerseek.records.journal import RecordedRun

EXAMPLES = (
    "Examples:\n\n"
    "  markerseek resume run.journal\n\n"
    "  markerseek resume run.journal --arm --json\n\n"
    "  markerseek resume run.journal --rig examples/rigs/bench.toml --arm"
)


def command(
    journal: Annotated[Path, typer.Argument(help="Journal of the run.")],
    rig: Annotated[
        Path | None, typer.Option(help="Rig file (TOML); needed to resume a journal of a rig of devices.")
    ] = None,
    arm: Annotated[bool, typer.Option("--arm", help="Arm the laser and continue without being asked.")] = False,
    reset_fault: Annotated[
        bool,
        typer.Option("--reset-fault", help="Reset the fault that ended the run; inspect the rig first."),
    ] = False,
    plot: Annotated[bool, typer.Option("--plot", help="Write resume.png and resume.html into --out.")] = False,
    out: Out = None,
    events: Events = None,
    event_frames: EventFrames = False,
    stop_with_reader: StopWithReader = False,
    as_json: AsJson = False,
) -> None:
    """Continue a search after any interruption, with the same next angle and the same result.

    Nothing moves and nothing is fired until a person arms the rig: by --arm, or by answering yes on a terminal.
    Otherwise the state of the run is printed, and the exit code is 4. Once armed, the strongest angle so far and one on
    a flank are measured again, and the search continues only if both are unchanged. A simulated or recorded rig is made
    from the journal. For devices, --rig is needed: limits, budgets and start_command are taken from the rig file, never
    from the journal, and differences between the two are printed. If the run is over, its result is printed.
    """
    from markerseek.cli.show_result import Output, conclude
    from markerseek.records.journal import read_journal, result_of, run_state

    output = Output(name="resume", as_json=as_json, plot=plot, folder=picture_folder(out, plot=plot))
    stream = StreamOptions(path=events, frames=event_frames, stop_with_reader=stop_with_reader)
    # Frames are needed for the picture only, and have half a megabyte each.
    held = read_journal(journal, frames=plot)
    state = run_state(held.entries)
    if state.state == "finished":
        recorder, _ = result_of(held)
        imaging, policy = None, None
        if plot:
            imaging, policy = runs.rebuild_image_reader(held.configuration), runs.rebuild_policy(held.configuration)
            # It is given all samples; there is no next angle.
            runs.next_angle(held, policy)
    else:
        runs.require_reset(held.path, state, reset_fault=reset_fault)
        bench = _bench_named(held, rig, arm=arm)
        announce_compilation()
        if not arm and not _confirmed(held, bench, as_json=as_json):
            raise typer.Exit(NOT_ARMED)
        session = _resume(journal, rig, bench, reset_fault=reset_fault, as_json=as_json, stream=stream)
        recorder, imaging, policy = session.recorder, session.rig.imaging, session.policy
    conclude(recorder, held.configuration, output, imaging=imaging, policy=policy)


def _bench_named(held: RecordedRun, rig: Path | None, *, arm: bool) -> drivers.BenchSettings | None:
    """Settings of the rig file, compared with the journal and printed; None for a rig without devices, or unnamed."""
    from markerseek.cli.session import resume_command

    recorded = runs.recorded_bench(held.configuration)
    if recorded is None and rig is not None:
        raise ConfigError(
            f"--rig {rig}: {held.path} is of a {held.configuration.facts.kind} rig and describes it in full; "
            "leave --rig out"
        )
    if recorded is not None and rig is None and arm:
        raise ConfigError(
            f"{held.path}: it is of a rig of devices, which is not taken from a journal; name the rig file: "
            f"{resume_command(held.path, Path('RIG.toml'))} --arm"
        )
    if recorded is None or rig is None:
        return None
    named = rigs.read_rig_file(rig)
    if not isinstance(named, drivers.BenchSettings):
        raise ConfigError(f"--rig {rig}: it describes a simulated rig, and {held.path} is of devices; name their file")
    try:
        differences = runs.require_same_measurement(held.configuration, recorded, named)
    except ConfigError as problem:
        raise ConfigError(f"{rig}: {problem}") from problem
    for difference in differences:
        print_warning(f"{rig} differs from the rig of the journal: {difference}")
    print_permissions(named)
    return named


def _resume(
    journal: Path,
    rig_file: Path | None,
    bench: drivers.BenchSettings | None,
    *,
    reset_fault: bool,
    as_json: bool,
    stream: StreamOptions,
) -> runs.Session:
    """Lock the journal, rebuild rig and policy, and continue the run."""
    from markerseek.cli.session import closed_at_end, run_session
    from markerseek.records.journal import Journal

    # Read again under the lock: another program may have continued the run while the user was asked.
    kept, held = Journal.reopen(journal)
    with closed_at_end(kept), runs.rebuild_rig(held.configuration, bench_settings=bench) as rig:
        session = runs.resumed_session(rig, kept, held, by=person(), reset_fault=reset_fault)
        run_session(session, as_json=as_json, rig_file=rig_file, stream=stream)
    return session


def _confirmed(held: RecordedRun, bench: drivers.BenchSettings | None, *, as_json: bool) -> bool:
    """Print the state of the run, and ask on a terminal whether to continue; with --json nothing is asked."""
    rig_file_needed = bench is None and held.configuration.facts.kind == "bench"
    can_ask = not as_json and not rig_file_needed and sys.stdin.isatty()
    _print_state(held, as_json=as_json, rig_file_needed=rig_file_needed, can_ask=can_ask)
    return can_ask and typer.confirm("Arm the laser and continue?", default=False)


def _print_state(held: RecordedRun, *, as_json: bool, rig_file_needed: bool, can_ask: bool) -> None:
    """Print the state of the run: acquisitions, next angle, angles to measure again, and how to continue."""
    from markerseek.cli.session import resume_command
    from markerseek.records.journal import run_state

    state = run_state(held.entries)
    next_deg = runs.next_angle(held, runs.rebuild_policy(held.configuration))
    checks_deg = [sample.angle_deg for sample in runs.samples_to_recheck(held.entries)]
    if as_json:
        print_json(
            {
                "state": state.state,
                "armed": False,
                "acquisitions": state.acquisitions,
                "next_deg": next_deg,
                "checks_deg": checks_deg,
                "journal": str(held.path),
                "rig_file_needed": rig_file_needed,
            }
        )
        return
    kept = "1 acquisition is kept" if state.acquisitions == 1 else f"{state.acquisitions} acquisitions are kept"
    lines = [
        f"{held.configuration.plan.method} on a {held.configuration.facts.rig_name}: {kept}; "
        + ("only the end is left" if next_deg is None else f"the next is at {next_deg:.3f}°")
    ]
    if checks_deg:
        lines.append(f"before it, {' and '.join(f'{each:.3f}°' for each in checks_deg)} will be measured again")
    if rig_file_needed:
        lines.append(
            "not armed: nothing moved and nothing was fired; the rig file is needed; continue with: "
            f"{resume_command(held.path, Path('RIG.toml'))} --arm"
        )
    elif not can_ask:
        lines.append("not armed: nothing moved and nothing was fired; add --arm to continue")
    for line in lines:
        stdout.print(escape(line))
