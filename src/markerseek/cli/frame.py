"""``markerseek frame``: finds the sources in one frame of channel data, or describes a machine's own images.

Ultrasonix files contain beamformed data without single channels. They are described and drawn; a source is looked for
in lines of radio frequency only (SPARE).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape
from rich.table import Table

from markerseek import rigs, signals
from markerseek.cli.options import AsJson, Out
from markerseek.cli.report import Output, Report, drawn, facts, table, with_version
from markerseek.cli.terminal import announce_compilation
from markerseek.core import (
    NO_HEADER,
    AcquisitionError,
    BModeImage,
    ChannelFrame,
    ConfigError,
    LinearArray,
    PaImage,
    RecordError,
    RFFrame,
    ScanGeometry,
    counted,
    require_range,
)
from markerseek.files import quoted

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure

    from markerseek.records.banks import UltrasonixFile

EXAMPLES = (
    "Examples:\n\n"
    "  markerseek frame waterbath_20170419-171121.mat --plot\n\n"
    "  markerseek frame frame.npy --probe examples/probes/linear-64.toml\n\n"
    "  markerseek frame scan.hdf5 --number 3 --plot\n\n"
    "  markerseek frame bmode.b8 --number 5 --plot\n\n"
    "  markerseek frame pa.rf --spare --plot\n\n"
    "  markerseek frame scan/angle_-12.5deg --probe BPL9-5/55 --max-depth-mm 60 --json"
)

_MAX_MM = 1000.0


def command(
    file: Annotated[
        Path,
        typer.Argument(
            help="A SonixDAQ folder, an .npy of (channels, samples), a .mat of the Allman-Bell data set, a scan "
            "(HDF5); or an Ultrasonix .b8 or .rf, which is described and drawn, and with --spare an .rf is searched "
            "too."
        ),
    ],
    probe: Annotated[
        str | None,
        typer.Option(
            help="Preset of the imaging chain (an unknown name lists them), or FILE.toml with your own probe.",
            show_default="L3-8 of a .mat, else BPL9-5/55",
        ),
    ] = None,
    min_depth_mm: Annotated[float | None, typer.Option(help="Smallest depth of a source.")] = None,
    max_depth_mm: Annotated[float | None, typer.Option(help="Largest depth of a source.")] = None,
    number: Annotated[
        int, typer.Option(min=1, help="Which frame of a scan (HDF5) or of an Ultrasonix file, counted from 1.")
    ] = 1,
    spare: Annotated[
        bool, typer.Option("--spare", help="Find a source in an .rf by SPARE: its lines are focused again, one way.")
    ] = False,
    receive_focus_mm: Annotated[
        float | None,
        typer.Option(help="Depth of a fixed receive focus, with --spare.", show_default="dynamic focus"),
    ] = None,
    over: Annotated[
        Path | None,
        typer.Option(help="B-mode image of the same angle under the picture, with --plot: a .b8, .png or .dcm."),
    ] = None,
    over_pixel_mm: Annotated[
        float | None, typer.Option(help="Size of its pixels.", show_default="as its file says")
    ] = None,
    plot: Annotated[bool, typer.Option("--plot", help="Write a picture of the frame into --out.")] = False,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Find the sources in one frame of channel data, or say that there is none."""
    from markerseek.records.banks import HDF5_SUFFIXES, MAT_PROBE, ULTRASONIX_SUFFIXES, load_frame

    output = Output.asked(as_json=as_json, plot=plot, out=out)
    _require_spare(file, spare=spare, receive_focus_mm=receive_focus_mm)
    _require_over(over, over_pixel_mm, plot=plot)
    if file.suffix.lower() in ULTRASONIX_SUFFIXES and not spare:
        _require_none(probe=probe, min_depth_mm=min_depth_mm, max_depth_mm=max_depth_mm, over=over)
        output.show(_ultrasonix_report(file, number=number))
    scan = file.suffix.lower() in HDF5_SUFFIXES
    if number != 1 and not (spare or scan):
        raise ConfigError(
            f"--number is {number}, and only scans (HDF5) and Ultrasonix files hold more than one frame; leave it out"
        )
    # The public data set was recorded with one probe, which its files do not name.
    usual = MAT_PROBE if file.suffix.lower() == ".mat" else signals.PRESET_NAMES[0]
    low_m, high_m = _depth_m("--min-depth-mm", min_depth_mm), _depth_m("--max-depth-mm", max_depth_mm)
    reader: signals.AnyImageReader
    frame: ChannelFrame | RFFrame
    if spare:
        preset, frame = _lines_of(file, rigs.chosen_probe(probe or usual), number=number)
        focus_m = None if receive_focus_mm is None else receive_focus_mm / 1e3
        reader = signals.SpareReader(preset, receive_focus_m=focus_m, min_depth_m=low_m, max_depth_m=high_m)
    else:
        if scan:
            preset, frame = _frame_of_scan(file, probe, number=number)
        else:
            preset = replace(rigs.chosen_probe(probe or usual), recorded=True)
            frame = load_frame(file, sampling_hz=preset.sampling_hz, blanked=preset.pickup_samples)
        reader = signals.ImageReader(preset, min_depth_m=low_m, max_depth_m=high_m)
    under = None
    if over is not None:
        # Before the frame is imaged: a wrong name is said at once.
        under = b_mode_under(
            over, number=number, preset=reader.preset, samples=frame.samples.shape[1], pixel_mm=over_pixel_mm
        )
    announce_compilation()
    try:
        findings = reader.findings(frame)
    except AcquisitionError as problem:
        raise RecordError(f"{file}: {problem}") from problem
    probe = preset.name
    at = f", frame {number} at {frame.header.commanded_deg:g} deg" if scan else ""
    title = f"{file.name}{at}, probe {probe}, {reader.method}"
    name = f"{file.stem if file.is_file() else file.name}.png"
    report = Report(
        values=_values(findings, probe, method=reader.method),
        shown=_shown(findings, file, probe),
        pictures={name: drawn(lambda: _figure(findings, reader.picture(frame), under=under, title=title))},
        exit_code=0 if findings.found else 3,
    )
    output.show(report)


