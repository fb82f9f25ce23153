"""``markerseek bank info``: prints the contents of a bank and the statistics of its peak."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer
from rich.markup import escape

from markerseek import __version__
from markerseek.cli.output_options import AsJson, Out
from markerseek.cli.table_options import Columns, Unit, table_format
from markerseek.cli.terminal import announce_compilation, picture_folder, print_facts, print_json, stderr, stdout
from markerseek.core import ConfigError

if TYPE_CHECKING:
    from markerseek.records.banks import FrameBank, IntensityBank
    from markerseek.search import Peak

NAME = "info"
EXAMPLES = (
    "Examples:\n\n  markerseek bank info scan.hdf5 --plot\n\n  markerseek bank info examples/simulated_scan.csv --json"
)


class BankReport(msgspec.Struct, frozen=True, kw_only=True):
    """What is in a bank; the statistics of the peak have the names of bluesky: com, cen, fwhm, max."""

    path: str
    content: str
    description: str
    angles: int
    planned: int
    first_deg: float
    last_deg: float
    largest_step_deg: float
    dark_frames: int
    dark_intensity: float | None
    max_deg: float
    max_intensity: float
    com_deg: float
    cen_deg: float | None
    fwhm_deg: float | None
    reference_deg: float | None
    probe: str | None
    sampling_hz: float | None
    sound_speed_m_s: float | None
    pitch_m: float | None
    wavelength_m: float | None
    pulse_energy_j: float | None
    face_radius_m: float | None
    began_unix_s: float | None
    configuration: str | None
    seed: int | None
    made_with: str | None
    version: str = __version__


def command(
    bank: Annotated[
        Path, typer.Argument(help="IPASC HDF5, CSV of angle_deg,intensity, or folder with one frame per angle.")
    ],
    probe: Annotated[
        str | None,
        typer.Option(help="Compute the intensities again with this preset, or with your own probe in FILE.toml."),
    ] = None,
    columns: Columns = None,
    unit: Unit = None,
    plot: Annotated[bool, typer.Option("--plot", help="Write a picture of the curve into --out.")] = False,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Describe a bank: angles, what is known of the probe and the laser, and the peak of its intensity curve."""
    from markerseek.records.banks import IntensityBank, read_bank, require_whole
    from markerseek.rigs import completed_by
    from markerseek.runs import bank_curve, dark_intensity
    from markerseek.search import peak_of

    folder = picture_folder(out, plot=plot)
    held = completed_by(read_bank(bank, table_format(columns, unit)), probe)
    if probe is not None and isinstance(held, IntensityBank):
        raise ConfigError(f"--probe is {probe}, and {bank} holds intensities, not channel data; leave it out")
    # The stored intensities need no frame, and a damaged one must not pass for that reason.
    require_whole(held)
    announce_compilation()
    curve = bank_curve(held, probe=probe)
    peak = peak_of(curve)
    dark = dark_intensity(held, probe=probe)
    report = _report(bank, held, peak, dark=dark)
    if as_json:
        print_json(report)
    else:
        _print(report, computed_with=probe)
    if plot:
        path = folder / f"{bank.stem if bank.is_file() else bank.name}.png"
        _draw(held, curve.intensity.tolist(), report, path, probe=probe)
        (stderr if as_json else stdout).print(f"[dim]picture:[/] {escape(str(path))}")


def _report(path: Path, bank: IntensityBank | FrameBank, peak: Peak, *, dark: float | None) -> BankReport:
    from markerseek.records.banks import FrameBank

    facts = bank.facts
    frames = isinstance(bank, FrameBank)
    angles = bank.angles_deg
    return BankReport(
        path=str(path),
        content="frames of channel data" if frames else "intensities",
        description=facts.description,
        angles=len(angles),
        planned=bank.planned if isinstance(bank, FrameBank) else len(angles),
        first_deg=angles[0],
        last_deg=angles[-1],
        largest_step_deg=max(high - low for low, high in pairwise(angles)),
        dark_frames=bank.dark_frames if isinstance(bank, FrameBank) else 0,
        dark_intensity=dark,
        max_deg=peak.max_deg,
        max_intensity=peak.max_intensity,
        com_deg=peak.com_deg,
        cen_deg=peak.cen_deg,
        fwhm_deg=peak.fwhm_deg,
        reference_deg=facts.reference_angle_deg,
        probe=facts.probe,
        sampling_hz=facts.sampling_hz,
        sound_speed_m_s=facts.sound_speed_m_s,
        pitch_m=facts.pitch_m,
        wavelength_m=facts.wavelength_m,
        pulse_energy_j=facts.pulse_energy_j,
        face_radius_m=facts.face_radius_m,
        began_unix_s=_began_unix_s(bank),
        configuration=facts.configuration,
        seed=facts.seed,
        made_with=facts.made_with,
    )


