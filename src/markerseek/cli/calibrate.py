"""``markerseek calibrate``: geometry, timing, sound speed and noise of a rig, from one scan of a point source."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import msgspec
import typer
from rich.markup import escape
from rich.table import Table

from markerseek import __version__
from markerseek.cli.output_options import AsJson
from markerseek.cli.probe_option import ProbeName
from markerseek.cli.terminal import announce_compilation, print_json, progress_bar, stdout
from markerseek.core import ConfigError, require_range

if TYPE_CHECKING:
    from markerseek.calibration import Value
    from markerseek.runs import Calibration

NAME = "calibrate"
EXAMPLES = (
    "Examples:\n\n"
    "  markerseek bank scan point.hdf5 --rig examples/rigs/simulated.toml --step-deg 0.5\n\n"
    "  markerseek calibrate point.hdf5 --source-deg 12.5\n\n"
    "  markerseek calibrate point.hdf5 --json"
)


class Estimated(msgspec.Struct, frozen=True, kw_only=True):
    """A number, its standard deviation and its 95 % interval."""

    value: float
    sigma: float
    interval95: tuple[float, float]


class CalibrationReport(msgspec.Struct, frozen=True, kw_only=True):
    """Result of a scan of a point source; see `Calibration` and `Geometry`."""

    zero_deg: Estimated
    source_deg: Estimated
    source_radius_m: Estimated
    face_radius_m: Estimated
    trigger_offset_s: Estimated
    sound_speed_m_s: Estimated
    element_height_m: Estimated
    noise_sigma: Estimated
    misfit: float
    frames: int
    waves: int
    rig_toml: str
    version: str = __version__


def command(
    bank: Annotated[Path, typer.Argument(help="Scan of one point source with its frames: IPASC HDF5 or a folder.")],
    probe: ProbeName = None,
    source_deg: Annotated[float, typer.Option(help="True angle of the point source, in degrees.")] = 0.0,
    zero_deg: Annotated[float, typer.Option(help="The zero_deg of rig.toml with which the scan was taken.")] = 0.0,
    direction: Annotated[
        Literal["forward", "reverse"],
        typer.Option(help="The direction of rig.toml with which the scan was taken; one scan cannot prove it."),
    ] = "forward",
    as_json: AsJson = False,
) -> None:
    """Find angle zero, face radius, trigger offset, sound speed and noise, and print the lines for rig.toml.

    Scan a small absorber (a black thread across the plane, a pencil lead) in water or gel, at angles well beyond both
    sides of the strongest. Then prove the sense of rotation with a second source: markerseek doctor --rig RIG.toml
    --source-deg ANGLE. The element height is fitted as well, because without it off-plane sound seems to arrive late.
    """
    from markerseek.core import AcquisitionError, RecordError, Sample, SearchError
    from markerseek.records.banks import FrameBank, read_bank
    from markerseek.rigs import completed_by, preset_of
    from markerseek.runs import calibrate
    from markerseek.signals import ImageReader

    for name, angle_deg in (("--source-deg", source_deg), ("--zero-deg", zero_deg)):
        require_range(name, angle_deg, low=-360, high=360, unit="deg")
    scan = completed_by(read_bank(bank), probe)
    if not isinstance(scan, FrameBank):
        raise ConfigError(
            f"{bank}: it holds intensities only, and calibration needs the channel data of each angle; name a folder "
            "of frames, or a bank that 'markerseek bank scan' wrote"
        )
    announce_compilation()
    preset = preset_of(scan, probe)
    imaging = ImageReader(preset)
    samples = []
    with progress_bar(len(scan.angles_deg), what="imaging") as progress:
        for index, angle_deg in enumerate(scan.angles_deg):
            frame = scan.frame(index)
            try:
                reading = imaging.read(frame)
            except AcquisitionError as problem:
                raise RecordError(f"{bank}: at {angle_deg:g} deg: {problem}") from problem
            samples.append(Sample(angle_deg=angle_deg, reading=reading, frame=frame))
            progress.advance(progress.task_ids[0])
    try:
        found = calibrate(samples, preset)
    except SearchError as problem:
        raise RecordError(f"{bank}: {problem}") from problem
    report = _report(found, zero_deg=zero_deg, source_deg=source_deg, direction=direction)
    if as_json:
        print_json(report)
    else:
        _print_table(report)


def _report(
    found: Calibration, *, zero_deg: float, source_deg: float, direction: Literal["forward", "reverse"]
) -> CalibrationReport:
    geometry = found.geometry
    # The probe's angle is sense * (reading - zero), and must be source_deg where the source was found.
    sense = 1 if direction == "forward" else -1
    zero = _estimated(geometry.source_deg, times=sense, add=zero_deg - sense * source_deg)
    # As many digits as the interval makes worth writing.
    lines = [
        "[stage]",
        f"zero_deg = {zero.value:.3f}",
        f'direction = "{direction}"',
        "",
        "[probe]",
        f"sound_speed_m_s = {geometry.sound_speed_m_s.value:.1f}",
        f"trigger_offset_s = {geometry.trigger_offset_s.value:.2e}",
        f"face_radius_m = {geometry.face_radius_m.value:.5f}",
    ]
    return CalibrationReport(
        zero_deg=zero,
        source_deg=_estimated(geometry.source_deg),
        source_radius_m=_estimated(geometry.source_radius_m),
        face_radius_m=_estimated(geometry.face_radius_m),
        trigger_offset_s=_estimated(geometry.trigger_offset_s),
        sound_speed_m_s=_estimated(geometry.sound_speed_m_s),
        element_height_m=_estimated(geometry.element_height_m),
        noise_sigma=_estimated(found.noise_sigma),
        misfit=geometry.misfit,
        frames=found.frames,
        waves=found.waves,
        rig_toml="\n".join(lines) + "\n",
    )


def _estimated(value: Value, *, times: int = 1, add: float = 0.0) -> Estimated:
    low, high = sorted(times * end + add for end in value.interval95)
    return Estimated(value=times * value.value + add, sigma=value.sigma, interval95=(low, high))


def _print_table(report: CalibrationReport) -> None:
    table = Table(box=None, padding=(0, 2, 0, 0))
    for heading in ("", "value", "95 % interval", ""):
        table.add_column(heading, justify="left" if heading in ("", " ") else "right")
    rows = (
        ("angle zero (stage reading)", report.zero_deg, 1.0, "°"),
        ("source in the image plane at", report.source_deg, 1.0, "°"),
        ("source from the axis", report.source_radius_m, 1e3, "mm"),
        ("face radius", report.face_radius_m, 1e3, "mm"),
        ("trigger offset", report.trigger_offset_s, 1e6, "µs"),
        ("sound speed", report.sound_speed_m_s, 1.0, "m/s"),
        ("element height (effective)", report.element_height_m, 1e3, "mm"),
        ("noise, beamformed", report.noise_sigma, 1.0, "counts"),
    )
    for name, number, scale, unit in rows:
        low, high = (scale * end for end in number.interval95)
        # Two significant digits of the standard deviation.
        digits = max(0, min(4, 1 - math.floor(math.log10(max(scale * number.sigma, 1e-9)))))
        table.add_row(
            f"[dim]{name}[/]", f"{scale * number.value:.{digits}f}", f"{low:.{digits}f} to {high:.{digits}f}", unit
        )
    stdout.print(table)
    stdout.print(
        f"[dim]{report.waves} of {report.frames} angles had a wave clear enough to be used; the residual of the fit is "
        f"{report.misfit:.1%} of their height[/]\n\nFor rig.toml:\n"
    )
    stdout.print(escape(report.rig_toml))
