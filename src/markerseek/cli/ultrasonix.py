"""A machine's own images for ``markerseek frame``: Ultrasonix files, and the B-mode under a picture.

Ultrasonix files contain beamformed data without single channels. They are described and drawn; a source is looked for
in lines of radio frequency only (SPARE).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.markup import escape
from rich.table import Table

from markerseek import signals
from markerseek.cli.report import Report, drawn, facts, with_version
from markerseek.core import (
    NO_HEADER,
    BModeImage,
    ConfigError,
    LinearArray,
    RecordError,
    RFFrame,
    ScanGeometry,
    require_range,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from markerseek.records.banks import UltrasonixFile


def ultrasonix_report(path: Path, *, number: int) -> Report:
    """A file and one of its frames, described and drawn.

    ``number``: number of the frame, counted from 1.
    """
    from markerseek.records.banks import open_ultrasonix

    file = open_ultrasonix(path)
    header = file.header
    pixels: np.ndarray = file.b_mode(number - 1) if header.kind == "b-mode" else file.rf(number - 1)
    values = with_version(
        content=header.kind,
        frames=header.frames,
        frame=number,
        width=header.width,
        height=header.height,
        probe_number=header.probe,
        transmit_hz=header.transmit_hz,
        # In B-mode files this field is not the rate of the pixels.
        sampling_hz=header.sampling_hz if header.kind == "rf" else None,
        frame_rate_hz=header.frame_rate_hz,
        line_density=header.line_density,
        numbered_frames=header.tagged,
        smallest=int(pixels.min()),
        largest=int(pixels.max()),
    )
    pictures = {f"{path.stem}.png": drawn(_figure, file, pixels, number=number)}
    return Report(values=values, shown=_shown(file, pixels, number=number), pictures=pictures)


def open_for_spare(
    path: Path,
    *,
    number: int,
    probe: str,
    receive_focus_m: float | None,
    min_depth_m: float | None,
    max_depth_m: float | None,
) -> tuple[signals.SpareReader, RFFrame]:
    """Reader for the lines of an ``.rf`` file, and one of its frames.

    ``path``: its header gives the sampling frequency, and how many lines cover the probe. ``number``: number of the
    frame, counted from 1. ``probe``: preset with the probe's length and band.
    """
    from markerseek.records.banks import open_ultrasonix

    file = open_ultrasonix(path)
    header = file.header
    preset = signals.probe_preset(probe)
    width_m = preset.array.elements * preset.array.pitch_m
    # Some exports leave the density out; then all lines of the file cover the probe.
    pitch_m = width_m / (header.line_density if header.line_density > 0 else header.width)
    try:
        lines = LinearArray(elements=header.width, pitch_m=pitch_m)
        preset = replace(preset, array=lines, sampling_hz=float(header.sampling_hz))
    except ConfigError as problem:
        raise RecordError(f"{path}: the lines in its header do not fit probe {probe}: {problem}") from problem
    frame = RFFrame(header=NO_HEADER, samples=file.rf(number - 1), sampling_hz=preset.sampling_hz)
    reader = signals.SpareReader(
        preset, receive_focus_m=receive_focus_m, min_depth_m=min_depth_m, max_depth_m=max_depth_m
    )
    return reader, frame


def b_mode_under(
    path: Path, *, number: int, preset: signals.ProbePreset, samples: int, pixel_mm: float | None
) -> BModeImage:
    """B-mode image of the same angle.

    An Ultrasonix ``.b8`` names the corners of its region of interest, which is as wide as the probe, and as deep as the
    machine's record of the same frame is long. Any other image is taken to be centred on the array and to begin at its
    face.

    ``number``: number of the frame, counted from 1. ``samples``: samples of a line in the ``.rf`` of the same frame, or
    of a channel. ``pixel_mm``: None where the file says.
    """
    from markerseek.records import read_images
    from markerseek.records.banks import open_ultrasonix

    if pixel_mm is not None:
        require_range("--over-pixel-mm", pixel_mm, low=1e-3, high=10, unit="mm")
    if path.suffix.lower() == ".b8" and pixel_mm is None:
        file = open_ultrasonix(path)
        (left, top), (right, upper), (_, bottom), _ = file.header.corners_px
        if not (0 <= left < right <= file.header.width and 0 <= top == upper < bottom <= file.header.height):
            raise RecordError(
                f"{path}: the corners of its region of interest, {file.header.corners_px}, make no rectangle in it; "
                "name the size of a pixel with --over-pixel-mm"
            )
        width_m = preset.array.elements * preset.array.pitch_m
        # The machine's depth is half the way of sound in the record.
        depth_m = samples / preset.sampling_hz * preset.sound_speed_m_s / 2
        lateral_step_m, depth_step_m = width_m / (right - left), depth_m / (bottom - top)
        geometry = ScanGeometry(
            # The region begins at the left edge of its first pixel, the position of which is its middle.
            first_lateral_m=-width_m / 2 - (left - 0.5) * lateral_step_m,
            lateral_step_m=lateral_step_m,
            first_depth_m=-(top - 0.5) * depth_step_m,
            depth_step_m=depth_step_m,
        )
        return BModeImage(pixels=file.b_mode(number - 1), geometry=geometry)
    series = read_images(path)
    if not 1 <= number <= len(series.images):
        raise RecordError(f"{path}: there is no image {number}, it holds {len(series.images)}; count from 1")
    pixels = series.images[number - 1]
    size_m = series.pixel_m if pixel_mm is None else (pixel_mm / 1e3, pixel_mm / 1e3)
    if size_m is None:
        raise ConfigError(f"{path} does not say how large its pixels are; name it with --over-pixel-mm")
    height_m, width_m = size_m
    geometry = ScanGeometry(
        first_lateral_m=-(pixels.shape[1] - 1) / 2 * width_m,
        lateral_step_m=width_m,
        first_depth_m=height_m / 2,
        depth_step_m=height_m,
    )
    return BModeImage(pixels=pixels, geometry=geometry)


def _shown(file: UltrasonixFile, pixels: np.ndarray, *, number: int) -> Iterator[str | Table]:
    header = file.header
    b_mode = header.kind == "b-mode"
    what = "B-mode images" if b_mode else "radio-frequency lines that the machine has beamformed"
    yield (
        f"[bold]{escape(file.path.name)}[/]: {what}; it holds no channel data, so no source is looked for"
        + ("" if b_mode else "; --spare looks for one")
    )
    size = f"{header.width} × {header.height} pixels" if b_mode else f"{header.width} lines of {header.height} samples"
    rows: list[tuple[str, str | None]] = [
        ("frames", f"{header.frames} of {size}" + (", numbered" if header.tagged else "")),
        ("frame rate", f"{header.frame_rate_hz} Hz"),
        ("transmitted", f"{header.transmit_hz / 1e6:g} MHz"),
        ("sampling", None if b_mode else f"{header.sampling_hz / 1e6:g} MHz"),
        ("lines over the probe", str(header.line_density)),
        ("probe number", str(header.probe)),
        (f"values of frame {number}", f"{int(pixels.min())} to {int(pixels.max())}"),
    ]
    yield facts(rows)


def _figure(file: UltrasonixFile, pixels: np.ndarray, *, number: int) -> Figure:
    from markerseek.pictures import b_mode_figure, rf_figure

    title = f"{file.path.name}, frame {number} of {file.header.frames}"
    if file.header.kind == "b-mode":
        return b_mode_figure(pixels, title=title)
    return rf_figure(pixels, sampling_hz=file.header.sampling_hz or None, title=title)
