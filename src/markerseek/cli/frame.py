"""``markerseek frame``: finds the sources in one frame of channel data, or in lines of an Ultrasonix machine."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from msgspec import structs
from rich.markup import escape
from rich.table import Table

from markerseek import rigs, signals
from markerseek.cli.options import AsJson, Out
from markerseek.cli.report import Output, Report, drawn, table, with_version
from markerseek.cli.terminal import announce_compilation
from markerseek.core import (
    NO_HEADER,
    AcquisitionError,
    ChannelFrame,
    ConfigError,
    LinearArray,
    PaImage,
    RecordError,
    counted,
)
from markerseek.files import quoted

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def command(
    file: Annotated[
        Path,
        typer.Argument(
            help="A SonixDAQ folder, an .npy of (channels, samples), a .mat of the Allman-Bell data set, a scan "
            "(HDF5), or an Ultrasonix .rf, whose lines are focused again, one way (SPARE)."
        ),
    ],
    probe: Annotated[
        str | None,
        typer.Option(
            help="Preset of the imaging chain (an unknown name lists them), or FILE.toml with your own probe.",
            show_default="L3-8 of a .mat, else BPL9-5/55",
        ),
    ] = None,
    number: Annotated[int, typer.Option(min=1, help="Which frame of a scan (HDF5) or of an .rf, counted from 1.")] = 1,
    plot: Annotated[bool, typer.Option("--plot", help="Write a picture of the frame into --out.")] = False,
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Find the sources in one frame of channel data, or say that there is none.

    Examples
    --------
    markerseek frame waterbath_20170419-171121.mat --plot
    markerseek frame frame.npy --probe examples/probes/linear-64.toml
    markerseek frame scan.hdf5 --number 3 --json
    markerseek frame pa.rf --plot
    """
    from markerseek.cli.searching import FOUND, OTHER_ANSWER
    from markerseek.records.banks import HDF5_SUFFIXES

    output = Output.asked(as_json=as_json, plot=plot, out=out)
    suffix = file.suffix.lower()
    of_several = suffix in (".rf", *HDF5_SUFFIXES)
    if number != 1 and not of_several:
        raise ConfigError(f"--number: {file} holds one frame; leave it out")
    reader, frame = _read(file, probe, number=number)
    announce_compilation()
    try:
        findings = reader.findings(frame)
    except AcquisitionError as problem:
        raise RecordError(f"{file}: {problem}") from problem
    at = ""
    if of_several:
        at = f", frame {number}"
    if suffix in HDF5_SUFFIXES:
        at += f" at {frame.header.commanded_deg:g} deg"
    title = f"{file.name}{at}, probe {reader.preset.name}, {reader.method}"
    stem = file.stem if file.is_file() else file.name
    name = f"{stem}.png" if number == 1 else f"{stem}-{number}.png"
    report = Report(
        values=_values(findings, reader.preset.name, method=reader.method),
        shown=_shown(findings, file, reader.preset.name),
        pictures={name: drawn(lambda: _figure(findings, reader.picture(frame), title=title))},
        exit_code=FOUND if findings.found else OTHER_ANSWER,
    )
    output.show(report)


def _values(findings: signals.FrameFindings, probe: str, *, method: str) -> dict[str, object]:
    """Return the result of one frame; if no source was found, the position is that of the largest peak."""
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


def _figure(findings: signals.FrameFindings, picture: PaImage, *, title: str) -> Figure:
    from markerseek.show import frame_figure

    arrivals = (findings.strongest, *findings.others) if findings.found else ()
    marks_m = [(each.lateral_m, each.depth_m) for each in arrivals]
    title = f"{title}: {'arrivals numbered' if arrivals else 'no source'}"
    return frame_figure(picture, marks_m=marks_m, title=title)


def _read(
    file: Path, probe: str | None, *, number: int
) -> tuple[signals.ImageReader | signals.SpareReader, ChannelFrame]:
    """Return the reader of a file, and its frame with that number, counted from 1."""
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
    preset = structs.replace(rigs.chosen_probe(probe or usual), recorded=True)
    if file.suffix.lower() == ".rf":
        return _lines_of(file, preset, number=number)
    return signals.ImageReader(preset), load_frame(file, sampling_hz=preset.sampling_hz, blanked=preset.pickup_samples)


def _lines_of(path: Path, preset: signals.ProbePreset, *, number: int) -> tuple[signals.SpareReader, ChannelFrame]:
    """Return the reader of the lines of an ``.rf`` file, and its frame with that number, counted from 1.

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
        of_lines = structs.replace(preset, array=lines, sampling_hz=float(header.sampling_hz))
    except ConfigError as problem:
        raise RecordError(f"{path}: the lines in its header do not fit probe {preset.name}: {problem}") from problem
    frame = ChannelFrame(header=NO_HEADER, samples=file.rf(number - 1), sampling_hz=of_lines.sampling_hz)
    return signals.SpareReader(of_lines), frame