def _began_unix_s(bank: IntensityBank | FrameBank) -> float | None:
    """When the first acquisition with light began, in seconds since 1970; None where that is not known."""
    from markerseek.records.banks import FrameBank

    known = [each for each in bank.started_s if math.isfinite(each)] if isinstance(bank, FrameBank) else []
    zero_s = bank.facts.clock_zero_unix_s
    return zero_s + min(known) if known and zero_s is not None else None


def _print(report: BankReport, *, computed_with: str | None) -> None:
    stdout.print(f"[bold]{escape(report.path)}[/]: {report.content}")
    cut = ""
    if report.planned != report.angles:
        cut = (
            f" of {report.planned} planned: the scan was cut short, and other programs see zeros for the rest; "
            f"'markerseek bank import {report.path} whole.hdf5' leaves them off"
        )
    rows: list[tuple[str, str | None]] = [
        ("scanned", report.description or None),
        ("began", None if report.began_unix_s is None else _date(report.began_unix_s)),
        ("angles", f"{report.angles}{cut}"),
        ("range", f"{report.first_deg:g}° to {report.last_deg:g}°, steps of at most {report.largest_step_deg:.3g}°"),
        ("dark frames", None if report.dark_frames == 0 else _dark(report)),
        ("intensities", None if computed_with is None else f"computed again with the preset {computed_with}"),
        ("max", f"{report.max_intensity:.4g} at {report.max_deg:.3f}°"),
        ("com, centre of mass above half height", f"{report.com_deg:.3f}°"),
        ("cen, middle at half height", _number(report.cen_deg, "{:.3f}°")),
        ("fwhm, width at half height", _number(report.fwhm_deg, "{:.3f}°")),
        ("reference", _number(report.reference_deg, "{:.3f}°")),
        ("probe", report.probe),
        ("sampling", _number(report.sampling_hz, "{:g} MHz", 1e-6)),
        ("speed of sound", _number(report.sound_speed_m_s, "{:g} m/s")),
        ("pitch", _number(report.pitch_m, "{:.4g} mm", 1e3)),
        ("face radius", _number(report.face_radius_m, "{:.4g} mm", 1e3)),
        ("wavelength", _number(report.wavelength_m, "{:.4g} nm", 1e9)),
        ("pulse energy", _number(report.pulse_energy_j, "{:.4g} mJ", 1e3)),
        ("made with", report.made_with),
        ("configuration", report.configuration),
        ("seed", None if report.seed is None else str(report.seed)),
    ]
    print_facts((name, value) for name, value in rows if value is not None)


def _dark(report: BankReport) -> str:
    return f"{report.dark_frames}, the largest intensity is {report.dark_intensity or math.nan:.4g}"


def _date(unix_s: float) -> str:
    try:
        return f"{datetime.fromtimestamp(unix_s, UTC):%Y-%m-%d %H:%M:%S} UTC"
    # A foreign file can contain any number, and datetime ends with the year 9999.
    except (OverflowError, ValueError, OSError):
        return f"{unix_s:g} s after 1970"


def _number(value: float | None, form: str, scale: float = 1.0) -> str | None:
    return None if value is None else form.format(value * scale)


def _draw(
    bank: IntensityBank | FrameBank, intensities: list[float], report: BankReport, path: Path, *, probe: str | None
) -> None:
    from markerseek.pictures import bank_figure, save_png
    from markerseek.records.banks import FrameBank
    from markerseek.runs import bank_image

    strongest = intensities.index(max(intensities))
    figure = bank_figure(
        bank.angles_deg,
        intensities,
        title=f"{Path(report.path).name}{': ' if report.description else ''}{report.description}",
        max_deg=report.max_deg,
        com_deg=report.com_deg,
        cen_deg=report.cen_deg,
        fwhm_deg=report.fwhm_deg,
        reference_deg=report.reference_deg,
        dark_level=report.dark_intensity,
        image=bank_image(bank, strongest, probe=probe) if isinstance(bank, FrameBank) else None,
    )
    save_png(figure, path)