def _require_spare(file: Path, *, spare: bool, receive_focus_mm: float | None) -> None:
    """Refuse --spare where there are no lines, and its option without it."""
    if receive_focus_mm is not None and not spare:
        raise ConfigError(f"--receive-focus-mm is {receive_focus_mm:g}, and only --spare uses it; leave it out")
    if spare and file.suffix.lower() != ".rf":
        raise ConfigError(f"--spare: {file} is no .rf; it needs lines that a machine has beamformed")


def _require_none(**given: object) -> None:
    """Refuse options that do not apply to an Ultrasonix file."""
    for name, value in given.items():
        if value is not None:
            option = f"--{name.replace('_', '-')}"
            raise ConfigError(f"{option} is for channel data, which an Ultrasonix file does not hold; leave it out")


def _require_over(over: Path | None, pixel_mm: float | None, *, plot: bool) -> None:
    """Refuse a B-mode image without a picture, and the size of its pixels without it."""
    if over is not None and not plot:
        raise ConfigError(f"--over {over}: it is drawn under the picture, and none is asked for; add --plot")
    if over is None and pixel_mm is not None:
        raise ConfigError(f"--over-pixel-mm is {pixel_mm:g}, and only --over uses it; leave it out")


def _depth_m(option: str, value_mm: float | None) -> float | None:
    if value_mm is None:
        return None
    if not 0 <= value_mm <= _MAX_MM:
        raise ConfigError(f"{option} is {value_mm:g}, it must lie between 0 and {_MAX_MM:g} mm")
    return value_mm / 1e3


def _values(findings: signals.FrameFindings, probe: str, *, method: str) -> dict[str, object]:
    """The result of one frame; if no source was found, the position is that of the largest peak."""
    strongest = findings.strongest
    return with_version(
        found=findings.found,
        reason=findings.reason,
        lateral_m=strongest.lateral_m,
        depth_m=strongest.depth_m,
        arrival_s=strongest.arrival_s,
        intensity=strongest.intensity,
        peak_snr_db=findings.peak_snr_db(strongest),
        coherence=strongest.coherence,
        saturated_channels=len(findings.saturated_channels),
        dead_channels=len(findings.dead_channels),
        others=[
            {"lateral_m": each.lateral_m, "depth_m": each.depth_m, "peak_snr_db": findings.peak_snr_db(each)}
            for each in findings.others
        ],
        probe=probe,
        method=method,
    )


def _shown(findings: signals.FrameFindings, file: Path, probe: str) -> Iterator[str | Table]:
    answer = "[bold green]source found[/]" if findings.found else "[bold yellow]no source[/]"
    yield f"{answer} in {escape(file.name)} (probe {probe}): {findings.reason}"
    if findings.found:
        yield table(
            {
                "arrival": str(number),
                "lateral [mm]": f"{1e3 * each.lateral_m:.2f}",
                "depth [mm]": f"{1e3 * each.depth_m:.2f}",
                "time [µs]": f"{1e6 * each.arrival_s:.2f}",
                "intensity": f"{each.intensity:.4g}",
                "SNR [dB]": "–" if (snr_db := findings.peak_snr_db(each)) is None else f"{snr_db:.1f}",
                "coherence": "–" if each.coherence is None else f"{each.coherence:.2f}",
            }
            for number, each in enumerate((findings.strongest, *findings.others), start=1)
        )
    if findings.saturated_channels:
        saturated = counted(len(findings.saturated_channels), "channel")
        yield f"[yellow]saturated:[/] {saturated} where the strongest arrives"
    if findings.dead_channels:
        yield f"[yellow]dead:[/] {counted(len(findings.dead_channels), 'channel')} without a signal"


