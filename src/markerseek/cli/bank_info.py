"""``markerseek bank info``: describes a bank."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer
from rich.markup import escape

from markerseek import rigs, runs
from markerseek.cli.options import AsJson, Out, with_values
from markerseek.cli.recordings import TypedTable, require_frames
from markerseek.cli.report import Output, Report, drawn, facts, with_version
from markerseek.cli.terminal import announce_compilation
from markerseek.core import Estimate, SearchPlan
from markerseek.records.banks import TableFormat

if TYPE_CHECKING:
    from markerseek.records.banks import FrameBank, IntensityBank
    from markerseek.search import Curve, Peak


@with_values
def command(
    bank: Annotated[
        Path,
        typer.Argument(
            help="HDF5, NumPy or MATLAB arrays, CSV of angle_deg,intensity, or folder with one frame per angle."
        ),
    ],
    table: TableFormat,
    typed: TypedTable,
    probe: Annotated[
        str | None,
        typer.Option(help="Compute the intensities again with this preset, or with your own probe in FILE.toml."),
    ] = None,
    plot: Annotated[bool, typer.Option("--plot", help="Write a picture of the curve into --out.")] = False,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Describe a bank: angles, what is known of probe and laser, the peak of its curve, and the answer of `replay`.

    Examples
    --------
    markerseek bank info scan.hdf5 --plot
    markerseek bank info examples/simulated_scan.csv --json
    """
    from markerseek.figures import bank_figure
    from markerseek.records.banks import require_whole
    from markerseek.show import flat_answer

    output = Output.asked(as_json=as_json, plot=plot, out=out)
    table = typed.added_to(table)
    held = rigs.read_recording(bank, table, probe=probe)
    require_frames(held, bank, probe=probe)
    # The stored intensities need no frame, and a damaged one must not pass for that reason.
    require_whole(held)
    announce_compilation()
    curve = runs.bank_curve(held, probe=probe)
    estimate = runs.answer_from_all(rigs.replayed(bank, probe=probe, table=table), SearchPlan(method="posterior"))
    peak = _peak(curve, estimate)
    judged_by = {
        "background": None if estimate.floor is None else estimate.floor.background,
        "outliers_deg": estimate.outliers_deg,
    }
    values = _values(held, probe) | asdict(peak) | judged_by | flat_answer(estimate)
    name = f"{bank.stem if bank.is_file() else bank.name}.png"
    title = ": ".join(filter(None, (bank.name, held.facts.description)))
    report = Report(
        values=with_version(path=str(bank), **values),
        shown=(f"[bold]{escape(str(bank))}[/]: {values['content']}", facts(_rows(values, estimate))),
        pictures={name: drawn(bank_figure, held, title=title, probe=probe, curve=curve, peak=peak)},
    )
    output.show(report)


def _values(bank: IntensityBank | FrameBank, probe: str | None) -> dict[str, Any]:
    """Return what is in a bank.

    ``probe``: that with which the intensities are computed again; None takes the bank's.
    """
    from markerseek.records.banks import FrameBank

    known = bank.facts
    angles = bank.angles_deg
    begun = [each for each in bank.started_s if math.isfinite(each)]
    zero_s = known.clock_zero_unix_s
    return {
        "content": "frames of channel data" if isinstance(bank, FrameBank) else "intensities",
        "description": known.description,
        "angles": len(angles),
        "first_deg": angles[0],
        "last_deg": angles[-1],
        "largest_step_deg": max(high - low for low, high in pairwise(angles)),
        "dark_frames": bank.dark_frames,
        "dark_intensity": runs.dark_intensity(bank, probe=probe),
        "intensities_stored": runs.intensities_stored(bank, probe=probe),
        "imaged_by": _imaged_by(bank, probe),
        "reference_deg": known.reference_angle_deg,
        "began_unix_s": zero_s + min(begun) if begun and zero_s is not None else None,
    } | {name: getattr(known, name) for name in (*_SCALED, "probe", "made_with", "configuration", "seed")}


def _peak(curve: Curve, estimate: Estimate) -> Peak:
    """Return the statistics of the highest peak, with the names of bluesky: com, cen, fwhm, max.

    Of the samples and above the background by which the answer judges.
    """
    import numpy as np

    from markerseek.search import Curve, peak_of

    background = None if estimate.floor is None else estimate.floor.background
    kept = ~np.isin(curve.angle_deg, estimate.outliers_deg)
    judged = Curve(angle_deg=curve.angle_deg[kept], intensity=curve.intensity[kept])
    return peak_of(judged, background=background or 0.0)


class _Scaled(NamedTuple):
    """How a value is printed for people."""

    title: str
    form: str
    unit: str
    scale: float
    """Units in one unit of SI."""


_SCALED = {
    "sampling_hz": _Scaled("sampling", "g", "MHz", 1e-6),
    "sound_speed_m_s": _Scaled("speed of sound", "g", "m/s", 1.0),
    "pitch_m": _Scaled("pitch", ".4g", "mm", 1e3),
    "face_radius_m": _Scaled("face radius", ".4g", "mm", 1e3),
    "wavelength_m": _Scaled("wavelength", ".4g", "nm", 1e9),
    "pulse_energy_j": _Scaled("pulse energy", ".4g", "mJ", 1e3),
}


def _rows(values: dict[str, Any], estimate: Estimate) -> Iterator[tuple[str, str | None]]:
    """Yield the names and values for people."""
    from markerseek.show import estimate_line, outliers_rows

    yield "scanned", values["description"] or None
    yield "began", None if values["began_unix_s"] is None else _date(values["began_unix_s"])
    yield "angles", str(values["angles"])
    steps = f"steps of at most {values['largest_step_deg']:.3g}°"
    yield "range", f"{values['first_deg']:g}° to {values['last_deg']:g}°, {steps}"
    if values["dark_intensity"] is not None:
        largest = f"the largest intensity is {values['dark_intensity']:.4g}"
        yield "dark frames", f"{values['dark_frames']}, {largest}"
    yield "intensities", "as the file has them" if values["intensities_stored"] else "computed from the frames"
    yield "imaged by", values["imaged_by"]
    yield "max", f"{values['max_intensity']:.4g} at {values['max_deg']:.3f}°"
    above = ""
    if values["background"] is not None:
        above = " above the background"
        yield "background", f"{values['background']:.4g}, seen at all angles"
    yield from outliers_rows(values["outliers_deg"])
    for name, title in (
        ("com_deg", "com, centre of mass above half height"),
        ("cen_deg", "cen, middle at half height"),
        ("fwhm_deg", "fwhm, width at half height"),
    ):
        yield title + above, None if values[name] is None else f"{values[name]:.3f}°"
    yield "answer from all angles", estimate_line(estimate)
    yield "reference", None if values["reference_deg"] is None else f"{values['reference_deg']:.3f}°"
    for name, as_shown in _SCALED.items():
        value = values[name]
        yield (
            as_shown.title,
            None if value is None else f"{value * as_shown.scale:{as_shown.form}} {as_shown.unit}",
        )
    for name in ("probe", "made_with", "configuration", "seed"):
        yield name.replace("_", " "), None if values[name] is None else str(values[name])


def _imaged_by(bank: IntensityBank | FrameBank, probe: str | None) -> str | None:
    """Return the imaging chain of the frames: its preset, who named it, and its parameters.

    None if there are no frames.
    """
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
