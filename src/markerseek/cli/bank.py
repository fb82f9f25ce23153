"""``markerseek bank``: banks (scans of many angles): the group, and its command ``info``."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import msgspec
import typer
from rich.markup import escape

from markerseek import rigs, runs
from markerseek.cli.options import AsJson, Out, TableOptions, require_frames, with_values
from markerseek.cli.report import Output, Report, drawn, facts, with_version
from markerseek.cli.terminal import announce_compilation
from markerseek.core import SearchPlan
from markerseek.records import Answer

if TYPE_CHECKING:
    from markerseek.records.banks import FrameBank, IntensityBank


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
    """Describe a bank: angles, what is known of probe and laser, the peak of its curve, and the answer of `replay`.

    Examples
    --------
    markerseek bank info scan.hdf5 --plot
    markerseek bank info examples/simulated_scan.csv --json
    """
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
    answer = Answer.of(
        runs.answer_from_all(rigs.replayed(bank, probe=probe, table=table.format()), SearchPlan(method="posterior"))
    )
    values = _values(held, probe) | asdict(peak_of(curve)) | msgspec.structs.asdict(answer)
    name = f"{bank.stem if bank.is_file() else bank.name}.png"
    report = Report(
        values=with_version(path=str(bank), **values),
        shown=(f"[bold]{escape(str(bank))}[/]: {values['content']}", facts(_rows(values, answer))),
        pictures={name: drawn(bank_figure, held, title=_title(bank, held), probe=probe, curve=curve)},
    )
    output.show(report)


def _values(bank: IntensityBank | FrameBank, probe: str | None) -> dict[str, Any]:
    """What is in a bank; beside them stand the statistics of its peak with the names of bluesky: com, cen, fwhm, max.

    ``probe``: that with which the intensities are computed again; None takes the bank's.
    """
    known, angles = bank.facts, bank.angles_deg
    begun = [each for each in bank.started_s if math.isfinite(each)]
    zero_s = known.clock_zero_unix_s
    return {
        "content": _content(bank),
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


_SCALED = {
    "sampling_hz": "sampling {:g} MHz",
    "sound_speed_m_s": "speed of sound {:g} m/s",
    "pitch_m": "pitch {:.4g} mm",
    "face_radius_m": "face radius {:.4g} mm",
    "wavelength_m": "wavelength {:.4g} nm",
    "pulse_energy_j": "pulse energy {:.4g} mJ",
}
_UNITS = {"MHz": 1e-6, "m/s": 1.0, "mm": 1e3, "nm": 1e9, "mJ": 1e3, "°": 1.0}


def _rows(values: dict[str, Any], answer: Answer) -> Iterator[tuple[str, str | None]]:
    """Names and values for people."""
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
    for name, title in (
        ("com_deg", "com, centre of mass above half height"),
        ("cen_deg", "cen, middle at half height"),
        ("fwhm_deg", "fwhm, width at half height"),
    ):
        yield title, None if values[name] is None else f"{values[name]:.3f}°"
    yield "answer from all angles", str(answer)
    yield "reference", None if values["reference_deg"] is None else f"{values['reference_deg']:.3f}°"
    for name, text in _SCALED.items():
        title, form, unit = text.rsplit(" ", 2)
        yield title, None if values[name] is None else f"{form.format(values[name] * _UNITS[unit])} {unit}"
    for name in ("probe", "made_with", "configuration", "seed"):
        yield name.replace("_", " "), None if values[name] is None else str(values[name])


def _content(bank: IntensityBank | FrameBank) -> str:
    from markerseek.records.banks import FrameBank

    return "frames of channel data" if isinstance(bank, FrameBank) else "intensities"


def _imaged_by(bank: IntensityBank | FrameBank, probe: str | None) -> str | None:
    """The imaging chain of the frames: its preset, who named it, and its parameters; None if there are no frames."""
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


def _title(path: Path, bank: IntensityBank | FrameBank) -> str:
    known = bank.facts.description
    return f"{path.name}{': ' if known else ''}{known}"
