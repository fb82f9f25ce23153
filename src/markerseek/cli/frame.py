"""``markerseek frame``: finds the sources in one frame of channel data."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape
from rich.table import Table

from markerseek import rigs, signals
from markerseek.cli.options import AsJson, Out
from markerseek.cli.report import Output, Report, drawn, table, with_version
from markerseek.cli.terminal import announce_compilation
from markerseek.core import AcquisitionError, BModeImage, ChannelFrame, ConfigError, PaImage, RecordError, RFFrame

if TYPE_CHECKING:
    from matplotlib.figure import Figure

EXAMPLES = (
    "Examples:\n\n"
    "  markerseek frame waterbath_20170419-171121.mat --plot\n\n"
    "  markerseek frame frame.npy --probe examples/probes/linear-64.toml\n\n"
    "  markerseek frame bmode.b8 --number 5 --plot\n\n"
    "  markerseek frame pa.rf --spare --plot\n\n"
    "  markerseek frame scan/angle_-12.5deg --probe BPL9-5/55 --max-depth-mm 60 --json"
)

_MAX_MM = 1000.0


def command(
    file: Annotated[
        Path,
        typer.Argument(
            help="A SonixDAQ folder, an .npy of (channels, samples), a .mat of the Allman-Bell data set; "
            "or an Ultrasonix .b8 or .rf, which is described and drawn, and with --spare an .rf is searched too."
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
    number: Annotated[int, typer.Option(min=1, help="Which frame of an Ultrasonix file, counted from 1.")] = 1,
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
    from markerseek.cli.ultrasonix import b_mode_under, open_for_spare, ultrasonix_report
    from markerseek.records.banks import MAT_PROBE, ULTRASONIX_SUFFIXES, load_frame

    output = Output.asked(as_json=as_json, plot=plot, out=out)
    _require_spare(file, spare=spare, receive_focus_mm=receive_focus_mm)
    _require_over(over, over_pixel_mm, plot=plot)
    if file.suffix.lower() in ULTRASONIX_SUFFIXES and not spare:
        _require_none(probe=probe, min_depth_mm=min_depth_mm, max_depth_mm=max_depth_mm, over=over)
        output.show(ultrasonix_report(file, number=number))
    if number != 1 and not spare:
        raise ConfigError(f"--number is {number}, and only Ultrasonix files hold more than one frame; leave it out")
    # The public data set was recorded with one probe, which its files do not name.
    preset = rigs.chosen_probe(probe or (MAT_PROBE if file.suffix.lower() == ".mat" else signals.PRESET_NAMES[0]))
    probe = preset.name
    low_m, high_m = _depth_m("--min-depth-mm", min_depth_mm), _depth_m("--max-depth-mm", max_depth_mm)
    reader: signals.AnyImageReader
    frame: ChannelFrame | RFFrame
    if spare:
        focus_m = None if receive_focus_mm is None else receive_focus_mm / 1e3
        reader, frame = open_for_spare(
            file, number=number, probe=probe, receive_focus_m=focus_m, min_depth_m=low_m, max_depth_m=high_m
        )
    else:
        reader = signals.ImageReader(preset, min_depth_m=low_m, max_depth_m=high_m)
        frame = load_frame(file, sampling_hz=preset.sampling_hz)
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
    title = f"{file.name}, probe {probe}, {reader.method}"
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
        yield f"[yellow]saturated:[/] {len(findings.saturated_channels)} channels where the strongest arrives"
    if findings.dead_channels:
        yield f"[yellow]dead:[/] {len(findings.dead_channels)} channels without a signal"


def _figure(findings: signals.FrameFindings, picture: PaImage, *, under: BModeImage | None, title: str) -> Figure:
    from markerseek.pictures import frame_figure, overlay_figure

    arrivals = (findings.strongest, *findings.others) if findings.found else ()
    marks_m = [(each.lateral_m, each.depth_m) for each in arrivals]
    if under is not None:
        title = f"{title}, over B-mode: {'source circled' if arrivals else 'no source'}"
        return overlay_figure(under, picture, marks_m=marks_m, title=title)
    title = f"{title}: {'arrivals numbered' if arrivals else 'no source'}"
    return frame_figure(picture, marks_m=marks_m, title=title)
