"""``markerseek resume``: goes on with a search that was stopped, or that died."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from markerseek.core import ConfigError

if TYPE_CHECKING:
    from markerseek.drivers.settings import BenchSettings
    from markerseek.records.journal import Recording
    from markerseek.records.result import Recorder, SearchResult
    from markerseek.signals import ImageReader

NAME = "resume"
EXAMPLES = (
    "Examples:\n\n"
    "  markerseek resume run.journal\n\n"
    "  markerseek resume run.journal --arm --json\n\n"
    "  markerseek resume run.journal --rig examples/rigs/bench.toml --arm"
)


def command(
    journal: Annotated[Path, typer.Argument(help="Journal of the run.")],
    rig: Annotated[
        Path | None, typer.Option(help="Rig file (TOML) of the devices; a journal of devices is not armed without.")
    ] = None,
    arm: Annotated[bool, typer.Option("--arm", help="Arm the laser and go on, without being asked.")] = False,
    reset_fault: Annotated[
        bool,
        typer.Option("--reset-fault", help="Reset a fault that ended the run; look at the rig before."),
    ] = False,
    plot: Annotated[bool, typer.Option("--plot", help="Write resume.png and resume.html into --out.")] = False,
    out: Annotated[
        Path | None, typer.Option(help="Folder for pictures, with --plot.", show_default="the current one")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object for programs.")] = False,
) -> None:
    """Go on with a search after any end: the same next angle, the same result.

    Nothing moves and nothing is fired until a person arms the rig: by --arm, or by saying so when asked on a terminal.
    Without either it prints where the run stands, and ends with exit code 4. Armed, it measures the strongest angle so
    far and one on a flank again, and goes on only if both are as before. A simulated or recorded rig is that of the
    journal. Devices are those of the rig file named by --rig: limits, budgets and start_command are taken from there
    and never from the journal, and its differences to the journal's rig are printed. The result of a run that is over
    is printed.
    """
    from markerseek.cli.hunt import conclude
    from markerseek.cli.on_rig import NOT_ARMED
    from markerseek.cli.terminal import announce_compilation, picture_folder
    from markerseek.records.journal import read_journal, result_of, run_state
    from markerseek.rigs.resuming import require_reset

    folder = picture_folder(out, plot=plot)
    held = read_journal(journal, frames=plot)
    stands = run_state(held.entries)
    if stands.state == "finished":
        recorder, result = result_of(held)
        imaging = _imaging_again(held) if plot else None
    else:
        require_reset(held.path, stands, reset_fault=reset_fault)
        bench = _bench_named(held, rig, arm=arm)
        announce_compilation()
        if not arm and not _confirmed(held, bench, as_json=as_json):
            raise typer.Exit(NOT_ARMED)
        recorder, result, imaging = _go_on(journal, rig, bench, reset_fault=reset_fault, as_json=as_json)
    conclude(
        recorder,
        result,
        description=held.configuration.description,
        imaging=imaging,
        journal=None,
        as_json=as_json,
        plot=plot,
        out=folder,
        name="resume",
    )


def _bench_named(held: Recording, rig: Path | None, *, arm: bool) -> BenchSettings | None:
    """Settings of the rig file, compared with the journal and printed; None for a rig without devices, or unnamed."""
    from markerseek.cli.hunt import resume_command
    from markerseek.cli.on_rig import print_permissions
    from markerseek.cli.terminal import print_warning
    from markerseek.drivers.settings import BenchSettings
    from markerseek.rig_file import read_rig_file
    from markerseek.rigs.again import recorded_bench
    from markerseek.rigs.same_bench import require_same_measurement

    recorded = recorded_bench(held.configuration)
    if recorded is None:
        if rig is not None:
            raise ConfigError(
                f"--rig {rig}: {held.path} is of a {held.configuration.rig} rig and describes it in full; "
                "leave --rig out"
            )
        return None
    if rig is None:
        if arm:
            raise ConfigError(
                f"{held.path}: it is of a rig of devices, and a journal does not bring its own rig; name the rig file: "
                f"{resume_command(held.path, Path('RIG.toml'))} --arm"
            )
        return None
    named = read_rig_file(rig)
    if not isinstance(named, BenchSettings):
        raise ConfigError(f"--rig {rig}: it describes a simulated rig, and {held.path} is of devices; name their file")
    try:
        differences = require_same_measurement(held.configuration, recorded, named)
    except ConfigError as problem:
        raise ConfigError(f"{rig}: {problem}") from problem
    for difference in differences:
        print_warning(f"{rig} differs from the rig of the journal: {difference}")
    print_permissions(named)
    return named


def _go_on(
    journal: Path, rig_file: Path | None, bench: BenchSettings | None, *, reset_fault: bool, as_json: bool
) -> tuple[Recorder, SearchResult, ImageReader | None]:
    """Lock the journal, assemble rig and policy again, and let them go on."""
    from markerseek.cli.hunt import hunt
    from markerseek.cli.keeping import held_open
    from markerseek.cli.on_rig import person
    from markerseek.records.journal import Journal
    from markerseek.rigs.again import policy_again, rig_again
    from markerseek.rigs.resuming import resumed
    from markerseek.search import method_named

    kept, held = Journal.reopen(journal)
    begun_with = held.configuration
    with held_open(kept), rig_again(begun_with, bench_settings=bench) as rig:
        events = resumed(policy_again(begun_with), rig, kept, held, by=person(), reset_fault=reset_fault)
        most = begun_with.acquisitions or method_named(begun_with.method).acquisitions
        recorder, result = hunt(events, begun_with, most=most, journal=kept, as_json=as_json, rig_file=rig_file)
    return recorder, result, rig.imaging


def _confirmed(held: Recording, bench: BenchSettings | None, *, as_json: bool) -> bool:
    """Print where the run stands, and ask whoever sits at the terminal whether to go on."""
    from rich.markup import escape

    from markerseek.cli.hunt import resume_command
    from markerseek.cli.terminal import people, print_json
    from markerseek.records.journal import run_state
    from markerseek.rigs.again import next_angle, policy_again
    from markerseek.rigs.checking import telling

    stands = run_state(held.entries)
    rig_file_needed = bench is None and held.configuration.rig == "bench"
    following_deg = next_angle(held, policy_again(held.configuration))
    checks_deg = [sample.angle_deg for sample in telling(held.entries)]
    if as_json:
        print_json(
            {
                "state": stands.state,
                "armed": False,
                "acquisitions": stands.acquisitions,
                "next_deg": following_deg,
                "checks_deg": checks_deg,
                "journal": str(held.path),
                "rig_file_needed": rig_file_needed,
            }
        )
        return False
    kept = "1 acquisition is kept" if stands.acquisitions == 1 else f"{stands.acquisitions} acquisitions are kept"
    people.print(
        f"{escape(held.configuration.method)} on a {held.configuration.rig} rig: {kept}; "
        + ("only the end is left" if following_deg is None else f"the next is at {following_deg:.3f}°")
    )
    if checks_deg:
        people.print(f"before it, {' and '.join(f'{each:.3f}°' for each in checks_deg)} will be measured again")
    if rig_file_needed:
        people.print(
            "not armed: nothing moved and nothing was fired; a journal does not bring its own rig, go on with: "
            + escape(f"{resume_command(held.path, Path('RIG.toml'))} --arm")
        )
        return False
    if not sys.stdin.isatty():
        people.print("not armed: nothing moved and nothing was fired; add --arm to go on")
        return False
    return typer.confirm("Arm the laser and go on?", default=False)


def _imaging_again(held: Recording) -> ImageReader | None:
    """Imaging chain for the pictures; None where there are intensities only."""
    from markerseek.rigs.again import reader_again
    from markerseek.signals import ImageReader

    reader = reader_again(held.configuration)
    return reader if isinstance(reader, ImageReader) else None