def _figure(findings: signals.FrameFindings, picture: PaImage, *, under: BModeImage | None, title: str) -> Figure:
    from markerseek.pictures import frame_figure, overlay_figure

    arrivals = (findings.strongest, *findings.others) if findings.found else ()
    marks_m = [(each.lateral_m, each.depth_m) for each in arrivals]
    if under is not None:
        title = f"{title}, over B-mode: {'source circled' if arrivals else 'no source'}"
        return overlay_figure(under, picture, marks_m=marks_m, title=title)
    title = f"{title}: {'arrivals numbered' if arrivals else 'no source'}"
    return frame_figure(picture, marks_m=marks_m, title=title)


def _ultrasonix_report(path: Path, *, number: int) -> Report:
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
    pictures = {f"{path.stem}.png": drawn(_ultrasonix_figure, file, pixels, number=number)}
    return Report(values=values, shown=_described(file, pixels, number=number), pictures=pictures)


def _frame_of_scan(path: Path, probe: str | None, *, number: int) -> tuple[signals.ProbePreset, ChannelFrame]:
    """The preset of a scan, and one of its frames, in the order of their angles, counted from 1."""
    from markerseek.records.banks import FrameBank, read_bank

    bank = read_bank(path)
    if not isinstance(bank, FrameBank):
        raise RecordError(f"{path}: it holds intensities and no frames; see 'markerseek bank info {quoted(path)}'")
    if number > len(bank.angles_deg):
        raise ConfigError(f"--number is {number}, and {path} holds {len(bank.angles_deg)} frames; name one of these")
    return rigs.preset_of(bank, probe), bank.frame(number - 1)


def _lines_of(path: Path, preset: signals.ProbePreset, *, number: int) -> tuple[signals.ProbePreset, RFFrame]:
    """The preset of the lines of an ``.rf`` file, and one of its frames, counted from 1.

    Its header gives the sampling frequency, and how many lines cover the probe, whose length and band are the preset's.
    """
    from markerseek.records.banks import open_ultrasonix

    file = open_ultrasonix(path)
    header = file.header
    width_m = preset.array.elements * preset.array.pitch_m
    # Some exports leave the density out; then all lines of the file cover the probe.
    pitch_m = width_m / (header.line_density if header.line_density > 0 else header.width)
    try:
        lines = LinearArray(elements=header.width, pitch_m=pitch_m)
        of_lines = replace(preset, array=lines, sampling_hz=float(header.sampling_hz))
    except ConfigError as problem:
        raise RecordError(f"{path}: the lines in its header do not fit probe {preset.name}: {problem}") from problem
    return of_lines, RFFrame(header=NO_HEADER, samples=file.rf(number - 1), sampling_hz=of_lines.sampling_hz)


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
    series = read_images(path, pixel_m=None if pixel_mm is None else (pixel_mm / 1e3, pixel_mm / 1e3))
    if not 1 <= number <= len(series.images):
        raise RecordError(f"{path}: there is no image {number}, it holds {len(series.images)}; count from 1")
    pixels = series.images[number - 1]
    if series.pixel_m is None:
        raise ConfigError(f"{path} does not say how large its pixels are; name it with --over-pixel-mm")
    height_m, width_m = series.pixel_m
    geometry = ScanGeometry(
        first_lateral_m=-(pixels.shape[1] - 1) / 2 * width_m,
        lateral_step_m=width_m,
        first_depth_m=height_m / 2,
        depth_step_m=height_m,
    )
    return BModeImage(pixels=pixels, geometry=geometry)


def _described(file: UltrasonixFile, pixels: np.ndarray, *, number: int) -> Iterator[str | Table]:
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


def _ultrasonix_figure(file: UltrasonixFile, pixels: np.ndarray, *, number: int) -> Figure:
    from markerseek.pictures import b_mode_figure, rf_figure

    title = f"{file.path.name}, frame {number} of {file.header.frames}"
    if file.header.kind == "b-mode":
        return b_mode_figure(pixels, title=title)
    return rf_figure(pixels, sampling_hz=file.header.sampling_hz or None, title=title)
