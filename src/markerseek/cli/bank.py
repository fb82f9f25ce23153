"""``markerseek bank``: banks (scans of many angles): the group, and its commands ``info`` and ``verify``."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer
from rich.markup import escape
from rich.table import Table

from markerseek import rigs, runs
from markerseek.cli import bank_files, bank_scan
from markerseek.cli.help import add_command
from markerseek.cli.options import AsJson, Out, TableOptions, require_frames, with_values
from markerseek.cli.report import Output, Report, drawn, facts, with_version
from markerseek.cli.terminal import announce_compilation, one_line, progress_bar
from markerseek.core import Estimate, SearchPlan
from markerseek.records import Answer

if TYPE_CHECKING:
    from markerseek.records.banks import FrameBank, IntensityBank
    from markerseek.search import Peak

_INFO_EXAMPLES = """
    markerseek bank info scan.hdf5 --plot
    markerseek bank info examples/simulated_scan.csv --json
"""


@with_values
def info(
    bank: Annotated[
        Path,
        typer.Argument(
            help="HDF5, NumPy or MATLAB arrays, CSV of angle_deg,intensity, or folder with one frame per angle."
        ),
    ],
    table: TableOptions,
    probe: Annotated[
        str | None,
        typer.Option(help="Compute the intensities again with this preset, or with your own probe in FILE.toml."),
    ] = None,
    plot: Annotated[bool, typer.Option("--plot", help="Write a picture of the curve into --out.")] = False,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Describe a bank: angles, what is known of probe and laser, the peak of its curve, and the answer of `replay`."""
    from markerseek.figures import bank_figure
    from markerseek.records.banks import require_whole
    from markerseek.search import peak_of

    output = Output.asked(as_json=as_json, plot=plot, out=out)
    held = rigs.read_recording(bank, table.format(), probe=probe)
    require_frames(held, bank, probe=probe)
    # The stored intensities need no frame, and a damaged one must not pass for that reason.
    require_whole(held)
    announce_compilation()
    curve = runs.bank_curve(held, probe=probe)
    peak = peak_of(curve)
    dark = runs.dark_intensity(held, probe=probe)
    answer = runs.answer_from_all(
        rigs.replayed(bank, probe=probe, table=table.format()), SearchPlan(method="posterior")
    )
    name = f"{bank.stem if bank.is_file() else bank.name}.png"
    report = Report(
        values=_values(bank, held, peak, answer, dark=dark, probe=probe),
        shown=_shown(bank, held, peak, answer, dark=dark, computed_with=probe),
        pictures={name: drawn(bank_figure, held, title=_title(bank, held), probe=probe, curve=curve)},
    )
    output.show(report)


def _values(
    path: Path,
    bank: IntensityBank | FrameBank,
    peak: Peak,
    answer: Estimate,
    *,
    dark: float | None,
    probe: str | None,
) -> dict[str, object]:
    """What is in a bank; the statistics of the peak have the names of bluesky: com, cen, fwhm, max."""
    known, angles = bank.facts, bank.angles_deg
    return with_version(
        path=str(path),
        content=_content(bank),
        description=known.description,
        angles=len(angles),
        first_deg=angles[0],
        last_deg=angles[-1],
        largest_step_deg=_largest_step_deg(bank),
        dark_frames=bank.dark_frames,
        dark_intensity=dark,
        intensities_stored=runs.intensities_stored(bank, probe=probe),
        imaged_by=_imaged_by(bank, probe),
        **asdict(peak),
        **msgspec.structs.asdict(Answer.of(answer)),
        reference_deg=known.reference_angle_deg,
        probe=known.probe,
        sampling_hz=known.sampling_hz,
        sound_speed_m_s=known.sound_speed_m_s,
        pitch_m=known.pitch_m,
        wavelength_m=known.wavelength_m,
        pulse_energy_j=known.pulse_energy_j,
        face_radius_m=known.face_radius_m,
        began_unix_s=_began_unix_s(bank),
        configuration=known.configuration,
        seed=known.seed,
        made_with=known.made_with,
    )


def _content(bank: IntensityBank | FrameBank) -> str:
    from markerseek.records.banks import FrameBank

    return "frames of channel data" if isinstance(bank, FrameBank) else "intensities"


def _largest_step_deg(bank: IntensityBank | FrameBank) -> float:
    return max(high - low for low, high in pairwise(bank.angles_deg))


def _began_unix_s(bank: IntensityBank | FrameBank) -> float | None:
    """When the first acquisition with light began, in seconds since 1970; None where that is not known."""
    known = [each for each in bank.started_s if math.isfinite(each)]
    zero_s = bank.facts.clock_zero_unix_s
    return zero_s + min(known) if known and zero_s is not None else None


