"""Describes and draws Ultrasonix files for ``markerseek frame``.

They contain beamformed data without single channels; a source is looked for in lines of radio frequency only (SPARE).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import msgspec
import numpy as np
from rich.markup import escape

from markerseek import __version__
from markerseek.cli.terminal import print_facts, print_json, stderr, stdout
from markerseek.core import ConfigError, FrameHeader, LinearArray, RecordError, RFFrame

if TYPE_CHECKING:
    from markerseek.records.banks import UltrasonixFile
    from markerseek.signals import SpareReader


class UltrasonixReport(msgspec.Struct, frozen=True, kw_only=True):
    """Contents of an Ultrasonix file."""

    content: Literal["b-mode", "rf"]
    frames: int
    frame: int
    width: int
    height: int
    probe_number: int
    transmit_hz: int
    sampling_hz: int | None
    frame_rate_hz: int
    line_density: int
    numbered_frames: bool
    smallest: int
    largest: int
    version: str = __version__


def show_ultrasonix(path: Path, *, number: int, plot: bool, out: Path, as_json: bool) -> None:
    """Describe a file and one of its frames, and draw it.

    Parameters
    ----------
    path
        The file.
    number
        Number of the frame, counted from 1.
    plot, out
        Whether to draw it, and the folder for the picture.
    as_json
        One object for programs instead of words for people.
    """
    from markerseek.records.banks import open_ultrasonix

    file = open_ultrasonix(path)
    header = file.header
    pixels: np.ndarray = file.b_mode(number - 1) if header.kind == "b-mode" else file.rf(number - 1)
    report = UltrasonixReport(
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
    if as_json:
        print_json(report)
    else:
        _print(file, report)
    if plot:
        picture = out / f"{path.stem}.png"
        _draw(file, pixels, picture, number=number)
        (stderr if as_json else stdout).print(f"[dim]picture:[/] {escape(str(picture))}")


def open_for_spare(
    path: Path,
    *,
    number: int,
    probe: str,
    receive_focus_m: float | None,
    min_depth_m: float | None,
    max_depth_m: float | None,
) -> tuple[SpareReader, RFFrame]:
    """Reader for the lines of an ``.rf`` file, and one of its frames.

    Parameters
    ----------
    path
        The file. Its header gives the sampling frequency, and how many lines cover the probe.
    number
        Number of the frame, counted from 1.
    probe
        Preset with the probe's length and band.
    receive_focus_m, min_depth_m, max_depth_m
        As of `markerseek.signals.SpareReader`.
    """
    from markerseek.records.banks import open_ultrasonix
    from markerseek.signals import SpareReader, probe_preset

    file = open_ultrasonix(path)
    header = file.header
    preset = probe_preset(probe)
    width_m = preset.array.elements * preset.array.pitch_m
    # Some exports leave the density out; then all lines of the file cover the probe.
    pitch_m = width_m / (header.line_density if header.line_density > 0 else header.width)
    try:
        lines = LinearArray(elements=header.width, pitch_m=pitch_m)
        preset = replace(preset, array=lines, sampling_hz=float(header.sampling_hz))
    except ConfigError as problem:
        raise RecordError(f"{path}: the lines in its header do not fit probe {probe}: {problem}") from problem
    no_header = FrameHeader(sequence=0, token="", pulses=0, commanded_deg=0.0, started_s=0.0, ended_s=0.0)
    frame = RFFrame(header=no_header, samples=file.rf(number - 1), sampling_hz=preset.sampling_hz)
    reader = SpareReader(preset, receive_focus_m=receive_focus_m, min_depth_m=min_depth_m, max_depth_m=max_depth_m)
    return reader, frame


def _print(file: UltrasonixFile, report: UltrasonixReport) -> None:
    b_mode = report.content == "b-mode"
    what = "B-mode images" if b_mode else "radio-frequency lines that the machine has beamformed"
    stdout.print(
        f"[bold]{escape(file.path.name)}[/]: {what}; it holds no channel data, so no source is looked for"
        + ("" if b_mode else "; --spare looks for one")
    )
    size = f"{report.width} × {report.height} pixels" if b_mode else f"{report.width} lines of {report.height} samples"
    rows = [
        ("frames", f"{report.frames} of {size}" + (", numbered" if report.numbered_frames else "")),
        ("frame rate", f"{report.frame_rate_hz} Hz"),
        ("transmitted", f"{report.transmit_hz / 1e6:g} MHz"),
    ]
    if report.sampling_hz is not None:
        rows.append(("sampling", f"{report.sampling_hz / 1e6:g} MHz"))
    rows += [
        ("lines over the probe", str(report.line_density)),
        ("probe number", str(report.probe_number)),
        (f"values of frame {report.frame}", f"{report.smallest} to {report.largest}"),
    ]
    print_facts(rows)


def _draw(file: UltrasonixFile, pixels: np.ndarray, path: Path, *, number: int) -> None:
    from markerseek.pictures import b_mode_figure, rf_figure, save_png

    title = f"{file.path.name}, frame {number} of {file.header.frames}"
    if file.header.kind == "b-mode":
        save_png(b_mode_figure(pixels, title=title), path)
    else:
        save_png(rf_figure(pixels, sampling_hz=file.header.sampling_hz or None, title=title), path)
