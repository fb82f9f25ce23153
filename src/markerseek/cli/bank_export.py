"""``markerseek bank export``: writes a bank for 3D Slicer and PLUS, for ROS 2, or as a CSV table."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer
from rich.markup import escape

from markerseek import rigs, runs
from markerseek.cli.options import AsJson, Columns, ProbeName, Unit, require_frames, table_format
from markerseek.cli.report import Output, Report, with_version
from markerseek.cli.terminal import announce_compilation, progress_bar, stderr
from markerseek.core import ConfigError

if TYPE_CHECKING:
    from markerseek.records.banks import BankFacts, FrameBank, IntensityBank

EXAMPLES = (
    "Examples:\n\n"
    "  markerseek bank export scan.hdf5 scan.igs.mha\n\n"
    "  markerseek bank export scan.hdf5 scan.mcap\n\n"
    "  markerseek bank export scan.hdf5 scan.csv"
)
SUFFIXES = (".igs.mha", ".mcap", ".csv")

Item = TypeVar("Item")


def command(
    source: Annotated[Path, typer.Argument(help="Bank: IPASC HDF5, folder of frames, or CSV.", metavar="FROM")],
    to: Annotated[Path, typer.Argument(help="New file: .igs.mha, .mcap or .csv.", metavar="TO")],
    probe: ProbeName = None,
    face_radius_mm: Annotated[
        float | None,
        typer.Option(help="Distance of the array's face from the axis of rotation, where the bank does not hold it."),
    ] = None,
    columns: Columns = None,
    unit: Unit = None,
    as_json: AsJson = False,
) -> None:
    """Write a bank's photoacoustic images (envelope) with the probe's angles for other programs."""
    from markerseek.files import require_new
    from markerseek.records.banks import FrameBank, read_bank, require_whole
    from markerseek.records.exports import write_intensities

    kind = next((suffix for suffix in SUFFIXES if to.name.lower().endswith(suffix)), None)
    if kind is None or to.name.lower() == kind:
        raise ConfigError(f"{to}: the name must end in one of: {', '.join(SUFFIXES)}")
    if face_radius_mm is not None and not 0 <= face_radius_mm < 1000:
        raise ConfigError(f"--face-radius-mm is {face_radius_mm:g}, it must lie between 0 and 1000 mm")
    if face_radius_mm is not None and kind == ".csv":
        raise ConfigError(f"--face-radius-mm is for .igs.mha and .mcap, and {to} has no place for it; leave it out")
    bank = rigs.with_probe_facts(read_bank(source, table_format(columns, unit)), probe)
    require_new(to)
    require_frames(bank, source, probe=probe, face_radius_mm=face_radius_mm)
    # A CSV needs no frame, and a damaged one must not pass for that reason.
    require_whole(bank)
    announce_compilation()
    if kind == ".csv":
        write_intensities(
            to, angles_deg=bank.angles_deg, intensities=runs.bank_curve(bank, probe=probe).intensity.tolist()
        )
    elif kind == ".mcap":
        _write_log(to, bank, probe=probe, face_radius_mm=face_radius_mm)
    elif isinstance(bank, FrameBank):
        _write_sequence(to, bank, probe=probe, face_radius_mm=face_radius_mm)
    else:
        raise ConfigError(f"{source}: it holds intensities and no frames to make images of; export it as .mcap or .csv")
    count = len(bank.angles_deg)
    report = Report(
        values=with_version(path=str(to), angles=count, images=isinstance(bank, FrameBank) and kind != ".csv"),
        shown=[f"{count} angles in {escape(str(to))}"],
    )
    Output(as_json=as_json).show(report)


def _write_log(to: Path, bank: IntensityBank | FrameBank, *, probe: str | None, face_radius_mm: float | None) -> None:
    from markerseek.records.banks import FrameBank
    from markerseek.records.exports import series_of, write_mcap

    intensities = runs.bank_curve(bank, probe=probe).intensity.tolist()
    series = series_of(bank, facts=_facts(bank, probe, face_radius_mm), intensities=tuple(intensities))
    if not isinstance(bank, FrameBank):
        write_mcap(to, None, series=series)
        return
    # One scale for all images, so that their brightness can be compared between angles.
    strongest = runs.bank_image(bank, intensities.index(max(intensities)), probe=probe)
    images = _shown(runs.bank_images(bank, probe=probe, order=series.order), len(series.order))
    # An image of zeros is black with any scale.
    write_mcap(to, images, series=series, brightest=float(strongest.envelope.max()) or 1.0)


def _write_sequence(to: Path, bank: FrameBank, *, probe: str | None, face_radius_mm: float | None) -> None:
    from markerseek.records.exports import series_of, write_sequence

    series = series_of(bank, facts=_facts(bank, probe, face_radius_mm))
    write_sequence(
        to, _shown(runs.bank_images(bank, probe=probe, order=series.order), len(series.order)), series=series
    )


def _facts(bank: IntensityBank | FrameBank, probe: str | None, face_radius_mm: float | None) -> BankFacts:
    """Facts of a bank with the face radius given; warns if images cannot be placed without it."""
    from markerseek.records.banks import FrameBank

    facts = runs.bank_facts(bank, probe=probe)
    if face_radius_mm is not None:
        return replace(facts, face_radius_m=face_radius_mm / 1e3)
    if facts.face_radius_m is None and isinstance(bank, FrameBank):
        stderr.print(
            "[yellow]the export has no positions of the images: the bank does not hold the distance of the array's "
            "face from the axis of rotation; give --face-radius-mm[/]"
        )
    return facts


def _shown(items: Iterable[Item], count: int) -> Iterator[Item]:
    """The items, with a progress bar."""
    with progress_bar(count, what="exporting") as progress:
        for item in items:
            yield item
            progress.advance(progress.task_ids[0])
