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
    ScanGeometry,
    counted,
)
from markerseek.files import quoted

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from markerseek.records.banks import UltrasonixFile

EXAMPLES = """
    markerseek frame waterbath_20170419-171121.mat --plot
    markerseek frame frame.npy --probe examples/probes/linear-64.toml
    markerseek frame scan.hdf5 --number 3 --json
    markerseek frame pa.rf --spare --over us.b8 --plot
"""


def command(
    file: Annotated[
        Path,
        typer.Argument(
            help="A SonixDAQ folder, an .npy of (channels, samples), a .mat of the Allman-Bell data set, a scan "
            "(HDF5); or an Ultrasonix .b8 or .rf, which is described and drawn."
        ),
    ],
    probe: Annotated[
        str | None,
        typer.Option(
            help="Preset of the imaging chain (an unknown name lists them), or FILE.toml with your own probe.",
            show_default="L3-8 of a .mat, else BPL9-5/55",
        ),
    ] = None,
    number: Annotated[
        int, typer.Option(min=1, help="Which frame of a scan (HDF5) or of an Ultrasonix file, counted from 1.")
    ] = 1,
    spare: Annotated[
        bool, typer.Option("--spare", help="Find a source in an .rf by SPARE: its lines are focused again, one way.")
    ] = False,
    over: Annotated[
        Path | None,
        typer.Option(help="B-mode image (.b8) of the same frames, drawn under the picture."),
    ] = None,
    plot: Annotated[bool, typer.Option("--plot", help="Write a picture of the frame into --out.")] = False,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Find the sources in one frame of channel data, or say that there is none."""
    from markerseek.records.banks import HDF5_SUFFIXES, ULTRASONIX_SUFFIXES

    output = Output.asked(as_json=as_json, plot=plot or over is not None, out=out)
    suffix = file.suffix.lower()
    if spare and suffix != ".rf":
        raise ConfigError(f"--spare: {file} is no .rf; it needs lines that a machine has beamformed")
    machine = suffix in ULTRASONIX_SUFFIXES and not spare
    for option, given, fits in (
        ("--probe", probe is not None, not machine),
        ("--over", over is not None, not machine),
        ("--number", number != 1, suffix in (*ULTRASONIX_SUFFIXES, *HDF5_SUFFIXES)),
    ):
        if given and not fits:
            why = "holds no channel data" if machine else "holds one frame"
            raise ConfigError(f"{option}: {file} {why}; leave it out")
    if machine:
        output.show(_described(file, number=number))
    reader, frame = _read(file, probe, number=number, spare=spare)
    preset = reader.preset
    # Before the frame is imaged: a wrong name is said at once.
    under = None if over is None else b_mode_under(over, number=number, preset=preset, samples=frame.samples.shape[1])
    announce_compilation()
    try:
        findings = reader.findings(frame)
    except AcquisitionError as problem:
        raise RecordError(f"{file}: {problem}") from problem
    at = f", frame {number} at {frame.header.commanded_deg:g} deg" if suffix in HDF5_SUFFIXES else ""
    title = f"{file.name}{at}, probe {preset.name}, {reader.method}"
    name = f"{file.stem if file.is_file() else file.name}.png"
    report = Report(
        values=_values(findings, preset.name, method=reader.method),
        shown=_shown(findings, file, preset.name),
        pictures={name: drawn(lambda: _figure(findings, reader.picture(frame), under=under, title=title))},
        exit_code=0 if findings.found else 3,
    )
    output.show(report)


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


def _read(
    file: Path, probe: str | None, *, number: int, spare: bool
) -> tuple[signals.ImageReader | signals.SpareReader, ChannelFrame]:
    """One frame of a file, counted from 1, and its reader."""
    from markerseek.records.banks import HDF5_SUFFIXES, MAT_PROBE, FrameBank, load_frame, read_bank

    if file.suffix.lower() in HDF5_SUFFIXES:
        bank = read_bank(file)
        if not isinstance(bank, FrameBank):
            raise RecordError(f"{file}: it holds intensities and no frames; see 'markerseek bank info {quoted(file)}'")
        held = len(bank.angles_deg)
        if number > held:
            raise ConfigError(f"--number is {number}, and {file} holds {held} frames; name one of these")
        return signals.ImageReader(rigs.preset_of(bank, probe)), bank.frame(number - 1)
    # The public data set was recorded with one probe, which its files do not name.
    usual = MAT_PROBE if file.suffix.lower() == ".mat" else signals.PRESET_NAMES[0]
    preset = replace(rigs.chosen_probe(probe or usual), recorded=True)
    if spare:
        return _lines_of(file, preset, number=number)
    return signals.ImageReader(preset), load_frame(file, sampling_hz=preset.sampling_hz, blanked=preset.pickup_samples)


def _lines_of(path: Path, preset: signals.ProbePreset, *, number: int) -> tuple[signals.SpareReader, ChannelFrame]:
    """One frame of an ``.rf`` file, counted from 1, and the reader of its lines.

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
    frame = ChannelFrame(header=NO_HEADER, samples=file.rf(number - 1), sampling_hz=of_lines.sampling_hz)
    return signals.SpareReader(of_lines), frame


def b_mode_under(path: Path, *, number: int, preset: signals.ProbePreset, samples: int) -> BModeImage:
    """B-mode image of the same frame of an Ultrasonix machine.

    Its file names the corners of its region of interest, which is as wide as the probe, and as deep as the machine's
    record of the same frame is long.

    ``number``: number of the frame, counted from 1. ``samples``: samples of a line in the ``.rf`` of the same frame, or
    of a channel.
    """
    from markerseek.records.banks import open_ultrasonix

    if path.suffix.lower() != ".b8":
        raise ConfigError(f"--over {path}: it is no .b8; only those say where their image lies")
    file = open_ultrasonix(path)
    (left, top), (right, upper), (_, bottom), _ = file.header.corners_px
    if not (0 <= left < right <= file.header.width and 0 <= top == upper < bottom <= file.header.height):
        raise RecordError(
            f"{path}: the corners of its region of interest, {file.header.corners_px}, make no rectangle in it"
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


def _described(path: Path, *, number: int) -> Report:
    """A file of an Ultrasonix machine and one of its frames, counted from 1, described and drawn."""
    from markerseek.records.banks import open_ultrasonix

    file = open_ultrasonix(path)
    header, b_mode = file.header, file.header.kind == "b-mode"
    pixels = file.b_mode(number - 1) if b_mode else file.rf(number - 1)
    values = with_version(
        content=header.kind,
        frames=header.frames,
        frame=number,
        width=header.width,
        height=header.height,
        probe_number=header.probe,
        transmit_hz=header.transmit_hz,
        # In B-mode files this field is not the rate of the pixels.
        sampling_hz=None if b_mode else header.sampling_hz,
        frame_rate_hz=header.frame_rate_hz,
        line_density=header.line_density,
        numbered_frames=header.tagged,
        smallest=int(pixels.min()),
        largest=int(pixels.max()),
    )
    what = "B-mode images" if b_mode else "radio-frequency lines that the machine has beamformed"
    cure = "" if b_mode else "; --spare looks for one"
    rows = [(name.replace("_", " "), str(each)) for name, each in values.items() if each is not None]
    shown = (
        f"[bold]{escape(path.name)}[/]: {what}; it holds no channel data, so no source is looked for{cure}",
        facts(rows),
    )
    return Report(values=values, shown=shown, pictures={f"{path.stem}.png": drawn(_drawn_frame, file, number=number)})


def _drawn_frame(file: UltrasonixFile, *, number: int) -> Figure:
    from markerseek.pictures import b_mode_figure, rf_figure

    title = f"{file.path.name}, frame {number} of {file.header.frames}"
    if file.header.kind == "b-mode":
        return b_mode_figure(file.b_mode(number - 1), title=title)
    return rf_figure(file.rf(number - 1), sampling_hz=file.header.sampling_hz or None, title=title)