def _shown(
    path: Path,
    bank: IntensityBank | FrameBank,
    peak: Peak,
    answer: Estimate,
    *,
    dark: float | None,
    computed_with: str | None,
) -> Iterator[str | Table]:
    yield f"[bold]{escape(str(path))}[/]: {_content(bank)}"
    known, angles, began_unix_s = bank.facts, bank.angles_deg, _began_unix_s(bank)
    rows: list[tuple[str, str | None]] = [
        ("scanned", known.description or None),
        ("began", None if began_unix_s is None else _date(began_unix_s)),
        ("angles", str(len(angles))),
        ("range", f"{angles[0]:g}° to {angles[-1]:g}°, steps of at most {_largest_step_deg(bank):.3g}°"),
        ("dark frames", None if dark is None else f"{bank.dark_frames}, the largest intensity is {dark:.4g}"),
        ("intensities", _origin(bank, computed_with)),
        ("imaged by", _imaged_by(bank, computed_with)),
        ("max", f"{peak.max_intensity:.4g} at {peak.max_deg:.3f}°"),
        ("com, centre of mass above half height", f"{peak.com_deg:.3f}°"),
        ("cen, middle at half height", _number(peak.cen_deg, "{:.3f}°")),
        ("fwhm, width at half height", _number(peak.fwhm_deg, "{:.3f}°")),
        ("answer from all angles", str(Answer.of(answer))),
        ("reference", _number(known.reference_angle_deg, "{:.3f}°")),
        ("probe", known.probe),
        ("sampling", _number(known.sampling_hz, "{:g} MHz", 1e-6)),
        ("speed of sound", _number(known.sound_speed_m_s, "{:g} m/s")),
        ("pitch", _number(known.pitch_m, "{:.4g} mm", 1e3)),
        ("face radius", _number(known.face_radius_m, "{:.4g} mm", 1e3)),
        ("wavelength", _number(known.wavelength_m, "{:.4g} nm", 1e9)),
        ("pulse energy", _number(known.pulse_energy_j, "{:.4g} mJ", 1e3)),
        ("made with", known.made_with),
        ("configuration", known.configuration),
        ("seed", None if known.seed is None else str(known.seed)),
    ]
    yield facts(rows)


def _origin(bank: IntensityBank | FrameBank, probe: str | None) -> str:
    if runs.intensities_stored(bank, probe=probe):
        return "as the file has them"
    return "computed from the frames" if probe is None else "computed again from the frames"


def _imaged_by(bank: IntensityBank | FrameBank, probe: str | None) -> str | None:
    """The imaging chain of the frames: its preset, who named it, and its parameters; None where there are no frames."""
    from markerseek.records.banks import FrameBank

    if not isinstance(bank, FrameBank):
        return None
    preset = rigs.preset_of(bank, probe)
    if probe is not None:
        named = "--probe"
    else:
        named = "assumed, as the file names no probe: --probe" if bank.facts.probe is None else "as the file has it"
    return (
        f"the chain of {preset.name} ({named}): {preset.array.elements} elements of "
        f"{1e3 * preset.array.pitch_m:.4g} mm, {1e-6 * preset.sampling_hz:g} MHz, {preset.sound_speed_m_s:g} m/s, "
        f"band {1e-6 * preset.low_hz:g} to {1e-6 * preset.high_hz:g} MHz"
    )


def _date(unix_s: float) -> str:
    try:
        return f"{datetime.fromtimestamp(unix_s, UTC):%Y-%m-%d %H:%M:%S} UTC"
    # A foreign file can contain any number, and datetime ends with the year 9999.
    except (OverflowError, ValueError, OSError):
        return f"{unix_s:g} s after 1970"


def _number(value: float | None, form: str, scale: float = 1.0) -> str | None:
    return None if value is None else form.format(value * scale)


def _title(path: Path, bank: IntensityBank | FrameBank) -> str:
    known = bank.facts.description
    return f"{path.name}{': ' if known else ''}{known}"


DAMAGED = 1
"""Exit code if anything is wrong."""


def verify(
    bank: Annotated[Path, typer.Argument(help="Bank: IPASC HDF5, folder of frames, or CSV.")],
    as_json: AsJson = False,
) -> None:
    """Read every frame of a bank and compare it with its checksum; exit code 1 if anything is wrong."""
    from markerseek.records.banks import FrameBank, frame_faults, has_checksums, read_bank

    held = read_bank(bank)
    frames = len(held.angles_deg) + held.dark_frames if isinstance(held, FrameBank) else 0
    faults: list[str] = []
    with progress_bar(frames, what="reading") as progress:
        for fault in frame_faults(held):
            if fault is not None:
                faults.append(fault)
            progress.advance(progress.task_ids[0])
    checksums = has_checksums(held)
    sound = f"{frames - len(faults)} of {frames} frames"
    if not frames:
        found = f"{len(held.angles_deg)} angles with intensities can be read; there are no frames"
    elif checksums:
        found = f"{sound} are as they were written"
    else:
        found = f"{sound} can be read; the bank has no checksums, so a change would not show"
    report = Report(
        values=with_version(ok=not faults, frames=frames, checksums=checksums, faults=faults),
        shown=[*(f"[red]wrong:[/] {one_line(fault)}" for fault in faults), found],
        exit_code=DAMAGED if faults else 0,
    )
    Output(as_json=as_json).show(report)


app = typer.Typer(
    name="bank",
    help="Make, look at and convert banks: scans of many angles.",
    no_args_is_help=True,
    rich_markup_mode="markdown",
)
_COMMANDS = (
    ("scan", bank_scan.command, bank_scan.EXAMPLES),
    ("info", info, _INFO_EXAMPLES),
    ("verify", verify, "markerseek bank verify scan.hdf5"),
    ("import", bank_files.import_bank, bank_files.IMPORT_EXAMPLES),
    ("export", bank_files.export_bank, bank_files.EXPORT_EXAMPLES),
)
for _name, _command, _examples in _COMMANDS:
    add_command(app, _name, _command, _examples)
